// SPDX-License-Identifier: BSD-3-Clause
//
// The time-surface module: events in, surfaces out (paper section III-B; docs/algorithm.md).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/counters.h"
#include "devo/core/event.h"
#include "devo/core/options.h"
#include "devo/core/pose_estimate.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// How the camera is expected to move while it sees the events of a surface.
struct ExpectedMotion {
  /// At the same velocity for good.
  template <typename Derived>
  ExpectedMotion(const Eigen::MatrixBase<Derived>& velocity, bool poses_alone = false)
      : velocity_event(velocity), of_poses(poses_alone) {}

  /// As it moved when the edges of this pose were there.
  explicit ExpectedMotion(const PoseEstimate& pose)
      : t_ns(pose.t_edges_ns), velocity_event(pose.velocity_event), acceleration_event(pose.acceleration_event),
        of_poses(pose.velocity_of_poses) {}

  /// Before any pose is known: as a gyroscope reads it, rad/s. Zero, without one, is as if nothing were known.
  static ExpectedMotion OfTurn(const Eigen::Vector3d& turn_event) {
    Vector6d velocity = Vector6d::Zero();
    velocity.tail<3>() = turn_event;
    ExpectedMotion motion(velocity);
    motion.turn_alone = true;
    return motion;
  }

  std::int64_t t_ns = 0;                           ///< when it moves so
  Vector6d velocity_event;                         ///< [v; omega], m/s and rad/s, of and in the event frame
  Vector6d acceleration_event = Vector6d::Zero();  ///< change of `velocity_event`, m/s^2 and rad/s^2; zero: not known
  /// By nothing but poses: a wrong one smears the edges along itself, and the poses found in these confirm it. The
  /// events are asked, too (ApparentTurn::Beside).
  bool of_poses;
  bool turn_alone = false;  ///< how the camera shifts is not known: a turn that stands for that, too, is sought
};

/// Not thread-safe; surfaces it returns are.
class SurfaceBuilder {
 public:
  SurfaceBuilder(const Camera& event_camera, const SurfaceOptions& options);
  ~SurfaceBuilder();

  /// Other options from the next surface on; events so far stay. `method` and `event_share`, which decide what is
  /// kept of the events, remain those of the constructor.
  void SetOptions(const SurfaceOptions& options);

  /// Consecutive events. Those outside the image or older than the last one are counted and left out. At
  /// rates beyond what a surface uses only the newest are kept, so that the cost stays flat.
  void Insert(EventSpan events);

  /// The events between the last one and `t_ns` were lost: no stillness of the scene is to be read from that.
  void OnLoss(std::int64_t t_ns);

  /// Filters the events inserted so far, which Render else does first: that part needs no velocity and so need not wait
  /// for tracking. Called at most once between two surfaces, the surface is the same; called more often, while events
  /// come in, it is as long as they are no more than a surface uses.
  void Filter();

  /// The surface at `t_ns` from the events inserted so far (all should be before `t_ns`).
  /// `motion`: empty where nothing is known of it. Then, and where it is a turn alone, a rotation is sought in the
  /// events (ApparentTurn::Estimate).
  SurfacePtr Render(std::int64_t t_ns, const std::optional<ExpectedMotion>& motion, const SceneDepth& scene_depth);

  /// Forgets all events; surfaces made later carry the next epoch.
  void Reset();
  std::uint64_t epoch() const;

  const SurfaceCounters& counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace devo
