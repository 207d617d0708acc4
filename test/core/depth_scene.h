// SPDX-License-Identifier: BSD-3-Clause
//
// The corner of a room with a box or more in it, and what a depth camera measures of it: for tests of depth alone.
#pragma once

#include <algorithm>
#include <limits>
#include <random>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

inline Camera DepthSceneCamera() { return {320, 240, 260, 260, 158.3, 121.2, "plumb_bob", {0.05, -0.02, 0, 0}}; }

/// In kBoxPushed the box before the wall stands 2 cm farther to the right.
enum class DepthScene { kRoom, kWall, kFurnishedRoom, kBoxOnFloor, kBoxBeforeWall, kBoxPushed };

/// Distance along a ray from `origin`, in units of `direction`; infinite where nothing is met.
inline double MeetScene(DepthScene scene, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  double nearest = std::numeric_limits<double>::infinity();
  const auto meet = [&](double s) {
    if (s > 1e-6) nearest = std::min(nearest, s);
  };
  const bool walls = scene != DepthScene::kBoxOnFloor;
  if (walls) meet((2.5 - origin.z()) / direction.z());
  if (scene == DepthScene::kWall) return nearest;
  meet((0.9 - origin.y()) / direction.y());  // floor
  const bool box_alone = scene == DepthScene::kBoxBeforeWall || scene == DepthScene::kBoxPushed;
  if (walls && !box_alone) meet((-1.2 - origin.x()) / direction.x());  // left wall
  const auto meet_box = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    double enter = 0, leave = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      const double a = (low[i] - origin[i]) / direction[i], b = (high[i] - origin[i]) / direction[i];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    if (enter < leave) meet(enter);
  };
  if (scene == DepthScene::kBoxOnFloor) meet_box({0.6, 0.45, 2.4}, {1.1, 0.9, 3.2});
  if (scene == DepthScene::kBoxOnFloor) return nearest;
  if (box_alone) {
    const double pushed_m = scene == DepthScene::kBoxPushed ? 0.02 : 0;
    meet_box({0.6 + pushed_m, 0.2, 1.4}, {1.2 + pushed_m, 0.9, 2.0});
    return nearest;
  }
  meet_box({0.5, 0.2, 1.4}, {1.1, 0.9, 2.0});
  if (scene == DepthScene::kRoom) return nearest;
  meet_box({-0.9, -0.1, 1.7}, {-0.4, 0.9, 2.5});
  meet_box({-0.3, -0.9, 2.1}, {0.8, -0.4, 2.5});
  meet_box({0.9, -0.3, 1.9}, {1.6, 0.9, 2.5});
  return nearest;
}

/// Depth in metres with noise of this standard deviation.
inline cv::Mat1f DepthSeen(const Rigid3& T_world_depth, double sigma_m = 0, DepthScene scene = DepthScene::kRoom,
                           unsigned seed = 1) {
  const Camera camera = DepthSceneCamera();
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  cv::Mat1f depth_m(camera.height(), camera.width(), 0.0F);
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      const auto ray = camera.Unproject({x, y});
      if (!ray) continue;
      const double z = MeetScene(scene, T_world_depth.translation(), T_world_depth.rotation() * *ray);
      if (z < 10) depth_m(y, x) = static_cast<float>(z + sigma_m * noise(random));
    }
  }
  return depth_m;
}

}  // namespace devo
