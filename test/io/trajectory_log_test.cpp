// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/trajectory_log.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kBegin_ns = 1700000000123456789;

/// A pose of a way that leaves its beginning by hundreds of metres and turns all the way round.
StampedPose PoseAfter(int k) {
  const double s = 0.01 * k;
  return {kBegin_ns + std::int64_t{10000001} * k,
          Rigid3(ExpSO3({0.7 * std::sin(s), 0.1 * s, 3 * std::cos(0.3 * s)}), {2.5 * s, -std::sin(s), 1e3 + 0.3 * s})};
}

TEST(TrajectoryLog, GivesBackStampsExactlyAndPosesToTheDigitsOfATrajectoryFile) {
  TrajectoryLog log(100000);
  for (int k = 0; k < 20000; ++k) log.Add(PoseAfter(k));
  const Trajectory poses = log.Poses();
  ASSERT_EQ(poses.size(), 20000U);
  for (int k = 0; k < 20000; ++k) {
    const StampedPose truth = PoseAfter(k);
    ASSERT_EQ(poses[k].t_ns, truth.t_ns);
    const Rigid3 error = truth.T_world_body.inverse() * poses[k].T_world_body;
    ASSERT_LT((poses[k].T_world_body.translation() - truth.T_world_body.translation()).norm(), 1e-8) << k;
    ASSERT_LT(error.rotation().vec().norm(), 1e-9) << k;
  }
}

TEST(TrajectoryLog, KeepsStampsThatGoBackOrFarAhead) {
  TrajectoryLog log(10);
  for (const std::int64_t t_ns :
       {kBegin_ns, kBegin_ns - 5, kBegin_ns - 7200000000001, kBegin_ns + 999999999999999999}) {
    log.Add({t_ns, Rigid3()});
    EXPECT_EQ(log.Poses().back().t_ns, t_ns);
  }
}

TEST(TrajectoryLog, ForgetsTheOldestPosesBeyondItsSizeAndAllWhenCleared) {
  TrajectoryLog log(5000);
  for (int k = 0; k < 30000; ++k) {
    log.Add(PoseAfter(k));
    ASSERT_EQ(log.size(), static_cast<std::size_t>(std::min(k + 1, 5000)));
  }
  const Trajectory poses = log.Poses();
  ASSERT_EQ(poses.size(), 5000U);
  for (int k = 0; k < 5000; ++k) ASSERT_EQ(poses[k].t_ns, PoseAfter(25000 + k).t_ns);
  log.Clear();
  EXPECT_EQ(log.size(), 0U);
  log.Add(PoseAfter(7));
  ASSERT_EQ(log.Poses().size(), 1U);
  EXPECT_EQ(log.Poses()[0].t_ns, PoseAfter(7).t_ns);
}

}  // namespace
}  // namespace devo
