// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>

#include <Eigen/Core>

namespace devo {

/// Longer than this from one sample to the next, some are missing: the slowest drivers have 50 Hz.
constexpr std::int64_t kMaxImuGap_ns = 50'000'000;

/// One sample of an inertial sensor.
struct ImuSample {
  std::int64_t t_ns = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< rad/s, event frame
  /// Specific force (at rest: against gravity), m/s^2, event frame; NaN where the sensor has no accelerometer.
  Eigen::Vector3d linear_acceleration = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_event_imu = Eigen::Vector3d::Zero();  ///< where the sensor is, m, event frame
};

/// Whether it can be a reading at all: an angular velocity of finite numbers, and neither it nor the acceleration far
/// beyond what any sensor measures, also in degrees or thousandths of g (memory that a driver never wrote looks so).
/// Numbers near the largest double would turn every pose after them into NaN.
inline bool IsReading(const ImuSample& sample) {
  constexpr double kMost_rad_s = 1e4, kMost_m_s2 = 1e5;
  const bool absurd =
      std::isfinite(sample.linear_acceleration.sum()) && sample.linear_acceleration.cwiseAbs().maxCoeff() > kMost_m_s2;
  return sample.angular_velocity.allFinite() && sample.angular_velocity.cwiseAbs().maxCoeff() < kMost_rad_s && !absurd;
}

}  // namespace devo
