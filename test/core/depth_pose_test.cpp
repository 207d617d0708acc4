// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_pose.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

const Rigid3 kPose = Exp((Vector6d() << 1, 2, 3, 0.3, -0.2, 0.5).finished());
const Vector6d kApart = (Vector6d() << 1e-3, -5e-4, 8e-4, 3e-4, 5e-4, -2e-4).finished();

DepthPose Seen(const Vector6d& apart, double sigma) {
  DepthPose pose;
  pose.T_world_event = kPose * Exp(apart);
  pose.information = Matrix6d::Identity() / (sigma * sigma);
  return pose;
}

Matrix6d Known(double sigma) { return sigma * sigma * Matrix6d::Identity(); }

TEST(DepthPose, CorrectsAPoseTheMoreTheLessThatIsKnown) {
  const auto share = [](double sigma_pose, double sigma_depth) {
    const Rigid3 corrected = Corrected(kPose, Known(sigma_pose), Seen(kApart, sigma_depth));
    return Log(kPose.inverse() * corrected).norm() / kApart.norm();
  };
  EXPECT_NEAR(share(1e-3, 1e-3), 0.2, 1e-6);  // a quarter of the pose's variance
  EXPECT_GT(share(1e-1, 1e-3), 0.99);
  EXPECT_LT(share(1e-4, 1e-3), 0.01);
}

TEST(DepthPose, DoesNotCorrectAPoseThatItContradictsUnlessItIsConfirmed) {
  DepthPose depth = Seen(20 * kApart, 1e-3);
  EXPECT_TRUE(depth.Contradicts(kPose, Known(1e-3)));
  EXPECT_FALSE(depth.Contradicts(kPose, Known(1)));
  const Rigid3 corrected = Corrected(kPose, Known(1e-3), depth);
  EXPECT_EQ(Log(kPose.inverse() * corrected).norm(), 0);
  depth.confirmed = true;
  const double left = Log(depth.T_world_event.inverse() * Corrected(kPose, Known(1e-3), depth)).norm();
  EXPECT_LT(left, 0.05 * Log(kPose.inverse() * depth.T_world_event).norm());
}

TEST(DepthPose, DoesNotCorrectAPoseForWhatMayBeAnErrorOfTheDelay) {
  // 10 ms at 1 rad/s, between two motions that differ by that.
  const Vector6d per_delay = Vector6d::Unit(4);
  DepthPose depth = Seen(0.01 * per_delay + kApart, 1e-3);
  depth.per_delay = per_delay;
  EXPECT_TRUE(depth.Contradicts(kPose, Known(1e-3)));
  depth.delay_sigma_s = 0.01;
  EXPECT_FALSE(depth.Contradicts(kPose, Known(1e-3)));
  for (const bool confirmed : {false, true}) {
    depth.confirmed = confirmed;
    const Vector6d moved = Log(kPose.inverse() * Corrected(kPose, Known(1e-3), depth));
    EXPECT_LT(std::abs(moved(4)), 2e-4) << confirmed;
    EXPECT_NEAR(moved(0), 0.2 * kApart(0), 1e-5) << "other directions are corrected all the same";
  }
}

TEST(DepthPose, DoesNotCorrectAlongDirectionsThatItLeavesOpen) {
  DepthPose seen = Seen(kApart, 1e-3);
  seen.information.row(0).setZero();
  seen.information.col(0).setZero();
  EXPECT_FALSE(seen.KnowsAllDirections());
  const Vector6d moved = Log(kPose.inverse() * Corrected(kPose, Known(1e-3), seen));
  EXPECT_LT(std::abs(moved(0)), 1e-6);
  EXPECT_GT(std::abs(moved(1)), 1e-5);
}

}  // namespace
}  // namespace devo
