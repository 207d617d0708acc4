// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace devo {

/// What an inertial sensor's calibration is found to lack. Vectors are in the event frame.
struct InertialCalibration {
  Eigen::Vector3d gyroscope_bias;      ///< rad/s
  Eigen::Vector3d gyroscope_scale;     ///< share that it reads too much about x, y, z
  Eigen::Vector3d accelerometer_bias;  ///< m/s^2
  double accelerometer_scale;          ///< share that it reads too much
  /// Rotation vector by which its readings are turned, rad: T_event_imu is right once that is turned back.
  Eigen::Vector3d rotation;
  Eigen::Vector3d translation_m;  ///< where it is, less where T_event_imu has it
};

}  // namespace devo
