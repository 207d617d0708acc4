// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace devo {

/// One sample of an inertial sensor.
struct ImuSample {
  std::int64_t t_ns = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();     ///< rad/s, event frame
  Eigen::Vector3d linear_acceleration = Eigen::Vector3d::Zero();  ///< m/s^2, event frame
};

}  // namespace devo
