// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include <Eigen/Core>

#include "devo/core/imu.h"

namespace devo {

/// Gyroscope samples between two poses, and their bias, learnt from the poses. Not thread-safe.
class Gyroscope {
 public:
  /// Samples in the order of their time; one that is not newer than the last, or not finite, is left out.
  void Add(const ImuSample& sample);

  /// Mean angular velocity (rad/s, event frame) over (from_ns, to_ns], bias subtracted. Empty without samples there.
  std::optional<Eigen::Vector3d> Mean(std::int64_t from_ns, std::int64_t to_ns) const;

  /// Learns the bias from what the poses say the angular velocity was over the same time.
  void LearnBias(std::int64_t from_ns, std::int64_t to_ns, const Eigen::Vector3d& angular_velocity);

  /// Standard deviation of Mean, rad/s: falls as the bias becomes known.
  double sigma_rad_s() const;

  void Clear() { samples_.clear(); }

 private:
  std::deque<ImuSample> samples_;
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero();
  int learnt_ = 0;
};

}  // namespace devo
