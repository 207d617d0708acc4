// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/trajectory.h"

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>

#include <gtest/gtest.h>

namespace devo::sim {
namespace {

TEST(RandomTrajectory, ReachesButDoesNotExceedTheLimitsOfItsSpeed) {
  for (const std::string scene : {"table", "sofa"}) {
    const Scene s = MakeScene(scene);
    for (const std::string speed : {"slow", "mid", "fast"}) {
      for (std::uint64_t seed = 1; seed < 4; ++seed) {
        const MotionLimits limits = LimitsOf(speed);
        const Trajectory t = RandomTrajectory(s.motion, limits, 10, seed);
        EXPECT_GE(t.duration_s(), 10);
        double v = 0, w = 0;
        for (double time = 0; time < t.duration_s(); time += 0.01) {
          v = std::max(v, t.VelocityAt(time).head<3>().norm());
          w = std::max(w, t.VelocityAt(time).tail<3>().norm());
        }
        EXPECT_LE(v, limits.speed_m_s * 1.001);
        EXPECT_LE(w, limits.rate_rad_s * 1.001);
        EXPECT_GT(std::max(v / limits.speed_m_s, w / limits.rate_rad_s), 0.95);
      }
    }
  }
}

TEST(ClosedTrajectory, ComesBackToItsFirstPoseWithItsFirstVelocityWithinTheLimits) {
  const Scene s = MakeScene("table");
  for (const double duration : {2.0, 10.0, 25.0}) {
    for (const std::string speed : {"slow", "fast"}) {
      const MotionLimits limits = LimitsOf(speed);
      const Trajectory t = ClosedTrajectory(s.motion, limits, duration, 3);
      EXPECT_NEAR(t.duration_s(), duration, 1e-9);
      EXPECT_LT(Log(t.PoseAt(0).inverse() * t.PoseAt(duration)).norm(), 1e-9);
      EXPECT_LT((t.VelocityAt(0.001) - t.VelocityAt(duration - 0.001)).norm(), 0.05);
      double v = 0, w = 0;
      for (double time = 0.01; time < duration - 0.01; time += 0.01) {
        v = std::max(v, t.VelocityAt(time).head<3>().norm());
        w = std::max(w, t.VelocityAt(time).tail<3>().norm());
      }
      EXPECT_LE(v, limits.speed_m_s * 1.001);
      EXPECT_LE(w, limits.rate_rad_s * 1.001);
      EXPECT_GT(std::max(v / limits.speed_m_s, w / limits.rate_rad_s), 0.5) << duration << " s " << speed;
    }
  }
}

TEST(Trajectory, StandsStillAtTheBeginAndDuringAStopAndNeverJumps) {
  const Scene s = MakeScene("table");
  Trajectory t = RandomTrajectory(s.motion, LimitsOf("mid"), 8, 2);
  t.SetPauses(0.3, {{3, 2}});
  for (double time = 0; time < 8; time += 0.005) {
    const Vector6d twist = t.VelocityAt(time);
    const bool still = time < 0.299 || (time > 3.001 && time < 4.999);
    if (still) {
      EXPECT_LT(twist.norm(), 1e-9) << time;
    }
    EXPECT_LT((twist - t.VelocityAt(time + 0.005)).norm(), 0.15) << time;
  }
  EXPECT_GT(t.VelocityAt(2).norm(), 1e-3);
  EXPECT_GT(t.VelocityAt(6).norm(), 1e-3);
}

TEST(Trajectory, RefusesAStopThatBeginsBeforeTheMotionIsAtSpeed) {
  Trajectory t(std::vector<Rigid3>(20), 0.5);
  EXPECT_THROW(t.SetPauses(0.3, {{0.6, 1}}), std::invalid_argument);
}

TEST(Trajectory, FittedToPosesPassesThroughThem) {
  std::vector<double> times;
  std::vector<Rigid3> poses;
  for (int i = 0; i < 60; ++i) {
    const double t = 0.05 * i;
    times.push_back(100 + t);
    poses.emplace_back(ExpSO3({0.8 * std::sin(t), 0.5 * t, 0.3 * std::cos(2 * t)}),
                       Eigen::Vector3d(std::sin(2 * t), std::cos(t), 0.3 * t));
  }
  const Trajectory spline = Trajectory::Fit(times, poses);
  for (int i = 0; i < 60; ++i) EXPECT_LT(Log(spline.PoseAt(0.05 * i).inverse() * poses[i]).norm(), 1e-7) << i;
  EXPECT_NEAR(spline.duration_s(), 0.05 * 59, 1e-9);
}

TEST(Trajectory, VelocityIsTheDerivativeOfThePose) {
  const Trajectory t = RandomTrajectory(MakeScene("table").motion, LimitsOf("fast"), 3, 7);
  const Rigid3 before = t.PoseAt(1.0), after = t.PoseAt(1.001);
  EXPECT_LT((Log(before.inverse() * after) / 0.001 - t.VelocityAt(1.0005)).norm(), 1e-3);
}

TEST(TrajectoryFromTum, NamesFileAndLineOfWhatItCannotRead) {
  const std::string path = testing::TempDir() + "bad_" + std::to_string(getpid()) + ".tum";
  std::ofstream(path) << "# comment\n1 0 0 0 0 0 0 1\n2 0 0 zero 0 0 0 1\n";
  try {
    TrajectoryFromTum(path);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find(path), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("line 3"), std::string::npos);
  }
  std::remove(path.c_str());
}

}  // namespace
}  // namespace devo::sim
