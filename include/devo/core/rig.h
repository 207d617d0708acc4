// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// The event camera, what measures depth, and how they stand to each other.
struct Rig {
  Camera event_camera;
  Camera depth_camera;            ///< equal to event_camera when `depth_registered`, unused with a LiDAR
  Rigid3 T_event_depth;           ///< identity when `depth_registered`; with a LiDAR, its pose
  bool depth_registered = false;  ///< depth is already in the (distorted) event image
  bool depth_from_lidar = false;  ///< sweeps of a LiDAR take the place of depth images
};

}  // namespace devo
