// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/known_topics.h"

#include <gtest/gtest.h>
#include <ros/init.h>
#include <ros/time.h>

namespace devo {
namespace {

TEST(KnownTopics, AreEmptyAtOnceWhereNoMasterAnswers) {
  // Nobody listens on this port. Who waits for a master would wait for ever; the time-out lets the test end then, too.
  ros::init(ros::M_string{{"__master", "http://localhost:1"}}, "known_topics_test", ros::init_options::NoSigintHandler);
  ros::master::setRetryTimeout(ros::WallDuration(3));
  const ros::WallTime begin = ros::WallTime::now();
  EXPECT_TRUE(AskForTopics()->empty());
  EXPECT_LT((ros::WallTime::now() - begin).toSec(), 1);
}

}  // namespace
}  // namespace devo
