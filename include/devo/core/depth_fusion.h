// SPDX-License-Identifier: BSD-3-Clause
//
// What a pose by depth says of the pose by events: by how much to move it, and how late depth images are. Clocks and
// drivers make them early or late by tens of milliseconds, which in motion would pass for centimetres.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "devo/core/depth_delay.h"
#include "devo/core/depth_pose.h"
#include "devo/core/error_scale.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class DepthFusion {
 public:
  /// What a pose by depth is compared with.
  struct Estimate {
    Rigid3 T_world_event;       ///< at the depth image's time
    Matrix6d covariance;        ///< of a right perturbation [rho; phi] (m, rad) of it
    double variance_scale = 1;  ///< of what is stated of poses, as far as known without depth
    bool guided = false;        ///< by an inertial sensor
    double event_delay_s = 0;   ///< by how much events are later than an inertial sensor, as far as known
    bool doubtful = false;      ///< less than usual of what was seen matches: it may be farther off than stated
  };
  struct Correction {
    Vector6d moved;        ///< right perturbation of T_world_event to the most probable pose
    Matrix6d information;  ///< of the depth alone, on such a perturbation
    double widened;        ///< the variance of a pose that was false, by so much over what is stated; else 1
  };
  /// Depth poses in the order of their time. Empty where the two contradict each other, but for one that is confirmed
  /// and the third in a row that does so alike; and one that leaves a direction open, and so cannot replace a doubtful
  /// pose, corrects it in the others.
  std::optional<Correction> Correct(const DepthPose& depth, const Estimate& estimate);

  /// Whether depth has seen the camera move since this time, from which on it is thought to stand: between two images
  /// of then, which err alike, in the directions that both know. False until there are two.
  bool SawMotionSince(std::int64_t t_ns) const;

  /// Where the pose at `t_ns`, later than the last image that agreed, may be for all that this image says: information
  /// on a right perturbation [rho; phi] (m, rad) of it, in the directions that the image knows, less with each moment
  /// since. Zero before the first.
  Matrix6d BoundAt(std::int64_t t_ns) const;

  /// Of the last depth images in a row, those that leave a direction open not counted.
  int contradictions() const { return contradictions_; }
  /// The same, of those that contradicted, know all directions and were believed.
  int replacements() const { return replacements_; }
  std::int64_t found_ns() const { return found_ns_; }  ///< time of the last that agreed in all directions; 0: none has
  /// Whether that was less than `span_s` before this time.
  bool AgreedWithin(double span_s, std::int64_t t_ns) const;
  /// The same of the last that agreed in the directions that it knows, be it not all.
  bool AgreedInPartWithin(double span_s, std::int64_t t_ns) const;
  /// Whether the last two images are less than `period_s` apart in time.
  bool KnowsVelocity(double period_s) const;
  const Vector6d& velocity_event() const { return velocity_; }           ///< from the last two; 0: it is not known
  std::int64_t velocity_since_ns() const { return velocity_since_ns_; }  ///< time of the first of the two
  /// By how much later than a depth image's stamp events show its moment.
  const DepthDelay& delay() const { return delay_; }
  /// Squared errors of poses at this time over what is stated of them, by how events and depth come apart and, where an
  /// inertial sensor guides them, by how often depth comes, else by how long none has agreed.
  double VarianceScale(std::int64_t t_ns, bool guided) const;

  void Reset() { *this = DepthFusion(); }

 private:
  static constexpr double kUsualPeriod_s = 0.2;

  void NoteVelocity(const DepthPose& depth);
  /// `since_s`: since the last image that agreed.
  void NotePeriod(double since_s);
  /// `residual`: from the pose by events to that by depth, of this covariance as far as depth goes.
  void NoteContradiction(std::int64_t t_ns, bool contradicts, const Vector6d& residual, const Matrix6d& covariance);

  DepthDelay delay_;
  int contradictions_ = 0;
  int alike_in_a_row_ = 0;  // of these
  int replacements_ = 0;
  std::int64_t contradicted_ns_ = 0;
  Vector6d contradicted_ = Vector6d::Zero();  // residual of the last
  std::int64_t found_ns_ = 0;
  std::optional<DepthPose> last_, agreed_;  // agreed_: the last that did not contradict
  std::deque<DepthPose> past_;              // of the last moment
  Vector6d velocity_ = Vector6d::Zero();
  std::int64_t velocity_since_ns_ = 0;
  double period_s_ = kUsualPeriod_s;  // of images that agree, lately
  ErrorScale error_scale_;
};

}  // namespace devo
