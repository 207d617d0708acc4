// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "devo/core/odometry.h"
#include "devo/core/pose_estimate.h"
#include "devo/io/evaluation.h"

namespace devo {

/// What one run of the odometry came to: gathers poses while it runs, then says how it went.
class RunReport {
 public:
  /// `rate_hz`: poses expected per second.
  explicit RunReport(double rate_hz) : rate_hz_(rate_hz) {}

  void AddPose(const PoseEstimate& estimate);

  /// Poses registered to the map, wholly or partly (not the initial ones, nor those extrapolated while lost).
  const Trajectory& trajectory() const { return trajectory_; }
  /// Of a right perturbation [rho; phi] (m, rad) of each of them.
  const std::vector<Matrix6d>& covariances() const { return covariances_; }

  struct Interval {
    std::int64_t begin_ns, end_ns;
  };
  const std::vector<Interval>& lost_intervals() const { return lost_; }

  /// Share of the ticks from the first reference to `end_ns` that have a pose in the trajectory, 0..1.
  double Coverage(std::int64_t end_ns) const;
  /// Seconds from the first event to the first pose; 0 where there is none.
  double FirstPoseAfter_s() const;

  /// Medians over the poses; all zero without an inertial sensor.
  InertialFit inertial_fit() const;

  /// Filled by the caller at the end.
  std::int64_t begin_ns = 0, end_ns = 0;  ///< first and last event
  double wall_s = 0, cpu_s = 0;
  double peak_memory_mb = 0;
  std::uint64_t depth_skipped_by_rate = 0, depth_unordered = 0;
  Odometry::Counters counters;
  Odometry::Timings timings;
  std::size_t map_points = 0;
  std::optional<Evaluation> evaluation;
  std::vector<std::string> warnings;
  std::string error;
  std::string configuration;  ///< Describe(config)

  /// Data seconds per second of wall time; above 1 is faster than real time.
  double RealTimeFactor() const;
  std::string ToJson() const;
  /// A few lines for a person.
  std::string Summary() const;

 private:
  double rate_hz_;
  Trajectory trajectory_;
  std::vector<Matrix6d> covariances_;
  int chapters_ = 0;
  SensorDelays delays_;                                      // of the last pose
  std::optional<InertialCalibration> inertial_calibration_;  // the same
  std::vector<InertialFit> inertial_fits_;                   // of each pose with readings
  std::vector<Interval> lost_;
  bool lost_now_ = false;
  std::optional<std::int64_t> first_reference_ns_;
  std::uint64_t poses_by_state_[5] = {};
};

/// The value below which a share `p` (0..1) of `values` lies (nearest rank); 0 when there are none.
double Percentile(std::vector<float> values, double p);

}  // namespace devo
