// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_delay.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

TEST(DepthDelay, IsThatOfTheEventsBeforeDepthHasBeenComparedWithThem) {
  const DepthDelay delay;
  EXPECT_EQ(delay.Get(0), 0);
  EXPECT_EQ(delay.Get(0.005), 0.005) << "depth keeps to the inertial sensor's time as far as is known";
}

TEST(DepthDelay, IsKnownFromDepthOnceDepthHasTold) {
  DepthDelay delay;
  delay.Step(0.002, 0.99, 0);
  const double told_s = delay.Get(0);
  EXPECT_NEAR(told_s, 0.002, 1e-4);
  EXPECT_NEAR(delay.Get(0.01), told_s, 3e-4) << "the inertial sensor's clock is no business of depth any more";
}

TEST(DepthDelay, DoesNotJumpWhereDepthTellsNothingNew) {
  DepthDelay delay;
  delay.Step(0, 0.5, 0.006);
  EXPECT_NEAR(delay.Get(0.006), 0.006, 1e-12);
}

TEST(DepthDelay, TakesAClearStepAtOnceAndAnUnclearOneInPart) {
  DepthDelay clear, unclear;
  clear.Step(0.01, 0.98, 0);
  unclear.Step(0.01, 0.02, 0);
  EXPECT_GT(clear.Get(0), 0.0095);
  EXPECT_LT(unclear.Get(0), 0.0035);
  EXPECT_GT(unclear.Get(0), 0.002);
  EXPECT_LT(clear.variance_s2(), 0.05 * unclear.variance_s2());
}

TEST(DepthDelay, IsLessSureTheLongerNothingTellsOfIt) {
  DepthDelay delay;
  delay.Step(0, 0.99, 0);
  const double before_s2 = delay.variance_s2();
  delay.Wander(100);
  EXPECT_NEAR(delay.variance_s2() - before_s2, 100 * kDelayWalk_s * kDelayWalk_s, 1e-12);
}

TEST(DepthDelay, IsNotLessAndLessSureWithoutEnd) {
  DepthDelay delay;
  for (int k = 0; k < 1800; ++k) delay.Wander(k / 30.0);  // a minute of images that contradict
  EXPECT_LE(std::sqrt(delay.variance_s2()), 0.02 + 1e-9);
}

TEST(DepthDelay, StaysWithinFiftyMilliseconds) {
  DepthDelay delay;
  delay.Step(0.2, 0.99, 0.02);
  EXPECT_NEAR(delay.Get(0.02), 0.05, 1e-9);
}

}  // namespace
}  // namespace devo
