// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/depth_clock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kSurface_ns = 1'700'000'000'000'000'000;

TEST(DepthClock, FindsNothingWhereDepthIsOfTheTimeOfTheSurfaces) {
  for (const std::int64_t after_ns : {-1'900'000'000, 0, 900'000'000}) {
    EXPECT_TRUE(IsOfTheirTime(kSurface_ns + after_ns, kSurface_ns));
    EXPECT_EQ(ComplaintOfDepthClock(kSurface_ns + after_ns, kSurface_ns), "");
  }
}

TEST(DepthClock, NamesByHowManySecondsDepthIsAheadOrBehindAndTheParameter) {
  EXPECT_THAT(
      ComplaintOfDepthClock(kSurface_ns + 1'500'000'000, kSurface_ns),
      testing::AllOf(testing::HasSubstr("1.5 s ahead of the events"), testing::HasSubstr("depth_time_offset_s")));
  // A clock that counts from the driver's start.
  EXPECT_THAT(ComplaintOfDepthClock(12'000'000'000, kSurface_ns),
              testing::HasSubstr("1699999988.0 s behind the events"));
}

}  // namespace
}  // namespace devo
