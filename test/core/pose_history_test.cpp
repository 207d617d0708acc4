// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/pose_history.h"

#include <cmath>

#include <gtest/gtest.h>

#include "devo/core/time.h"

namespace devo {
namespace {

/// A screw motion: turns about z at 1 rad/s and moves along x of its own frame at 2 m/s.
Rigid3 PoseAt(double t_s) {
  Vector6d twist;
  twist << 2, 0, 0, 0, 0, 1;
  return Exp(twist * t_s);
}

PoseHistory TenPoses() {
  PoseHistory history;
  for (int k = 0; k < 10; ++k) history.Add(NsFromSeconds(0.1 * k), PoseAt(0.1 * k));
  return history;
}

void ExpectNear(const Rigid3& actual, const Rigid3& expected) {
  EXPECT_LT(Log(expected.inverse() * actual).norm(), 1e-9);
}

TEST(PoseHistory, InterpolatesAlongTheScrewBetweenNeighbours) {
  const PoseHistory history = TenPoses();
  for (const double t_s : {0.0, 0.1, 0.137, 0.55, 0.9}) {
    const auto pose = history.At(NsFromSeconds(t_s));
    ASSERT_TRUE(pose) << t_s;
    ExpectNear(*pose, PoseAt(t_s));
  }
}

TEST(PoseHistory, IsEmptyOutsideItsTimeUnlessAskedToExtrapolate) {
  const PoseHistory history = TenPoses();
  EXPECT_FALSE(history.At(NsFromSeconds(-0.01)));
  EXPECT_FALSE(history.At(NsFromSeconds(0.91)));
  EXPECT_FALSE(history.At(NsFromSeconds(0.96), 0.05));
  EXPECT_FALSE(PoseHistory().At(0, 1));
}

TEST(PoseHistory, ExtrapolatesWithTheVelocityAtItsEnds) {
  const PoseHistory history = TenPoses();
  ASSERT_TRUE(history.At(NsFromSeconds(0.94), 0.05));
  ExpectNear(*history.At(NsFromSeconds(0.94), 0.05), PoseAt(0.94));
  ASSERT_TRUE(history.At(NsFromSeconds(-0.04), 0.05));
  ExpectNear(*history.At(NsFromSeconds(-0.04), 0.05), PoseAt(-0.04));
}

TEST(PoseHistory, KnowsTheVelocityOfATimeWithinItButNotBeyond) {
  PoseHistory history;
  for (int k = 0; k <= 10; ++k) history.Add(NsFromSeconds(0.01 * k), PoseAt(std::pow(0.01 * k, 2)));
  for (const double t_s : {0.0, 0.05, 0.093, 0.1}) {
    const auto velocity = history.VelocityAt(NsFromSeconds(t_s));
    ASSERT_TRUE(velocity) << t_s;
    EXPECT_NEAR((*velocity)(0), 2 * 2 * t_s, 0.021) << t_s;
    EXPECT_NEAR((*velocity)(5), 2 * t_s, 0.0105) << t_s;
  }
  EXPECT_FALSE(history.VelocityAt(NsFromSeconds(0.105)));
  EXPECT_FALSE(history.VelocityAt(NsFromSeconds(-0.005)));
  EXPECT_FALSE(PoseHistory().VelocityAt(0));
}

TEST(PoseHistory, OfOnePoseHoldsItNearby) {
  PoseHistory history;
  history.Add(0, PoseAt(1));
  ASSERT_TRUE(history.At(NsFromSeconds(0.02), 0.05));
  ExpectNear(*history.At(NsFromSeconds(0.02), 0.05), PoseAt(1));
  EXPECT_FALSE(history.At(NsFromSeconds(0.06), 0.05));
}

TEST(PoseHistory, IgnoresAPoseThatIsNotNewer) {
  PoseHistory history = TenPoses();
  history.Add(history.last_time_ns(), PoseAt(5));
  history.Add(NsFromSeconds(0.25), PoseAt(5));
  ExpectNear(history.last(), PoseAt(0.9));
  ExpectNear(*history.At(NsFromSeconds(0.25)), PoseAt(0.25));
}

TEST(PoseHistory, ForgetsWhatIsLaterThanATime) {
  PoseHistory history = TenPoses();
  history.ForgetAfter(NsFromSeconds(0.5));
  EXPECT_EQ(history.last_time_ns(), NsFromSeconds(0.5));
  history.Add(NsFromSeconds(0.6), PoseAt(5));
  ExpectNear(history.last(), PoseAt(5));
  history.ForgetAfter(-1);
  EXPECT_TRUE(history.empty());
}

TEST(PoseHistory, ForgetsWhatIsOlderThanItsLength) {
  PoseHistory history(0.35);
  for (int k = 0; k < 10; ++k) history.Add(NsFromSeconds(0.1 * k), PoseAt(0.1 * k));
  EXPECT_FALSE(history.At(NsFromSeconds(0.5)));
  EXPECT_TRUE(history.At(NsFromSeconds(0.6)));
  history.Clear();
  EXPECT_TRUE(history.empty());
}

}  // namespace
}  // namespace devo
