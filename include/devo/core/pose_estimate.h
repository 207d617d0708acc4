// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "devo/core/inertial_calibration.h"
#include "devo/core/inertial_fit.h"
#include "devo/core/pose_history.h"
#include "devo/core/rigid3.h"
#include "devo/core/sensor_delays.h"

namespace devo {

enum class TrackingState : std::uint8_t {
  kInitialising,  ///< no reference yet: no pose
  kTracking,      ///< registered to the map in all six directions
  kDegraded,      ///< pose partly or wholly from the motion prior (few matches, open directions)
  kLost,          ///< no registration: the pose is extrapolated and only a guess
  kRecovered,     ///< first pose registered again after being lost
};

/// Name in lower case, as published in diagnostics.
const char* ToString(TrackingState state);

/// Pose of the event camera at one surface's time, as tracking publishes it. Always finite.
struct PoseEstimate {
  std::int64_t t_ns = 0;
  std::uint64_t epoch = 0;  ///< of the surface
  Rigid3 T_world_event;
  std::int64_t t_edges_ns = 0;  ///< time of the edges that were registered, a few milliseconds before `t_ns`
  Rigid3 T_world_event_edges;   ///< pose at that time, as measured; T_world_event continues it with the velocity
  /// Of the first pose in a map, or of one that was found anew: where the edges were since then, a rest before that is
  /// known first, then the map's own time. In place of all poses before, which this one does not follow from; else
  /// empty.
  std::vector<PoseHistory::Stamped> earlier;
  /// [v; omega], m/s and rad/s, of and in the event frame. Before the first pose (`kInitialising`) the turn alone, as a
  /// gyroscope reads it; zero without one.
  Vector6d velocity_event = Vector6d::Zero();
  bool velocity_of_poses = false;  ///< it is known from poses alone: no inertial sensor knows better
  /// Change of that velocity, m/s^2 and rad/s^2; zero where no inertial sensor tells.
  Vector6d acceleration_event = Vector6d::Zero();
  Matrix6d covariance_event = Matrix6d::Zero();  ///< of a right perturbation [rho; phi] (m, rad) in the event frame
  /// The same without what is not known of where the map's chapter lies in the world, by which all in it is off alike.
  Matrix6d covariance_in_chapter = Matrix6d::Zero();
  /// T_world_event is where the camera was at `t_ns` also where events are late; `t_edges_ns` is the events' own time.
  SensorDelays delays;
  InertialFit inertial_fit;
  std::optional<InertialCalibration> inertial_calibration;  ///< of a sensor in use; empty in another process
  int chapter = 0;         ///< of the map that it is registered to; between chapters, poses are related by a guess only
  bool needs_map = false;  ///< lost for so long that a new chapter is to begin here
  TrackingState state = TrackingState::kInitialising;
  int reference_id = -1;        ///< reference that the local map was centred on
  int points_used = 0;          ///< map points that took part
  double inlier_share = 0;      ///< matched points / points that should have been seen, 0..1
  double mean_residual_px = 0;  ///< mean absolute distance of the matched points
  int iterations = 0;
  std::int64_t published_ns = 0;  ///< by the host's clock; 0: not yet, or in another process
};

}  // namespace devo
