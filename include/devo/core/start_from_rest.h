// SPDX-License-Identifier: BSD-3-Clause
//
// How fast a camera moves at the first map that stood still before it: an inertial sensor has read every change of its
// velocity since.
#pragma once

#include <optional>
#include <vector>

#include "devo/core/inertial_buffer.h"
#include "devo/core/local_map.h"
#include "devo/core/motion_filter.h"
#include "devo/core/options.h"
#include "devo/core/pose_history.h"
#include "devo/core/rest_detector.h"

namespace devo {

struct StartFromRest {
  MotionFilter motion;                       ///< at the map's time and pose
  std::vector<PoseHistory::Stamped> rested;  ///< where the rest began and ended, as far as it was used
};

/// Empty where the rest ended too long before the map, or not all since was read, or not by an accelerometer.
std::optional<StartFromRest> FollowFromRest(const RestDetector::Span& rest, const LocalMap& map,
                                            const InertialBuffer& inertial, const TrackingOptions& options);

}  // namespace devo
