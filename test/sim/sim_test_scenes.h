// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>

#include "devo/sim/scene.h"

namespace devo::sim {

/// A wall in the plane z = `distance` of a camera at the world's origin that looks along world z.
inline Scene WallScene(double distance, Texture texture, double texture_size_m = 1) {
  Scene scene;
  scene.name = "wall";
  const int index = scene.AddTexture(std::move(texture));
  const double half = 4 * distance;
  // u to the left, so that the normal u x v = -z points to the camera.
  Eigen::Matrix3d R;
  R << -1, 0, 0, 0, 1, 0, 0, 0, -1;
  scene.AddRectangle({Eigen::Quaterniond(R), {half, -half, distance}}, 2 * half, 2 * half,
                     {index, texture_size_m, 1, 0.85});
  scene.ambient_lux = 100;
  scene.motion = {{0, 0, 0}, {0, 0, 0}, {0, 0, 1}, {0, 0, 1}};
  return scene;
}

}  // namespace devo::sim
