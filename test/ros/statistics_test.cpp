// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/statistics.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

TEST(RateMeter, GivesTheRateOfTheStamps) {
  RateMeter meter;
  EXPECT_EQ(meter.Hz(), 0);
  for (int i = 0; i < 1000; ++i) meter.Add(i * 10'000'000LL);
  EXPECT_NEAR(meter.Hz(), 100, 1e-6);
}

TEST(RateMeter, DoesNotGrowWithStampsThatStandStill) {
  RateMeter meter;
  for (int i = 0; i < 200000; ++i) meter.Add(0);
  EXPECT_EQ(meter.Hz(), 0);
  EXPECT_LE(meter.kept(), 50000U);
}

}  // namespace
}  // namespace devo
