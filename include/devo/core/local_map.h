// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "devo/core/rigid3.h"

namespace devo {

/// A semi-dense 3D edge point.
struct MapPoint {
  Eigen::Vector3f p_ref = Eigen::Vector3f::Zero();       ///< position, metres, frame `ref`
  Eigen::Vector3f normal_ref = Eigen::Vector3f::Zero();  ///< unit vector across the edge, parallel to the image
                                                         ///< plane of the view that made the point; 0: unknown
  float sign = 0;                                        ///< +1: brighter along normal_ref, -1: darker, 0 unknown
  float sigma_px = 0;  ///< standard deviation across the edge, px in the view that made it
  /// Standard deviation of the depth in that view, as a way along its ray, metres; 0: the depth was measured.
  Eigen::Vector3f sigma_depth_ref = Eigen::Vector3f::Zero();
  int reference = 0;  ///< id of the reference that made the point
};

/// What tracking registers to: points of all references that are in view from one pose, the frame `ref`.
/// Frozen once made.
struct LocalMap {
  std::int64_t t_ns = 0;  ///< time of the view that it was composed for
  std::uint64_t epoch = 0;
  int id = 0;       ///< counts local maps, 0 is the first
  int chapter = 0;  ///< counts beginnings: where tracking was lost for good, a new map began at a guessed pose
  /// Tracking was lost, and depth told where this view is: it begins anew there, whatever was thought before.
  bool found_by_depth = false;
  Rigid3 T_world_ref;
  std::vector<MapPoint> points;

  /// Pose of an event camera from which this view is seen so.
  Rigid3 WorldFromEvent(const Rigid3& T_event_ref) const { return T_world_ref * T_event_ref.inverse(); }
};
using LocalMapPtr = std::shared_ptr<const LocalMap>;

}  // namespace devo
