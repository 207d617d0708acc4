// SPDX-License-Identifier: BSD-3-Clause
//
// Whether a camera stands whose surface has hardly any events: they may be missing, or be too few to see a motion that
// turns round slowly, or that is like another one in the image.
#pragma once

#include <cstdint>

#include "devo/core/camera.h"
#include "devo/core/depth_fusion.h"
#include "devo/core/event_activity.h"
#include "devo/core/inertial_buffer.h"
#include "devo/core/local_map.h"
#include "devo/core/motion_filter.h"
#include "devo/core/motion_past.h"
#include "devo/core/surface.h"

namespace devo {

/// What tracking knows of the camera's motion until the surface before.
struct TrackedMotion {
  const MotionFilter& filter;
  const InertialBuffer& inertial;
  const DepthFusion& depth;
  const LocalMap& map;
  const Camera& camera;  ///< undistorted, of the surfaces
  bool lost;

  /// How fast the map's edges would move across themselves at the filter's pose, px/s, with this velocity [v; omega].
  double Flow(const Vector6d& velocity_event) const;
};

/// Not thread-safe.
class Standstill {
 public:
  using Kind = MotionPast::Kind;

  /// As EventActivity's.
  Standstill(double rate_hz, double still_hz) : activity_(rate_hz, still_hz) {}

  /// Of each surface, in the order of time: how the camera moves, kCoasting if it moves on without events. `still`:
  /// the surface has no more events than a standstill may have.
  Kind Judge(const Surface& surface, bool still, const TrackedMotion& known);

  /// Of each surface after Judge(): `flow_px_s`, of edges across themselves, 0 where it is not known.
  void Note(const Surface& surface, bool still, double flow_px_s);

  /// The camera was seen to move until `t_ns` by other things than events, and moves on.
  void MoveOn(std::int64_t t_ns);
  /// It was followed until `t_ns`.
  void FollowedUntil(std::int64_t t_ns) { last_active_ns_ = t_ns; }

  bool held() const { return kind_ == Kind::kStill; }              ///< stands, at the last surface
  bool coasting() const { return kind_ == Kind::kCoasting; }       ///< moves on without events, at the last surface
  std::int64_t held_since_ns() const { return held_since_ns_; }    ///< where held
  std::int64_t last_active_ns() const { return last_active_ns_; }  ///< when the camera was known to move
  std::int64_t last_events_ns() const { return last_events_ns_; }  ///< when there were enough events for that

  /// Others from the next surface on; what was learnt stays.
  void SetRates(double rate_hz, double still_hz) { activity_.SetRates(rate_hz, still_hz); }
  void Clear();

 private:
  /// Whether the camera may move as predicted though `surface` has hardly any events: not where it may be about to
  /// stand, nor where noise shows but not what would move so fast.
  bool MayMoveUnseen(const Surface& surface, const TrackedMotion& known) const;
  /// By what is known of its velocity, not by events, of which the surface has too few since `unseen_s`.
  bool IsMoving(const Surface& surface, double unseen_s, const TrackedMotion& known);

  EventActivity activity_;
  Kind kind_ = Kind::kMoving;
  bool missing_ = false;  // events ended while moving
  std::int64_t held_since_ns_ = 0, last_active_ns_ = 0, last_events_ns_ = 0;
};

}  // namespace devo
