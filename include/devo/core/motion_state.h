// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "devo/core/inertial_calibration.h"
#include "devo/core/rigid3.h"

namespace devo {

/// What the motion filter estimates, with the place of each in its covariance.
struct MotionState {
  static constexpr int kRho = 0, kPhi = 3, kV = 6, kOmega = 9, kA = 12, kSharedError = 18, kGravity = 24,
                       kGyroscopeBias = 27, kAccelerometerBias = 30, kDelay = 33, kGyroscopeError = 34,
                       kLeverError = 43, kAccelerometerScale = 46, kSize = 47;
  static constexpr int kChanging = 24;  ///< time changes the first ones, the others stay what they are
  using Vector = Eigen::Matrix<double, kSize, 1>;

  Rigid3 T_world_event;                      ///< corrected on the right, by [rho; phi]
  Vector6d velocity = Vector6d::Zero();      ///< [v; omega] of and in the event frame, m/s and rad/s
  Vector6d acceleration = Vector6d::Zero();  ///< its change, m/s^2 and rad/s^2
  Vector6d shared_error = Vector6d::Zero();  ///< right perturbation from the pose to where alignments find it
  Eigen::Vector3d gravity_world = Eigen::Vector3d::Zero();       ///< m/s^2; zero: not known
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();      ///< rad/s, event frame
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< m/s^2, event frame
  /// Of the turn, rad/s^2, as it was over the last hundredths of a second where the gyroscope is noisy: what a delay is
  /// told by. The acceleration itself follows that noise, which poses then correct: together that would seem a delay.
  Eigen::Vector3d steady_turn_acceleration = Eigen::Vector3d::Zero();
  double delay_s = 0;  ///< by how much later than the inertial sensor's stamps events show the same motion
  /// What the gyroscope reads beside its bias, over the turning rate, less identity: scale, mounting and cross axes.
  Eigen::Matrix3d gyroscope_error = Eigen::Matrix3d::Zero();
  /// Where the inertial sensor is, less where it is said to be, event frame.
  Eigen::Vector3d lever_error_m = Eigen::Vector3d::Zero();
  double accelerometer_scale_error = 0;  ///< share that it reads too much

  void StopSpeedingUp() {
    acceleration.setZero();
    steady_turn_acceleration.setZero();
  }

  /// All but the delay, which is bounded and told by poses only.
  void Correct(const Vector& by);

  /// From the event frame to the accelerometer's, by the angle that the gyroscope is seen to be mounted askew: both are
  /// one part.
  Eigen::Matrix3d Mounting() const;

  InertialCalibration Calibration() const;

 private:
  Eigen::Vector3d MountingAngles() const;  // rotation vector
};

}  // namespace devo
