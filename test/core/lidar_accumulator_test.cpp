// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/lidar_accumulator.h"

#include <cmath>
#include <functional>
#include <optional>

#include <gtest/gtest.h>

#include "devo/core/sweep_mesh.h"
#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;

Camera EventCamera() { return {160, 120, 120, 120, 79.5, 59.5, "", {}}; }

/// x forward, y left, z up, above the camera.
Rigid3 EventFromLidar() { return {Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5).inverse(), {0.02, -0.1, -0.03}}; }

/// Where a ray (origin, direction; frame `world`) ends: metres along it, empty where it meets nothing.
using World = std::function<std::optional<double>(const Eigen::Vector3d&, const Eigen::Vector3d&)>;

/// The plane n . p = d.
World Plane(const Eigen::Vector3d& n, double d) {
  return [n, d](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<double> {
    const double range = (d - n.dot(origin)) / n.dot(direction);
    return range > 0 ? std::make_optional(range) : std::nullopt;
  };
}

using Motion = std::function<Rigid3(double)>;  // T_world_event at seconds

Rigid3 AtRest(double) { return {}; }

/// A tenth of a second of 16 beams, 2 deg apart, that turn clockwise through the 120 deg in front.
LidarSweep Sweep(const World& world, const Motion& motion, double begin_s = 0) {
  LidarSweep sweep;
  constexpr double kDegree = M_PI / 180;
  for (int column = 0; column < 300; ++column) {
    const double t_s = begin_s + 0.1 * column / 300;
    const Rigid3 T_world_lidar = motion(t_s) * EventFromLidar();
    for (int ring = 0; ring < 16; ++ring) {
      const double azimuth = (60 - 0.4 * column) * kDegree, elevation = (2 * ring - 15) * kDegree;
      const Eigen::Vector3d d(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                              std::sin(elevation));
      const auto range = world(T_world_lidar.translation(), T_world_lidar.rotation() * d);
      if (range) sweep.points.push_back({(*range * d).cast<float>(), ring, NsFromSeconds(t_s)});
    }
  }
  sweep.end_ns = NsFromSeconds(begin_s + 0.1);
  return sweep;
}

PoseHistory HistoryOf(const Motion& motion, double from_s = -0.1, double to_s = 2) {
  PoseHistory history;
  for (double t_s = from_s; t_s < to_s; t_s += 0.01) history.Add(NsFromSeconds(t_s), motion(t_s));
  return history;
}

double DepthInWorld(const World& world, const Rigid3& T_world_event, int x, int y) {
  const Eigen::Vector3d ray = *EventCamera().Unproject(Eigen::Vector2d(x, y));
  return *world(T_world_event.translation(), T_world_event.rotation() * ray);  // z = 1: range is depth
}

int Known(const DepthImage& depth) {
  int known = 0;
  for (const float z : depth.depth_m) known += z > 0;
  return known;
}

const Eigen::Vector3d kSlanted = Eigen::Vector3d(0.4, -0.2, 0.9).normalized();

/// Largest deviation from the world's depth, over the pixels that have depth.
double WorstError(const DepthImage& depth, const World& world, const Rigid3& T_world_event) {
  double worst = 0;
  for (int y = 0; y < depth.depth_m.rows; ++y) {
    for (int x = 0; x < depth.depth_m.cols; ++x) {
      const float z = depth.depth_m(y, x);
      if (z > 0) worst = std::max(worst, std::abs(z - DepthInWorld(world, T_world_event, x, y)));
    }
  }
  return worst;
}

TEST(LidarAccumulator, ReproducesAPlaneFromASweepTakenInMotion) {
  Vector6d twist;
  twist << 0.8, -0.3, 1.0, 0.2, 1.0, -0.3;  // m/s, rad/s
  const Motion motion = [&](double t_s) { return Exp(twist * t_s); };
  const World wall = Plane(kSlanted, 3);
  const LidarSweep sweep = Sweep(wall, motion);
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  accumulator.Add(sweep, HistoryOf(motion));
  for (const double t_s : {0.1, 0.13}) {
    const DepthImage depth = accumulator.Render(NsFromSeconds(t_s), motion(t_s));
    EXPECT_EQ(depth.t_ns, NsFromSeconds(t_s));
    EXPECT_GT(Known(depth), 160 * 120 * 0.45) << "30 of 53 degrees are covered";
    // Half a pixel of a splat, where the plane slants most.
    EXPECT_LT(WorstError(depth, wall, motion(t_s)), 0.04);
  }
  // Without compensation the same sweep is far off: the test above would notice.
  accumulator.Start(sweep, motion(0.1));
  EXPECT_GT(WorstError(accumulator.Render(100 * kMs, motion(0.1)), wall, motion(0.1)), 0.08);
}

TEST(LidarAccumulator, GetsDenserWithTheSweepsOfAMovingRig) {
  Vector6d twist;
  twist << 0, 0, 0, 0.3, 0.05, 0;
  const Motion motion = [&](double t_s) { return Exp(twist * t_s); };
  const World wall = Plane({0, 0, 1}, 4);
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  const PoseHistory poses = HistoryOf(motion);
  accumulator.Add(Sweep(wall, motion), poses);
  const int of_one = Known(accumulator.Render(100 * kMs, motion(0.5)));
  for (int k = 1; k < 5; ++k) accumulator.Add(Sweep(wall, motion, 0.1 * k), poses);
  const DepthImage depth = accumulator.Render(500 * kMs, motion(0.5));
  EXPECT_GT(Known(depth), 1.15 * of_one);
  EXPECT_LT(WorstError(depth, wall, motion(0.5)), 0.01);
}

TEST(LidarAccumulator, ForgetsSweepsThatAreOlderThanTheWindow) {
  MappingOptions options;
  options.lidar_window_s = 0.35;
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), options);
  const PoseHistory poses = HistoryOf(AtRest);
  accumulator.Add(Sweep(Plane({0, 0, 1}, 2), AtRest), poses);
  // The wall has gone back meanwhile: the old one hides it for as long as it is remembered.
  accumulator.Add(Sweep(Plane({0, 0, 1}, 4), AtRest, 0.3), poses);
  EXPECT_NEAR(accumulator.Render(400 * kMs, Rigid3()).depth_m(60, 80), 2, 1e-3);
  accumulator.Add(Sweep(Plane({0, 0, 1}, 4), AtRest, 0.4), poses);
  EXPECT_NEAR(accumulator.Render(500 * kMs, Rigid3()).depth_m(60, 80), 4, 1e-3);
}

/// A wall 4 m away and in front of it, 2 m away, a board of a metre's width.
World WallWithBoard() {
  return [](const Eigen::Vector3d& origin, const Eigen::Vector3d& d) -> std::optional<double> {
    if (d.z() <= 0) return std::nullopt;
    const double to_board = (2 - origin.z()) / d.z();
    const double x = origin.x() + to_board * d.x(), y = origin.y() + to_board * d.y();
    if (to_board > 0 && std::abs(x) < 0.5 && std::abs(y) < 0.3) return to_board;
    return (4 - origin.z()) / d.z();
  };
}

TEST(LidarAccumulator, DropsBackgroundThatTheForegroundHidesFromTheCamera) {
  // First from half a metre to the side, from where more of the wall behind the board is seen.
  const Motion motion = [](double t_s) { return Rigid3::Translation({t_s < 0.2 ? 0.5 : 0.0, 0, 0}); };
  const World world = WallWithBoard();
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  const PoseHistory poses = HistoryOf(motion);
  const LidarSweep from_aside = Sweep(world, motion);
  accumulator.Add(from_aside, poses);
  accumulator.Add(Sweep(world, motion, 0.3), poses);
  const DepthImage depth = accumulator.Render(400 * kMs, Rigid3());
  // The board spans columns 49.5 to 109.5 and rows 41.5 to 77.5; its rim is left to the splats.
  int hidden = 0, board = 0;
  for (const LidarPoint& point : from_aside.points) {
    const Eigen::Vector3d p = motion(0) * (EventFromLidar() * point.p_lidar.cast<double>());
    const auto u = EventCamera().Project(p);
    hidden += p.z() > 3 && u && u->x() > 54 && u->x() < 105 && u->y() > 48 && u->y() < 71;
  }
  EXPECT_GT(hidden, 50) << "seen from aside, of the wall behind the board";
  for (int y = 48; y <= 71; ++y) {
    for (int x = 54; x <= 105; ++x) {
      EXPECT_LT(depth.depth_m(y, x), 2.1) << x << " " << y;
      board += depth.depth_m(y, x) > 1.9;
    }
  }
  EXPECT_EQ(board, 24 * 52);
  // The wall is seen beside it all the same.
  EXPECT_NEAR(depth.depth_m(60, 30), 4, 1e-2);
  EXPECT_NEAR(depth.depth_m(60, 130), 4, 1e-2);
}

TEST(LidarAccumulator, ContinuesTheForegroundInsteadOfInterpolatingAcrossAJumpOfTheRange) {
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  accumulator.Add(Sweep(WallWithBoard(), AtRest), HistoryOf(AtRest));
  const DepthImage depth = accumulator.Render(100 * kMs, Rigid3());
  int beyond = 0;
  for (int y = 10; y < 110; ++y) {
    for (int x = 10; x < 150; ++x) {
      const float z = depth.depth_m(y, x);
      EXPECT_FALSE(z > 2.1 && z < 3.8) << x << " " << y << ": " << z;
      // The board spans rows 41.5 to 77.5 and columns 49.5 to 109.5, the rings lie 4.2 pixels apart (and two
      // more where they change to the wall, for the LiDAR is not where the camera is).
      const bool far_outside = y < 34 || y > 87 || x < 42 || x > 117;
      EXPECT_FALSE(far_outside && z > 0 && z < 3) << x << " " << y << ": " << z;
      beyond += (y == 40 || y == 79) && x > 55 && x < 105 && z > 1.9 && z < 2.1;
    }
  }
  EXPECT_GT(beyond, 25) << "between the last ring on the board and the next, on the wall";
}

TEST(LidarAccumulator, InterpolatesBetweenTheRingsOfAFloorSeenAtAGrazingAngle) {
  // A metre below the camera: from ring to ring the range jumps by 13 to 20 percent.
  const World floor = Plane({0, 1, 0}, 1);
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  accumulator.Add(Sweep(floor, AtRest), HistoryOf(AtRest));
  const DepthImage depth = accumulator.Render(100 * kMs, Rigid3());
  for (int y = 78; y < 88; ++y) {
    EXPECT_NEAR(depth.depth_m(y, 80), DepthInWorld(floor, Rigid3(), 80, y), 0.04 * depth.depth_m(y, 80)) << y;
  }
}

TEST(LidarAccumulator, LeavesOutPointsOfTimesWithoutAPose) {
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  const World wall = Plane({0, 0, 1}, 3);
  accumulator.Add(Sweep(wall, AtRest), HistoryOf(AtRest, 0.06));
  const DepthImage depth = accumulator.Render(100 * kMs, Rigid3());
  EXPECT_EQ(depth.depth_m(60, 20), 0) << "left of the image: measured first";
  EXPECT_NEAR(depth.depth_m(60, 130), 3, 1e-3);
}

TEST(LidarAccumulator, LeavesOutPointsOfTimesThatCannotBeTheSweepsWithoutRoomForAllBetween) {
  const World world = Plane(kSlanted, 3);
  LidarSweep sweep = Sweep(world, AtRest);
  for (std::size_t i = 0; i < sweep.points.size(); i += 2) sweep.points[i].t_ns -= NsFromSeconds(1.7e9);
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  accumulator.Add(sweep, HistoryOf(AtRest));
  const DepthImage depth = accumulator.Render(100 * kMs, Rigid3());
  EXPECT_GT(Known(depth), 100);
  EXPECT_LT(WorstError(depth, world, Rigid3()), 0.2);
}

TEST(LidarAccumulator, TellsWhenASweepPassedTheView) {
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  const auto t_ns = accumulator.TimeInView(Sweep(Plane({0, 0, 1}, 3), AtRest));
  ASSERT_TRUE(t_ns);
  EXPECT_NEAR(SecondsFromNs(*t_ns), 0.05, 2e-3) << "straight ahead is halfway";
  EXPECT_FALSE(accumulator.TimeInView(LidarSweep()));
}

TEST(LidarAccumulator, StartsWithOneSweepAndForgetsItOnceThereArePoses) {
  LidarAccumulator accumulator(EventCamera(), EventFromLidar(), MappingOptions());
  accumulator.Start(Sweep(Plane({0, 0, 1}, 2), AtRest), Rigid3());
  const DepthImage first = accumulator.Render(50 * kMs, Rigid3());
  EXPECT_GT(Known(first), 160 * 120 * 0.45);
  EXPECT_NEAR(first.depth_m(60, 80), 2, 1e-3);
  accumulator.Add(Sweep(Plane({0, 0, 1}, 4), AtRest, 0.1), HistoryOf(AtRest));
  EXPECT_NEAR(accumulator.Render(200 * kMs, Rigid3()).depth_m(60, 80), 4, 1e-3);
}

TEST(ConnectRings, LeavesPointsWithoutARingAlone) {
  LidarSweep sweep = Sweep(Plane({0, 0, 1}, 3), AtRest);
  EXPECT_GT(ConnectRings(sweep.points).triangles.size(), sweep.points.size());
  EXPECT_NEAR(ConnectRings(sweep.points).spacing_rad, 0.4 * M_PI / 180, 1e-4);
  for (LidarPoint& point : sweep.points) point.ring = -1;
  EXPECT_TRUE(ConnectRings(sweep.points).triangles.empty());
}

TEST(ConnectRings, LeavesAHoleWhereReturnsAreMissing) {
  LidarSweep sweep = Sweep(Plane({0, 0, 1}, 3), AtRest);
  std::vector<LidarPoint> kept;
  for (const LidarPoint& point : sweep.points) {
    if (std::abs(std::atan2(point.p_lidar.y(), point.p_lidar.x())) > 0.03) kept.push_back(point);
  }
  for (const auto& corners : ConnectRings(kept).triangles) {
    const bool left = kept[corners[0]].p_lidar.y() > 0;
    EXPECT_EQ(kept[corners[1]].p_lidar.y() > 0, left);
    EXPECT_EQ(kept[corners[2]].p_lidar.y() > 0, left);
  }
}

}  // namespace
}  // namespace devo
