// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/errors_alike.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

/// Enough events, the usual rate and number of points, no inertial sensor.
AlignedPoints Usual() {
  AlignedPoints of;
  of.points = 2000;
  of.events = 100'000;
  of.rate_hz = 100;
  of.inertial_trust = 0;
  of.weigh_events = of.has_shared_errors = true;
  return of;
}

TEST(ErrorsAlike, CountsPointsOfFewEventsLessButNotWithoutLimit) {
  AlignedPoints few = Usual();
  few.events = few.points * 6;  // half of what places a point's edge
  const ErrorsAlike usual = PointsThatErrAlike(Usual()), of_few = PointsThatErrAlike(few);
  EXPECT_NEAR(of_few.own, 2 * usual.own, 1e-9);
  EXPECT_NEAR(of_few.shared, 2 * usual.shared, 1e-9);
  few.events = 0;
  EXPECT_NEAR(PointsThatErrAlike(few).own, 8 * usual.own, 1e-9);
  few.weigh_events = false;
  EXPECT_NEAR(PointsThatErrAlike(few).own, usual.own, 1e-9);
}

TEST(ErrorsAlike, CountsPointsLessBesideAnInertialSensorAsFarAsItIsTrusted) {
  AlignedPoints guided = Usual();
  guided.inertial_trust = 1;
  EXPECT_NEAR(PointsThatErrAlike(guided).own, 8 * PointsThatErrAlike(Usual()).own, 1e-9);
  guided.inertial_trust = 0.5;
  EXPECT_NEAR(PointsThatErrAlike(guided).own, 4.5 * PointsThatErrAlike(Usual()).own, 1e-9);
  EXPECT_EQ(PointsThatErrAlike(guided).shared, PointsThatErrAlike(Usual()).shared);
}

TEST(ErrorsAlike, TellsNoMoreByMorePointsOnTheSameEdges) {
  AlignedPoints dense = Usual();
  dense.points *= 3;
  EXPECT_NEAR(PointsThatErrAlike(dense).own, 3 * PointsThatErrAlike(Usual()).own, 1e-9);
  AlignedPoints sparse = Usual();
  sparse.points /= 4;
  EXPECT_EQ(PointsThatErrAlike(sparse).own, PointsThatErrAlike(Usual()).own);
}

TEST(ErrorsAlike, TellsNoMoreByFasterSurfacesThatShowTheSameEvents) {
  AlignedPoints fast = Usual();
  fast.rate_hz = 400;
  EXPECT_NEAR(PointsThatErrAlike(fast).own, 4 * PointsThatErrAlike(Usual()).own, 1e-9);
}

TEST(ErrorsAlike, TakesTheOwnErrorForLargerWhereNoneIsShared) {
  AlignedPoints apart = Usual();
  apart.has_shared_errors = false;
  EXPECT_EQ(PointsThatErrAlike(apart).shared, 0);
  EXPECT_NEAR(PointsThatErrAlike(apart).own, 2 * PointsThatErrAlike(Usual()).own, 1e-9);
}

}  // namespace
}  // namespace devo
