// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "devo/core/odometry.h"
#include "devo/core/rigid3.h"
#include "devo/sim/random.h"
#include "devo/sim/trajectory.h"

namespace devo::sim {

/// Place and noise of an inertial sensor. Defaults: Bosch BMI160 (data sheet BST-BMI160-DS000:
/// 0.007 deg/s/sqrt(Hz), 180 ug/sqrt(Hz)); bias walks as Kalibr users measure for it.
struct ImuModel {
  Rigid3 T_event_imu;  ///< samples are in the frame `imu`
  double rate_hz = 200;
  double gyroscope_noise = 1.22e-4;      ///< rad/s/sqrt(Hz)
  double accelerometer_noise = 1.77e-3;  ///< m/s^2/sqrt(Hz)
  double gyroscope_walk = 2e-5;          ///< rad/s^2/sqrt(Hz)
  double accelerometer_walk = 5e-4;      ///< m/s^3/sqrt(Hz)
  double gyroscope_bias = 5e-3;          ///< standard deviation of the first bias, rad/s
  double accelerometer_bias = 0.1;       ///< m/s^2
  double gravity = 9.81;                 ///< along world -z
};

/// Where a DAVIS346 has its IMU: on the board behind the lens, its axes nearly the camera's (MVSEC's drivers turn them
/// so).
Rigid3 ImuInDavis();

/// Where VECtor's XSens sits beside its left regular camera (the published small-scale camera-IMU extrinsics): x
/// forward, y left, z up. T_camera_imu.
Rigid3 ImuBesideVectorRegularCamera();

class ImuSensor {
 public:
  ImuSensor(const ImuModel& model, std::uint64_t seed);
  const ImuModel& model() const { return model_; }
  /// The sample at a time of the trajectory; call in the order of time, once per period. t_ns is not set.
  ImuSample Measure(const Trajectory& trajectory, double t_s);

 private:
  ImuModel model_;
  Rng rng_;
  Eigen::Vector3d gyroscope_bias_, accelerometer_bias_;
};

}  // namespace devo::sim
