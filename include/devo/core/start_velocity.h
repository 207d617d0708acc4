// SPDX-License-Identifier: BSD-3-Clause
//
// How fast a camera moves that is seen for the first time in motion. A first map and a gyroscope say nothing of it, and
// an accelerometer only how it changes; where texture is dense, points that are 2 pixels off meet other edges, and go
// on with them.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "devo/core/camera.h"
#include "devo/core/inertial_buffer.h"
#include "devo/core/local_map.h"
#include "devo/core/surface.h"

namespace devo {

/// What was seen a moment after a map was made.
struct StartView {
  const Surface* surface;       ///< with a field of nearest edges
  double since_s;               ///< from the map's time to the edges', greater than zero
  Eigen::Matrix3d R_ref_event;  ///< how the camera has turned since
};

/// Of `surface`, which is kept by reference, turned as a gyroscope says. Empty where that did not read all of it, or
/// the edges are too near to the map's time to show a motion, or so far from it that the motion may not be even.
std::optional<StartView> ViewSince(const LocalMap& map, const Surface& surface, const InertialBuffer& inertial);

/// Velocity (m/s, frame `ref` of the map) of the camera that sees most of the map's points on edges in all views, if it
/// moves evenly, the slower of two that see as many. Zero where none sees clearly more than one that only turns. Views
/// in the order of their time. `undistorted`: of the surfaces' image.
Eigen::Vector3d FindStartVelocity(const LocalMap& map, const std::vector<StartView>& views, const Camera& undistorted);

}  // namespace devo
