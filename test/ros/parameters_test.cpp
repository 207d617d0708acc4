// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/parameters.h"

#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(RefuseSharedTopics, NamesBothKeysAndTheTopic) {
  Topics topics;
  EXPECT_NO_THROW(RefuseSharedTopics(topics));
  topics.imu = "/imu";
  topics.ground_truth = "/imu";
  EXPECT_THAT([&] { RefuseSharedTopics(topics); },
              ThrowsMessage<std::invalid_argument>(
                  AllOf(HasSubstr("'topics.imu'"), HasSubstr("'topics.ground_truth'"), HasSubstr("/imu"))));
  topics.ground_truth.clear();
  topics.depth = topics.events;
  EXPECT_THAT([&] { RefuseSharedTopics(topics); },
              ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("'topics.events'"), HasSubstr("'topics.depth'"))));
  topics.points = "/velodyne_points";
  EXPECT_NO_THROW(RefuseSharedTopics(topics)) << "the depth images are not used";
}

}  // namespace
}  // namespace devo
