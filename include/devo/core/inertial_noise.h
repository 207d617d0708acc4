// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <Eigen/Core>

#include "devo/core/imu.h"

namespace devo {

/// Noise of an inertial sensor, vibration included, from its readings alone: fourth differences of means over about
/// 10 ms, to which a motion adds next to nothing (a hundredth of a swing of 5 Hz). Not thread-safe.
class InertialNoise {
 public:
  /// Variances of a mean over one second, over the axes in the mean: that over dt has 1 / dt times as much, as white
  /// noise has. Zero where not known: before 50 ms, or without an accelerometer.
  struct Density {
    double turn_rad2_s = 0;  ///< (rad/s)^2 s
    double push_m2_s3 = 0;   ///< (m/s^2)^2 s
  };

  /// Samples in the order of their time. What comes after a gap begins a new row of differences.
  void Add(const ImuSample& sample);

  const Density& density() const { return density_; }

  void Clear() { *this = InertialNoise(); }

 private:
  using Vector = Eigen::Matrix<double, 6, 1>;
  static constexpr std::size_t kMeans = 5;  // that a fourth difference takes

  void EndMean(std::int64_t t_ns);
  void NoteDifference(double mean_s);

  std::int64_t begin_ns_ = 0, last_ns_ = 0;  // of the mean that is being made; of the last sample
  Vector sum_ = Vector::Zero();
  int count_ = 0;
  std::array<Vector, kMeans> means_ = {};  // the oldest first
  std::size_t have_ = 0;
  Density density_;
  double seen_s_ = 0;
};

}  // namespace devo
