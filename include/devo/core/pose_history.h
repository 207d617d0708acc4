// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "devo/core/rigid3.h"

namespace devo {

/// Poses of the last seconds, for looking up the pose at another sensor's time.
/// Not thread-safe.
class PoseHistory {
 public:
  struct Stamped {
    std::int64_t t_ns = 0;
    Rigid3 T_world_event;
  };

  explicit PoseHistory(double length_s = 5.0) : length_s_(length_s) {}

  /// Poses must come in the order of their time; one that is not newer than the last is ignored.
  void Add(std::int64_t t_ns, const Rigid3& T_world_event);

  /// Pose at a time within the history (screw interpolation between neighbours), or up to
  /// `extrapolate_s` before its begin or after its end with the velocity there. Empty otherwise.
  std::optional<Rigid3> At(std::int64_t t_ns, double extrapolate_s = 0) const;

  /// Velocity [v; omega] of and in the moving frame, m/s and rad/s, mean of the 20 ms around a time, as far as they are
  /// within the history. Empty where it has less than half of them.
  std::optional<Vector6d> VelocityAt(std::int64_t t_ns) const;

  /// Left-multiplies all poses: they were measured in a world that was off by this.
  void Move(const Rigid3& T_new_old);

  /// All that are later.
  void ForgetAfter(std::int64_t t_ns);

  bool empty() const { return poses_.empty(); }
  std::int64_t last_time_ns() const { return poses_.back().t_ns; }
  const Rigid3& last() const { return poses_.back().T_world_event; }
  void Clear() { poses_.clear(); }

 private:
  double length_s_;
  std::deque<Stamped> poses_;
};

}  // namespace devo
