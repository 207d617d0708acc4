// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// The cameras and how they stand to each other.
struct Rig {
  Camera event_camera;
  Camera depth_camera;            ///< equal to event_camera when `depth_registered`
  Rigid3 T_event_depth;           ///< identity when `depth_registered`
  bool depth_registered = false;  ///< depth is already in the (distorted) event image
};

}  // namespace devo
