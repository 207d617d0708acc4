// SPDX-License-Identifier: BSD-3-Clause
//
// When a camera that is not tracked yet last stood still: then an inertial sensor reads gravity and its own biases, and
// from there it knows the velocity.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "devo/core/inertial_buffer.h"

namespace devo {

/// Not thread-safe.
class RestDetector {
 public:
  struct Span {
    std::int64_t begin_ns, end_ns;
    InertialScatter scatter;
  };

  /// Until `t_ns`, a time after that of the last call, `quiet`: whether hardly any events came since, and what an
  /// inertial sensor read. Readings that have not come yet are looked at in a later call. Before the first call, and in
  /// a long silence, there were no events to be told of: a camera at rest makes none.
  void NoteUntil(std::int64_t t_ns, bool quiet, const InertialBuffer& readings);

  /// In the order of their time: a span of some 10 ms that began where the last one ended, whether hardly any events
  /// came in it, and what an inertial sensor read. Neither tells a rest alone: a slow motion may make no events, and a
  /// steady one reads as none. Readings that scatter more than those of a rest before are no rest's.
  void Note(std::int64_t t_ns, bool quiet, const std::optional<InertialMean>& inertial);

  /// Forgets what was, and goes on from `t_ns`.
  void Start(std::int64_t t_ns);
  bool started() const { return started_; }

  /// The last rest that was long enough to know it by, without its last moment. Empty before the first.
  std::optional<Span> last_rest() const { return last_; }

  void Clear();

 private:
  bool IsAsBefore(const InertialMean& inertial) const;
  InertialScatter Scatter() const;

  bool started_ = false;
  std::int64_t t_ns_ = 0, begin_ns_ = 0;
  int count_ = 0;  // of the readings of the rest that goes on
  Eigen::Vector3d mean_turn_ = Eigen::Vector3d::Zero(), mean_force_ = Eigen::Vector3d::Zero();
  double turn_squares_ = 0, force_squares_ = 0;  // of the differences from the mean, summed over readings and axes
  InertialScatter least_{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  std::optional<Span> last_;
};

}  // namespace devo
