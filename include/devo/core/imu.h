// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace devo {

/// One sample of an inertial sensor.
struct ImuSample {
  std::int64_t t_ns = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< rad/s, event frame
  /// Specific force (at rest: against gravity), m/s^2, event frame; NaN where the sensor has no accelerometer.
  Eigen::Vector3d linear_acceleration = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_event_imu = Eigen::Vector3d::Zero();  ///< where the sensor is, m, event frame
};

}  // namespace devo
