// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_measurement.h"

namespace devo {
namespace {

using State = MotionState;

}  // namespace

InertialMeasurement MeasuredTurn(const InertialMean& read, const MotionState& before, const MotionState& after,
                                 double dt_s) {
  InertialMeasurement m;
  const Eigen::Vector3d turned = LogSO3(before.T_world_event.rotation().conjugate() * after.T_world_event.rotation());
  const Eigen::Matrix3d scale = Eigen::Matrix3d::Identity() + after.gyroscope_error;
  m.residual = read.angular_velocity * dt_s - (scale * turned + after.gyroscope_bias * dt_s);
  m.H_after.middleCols<3>(State::kPhi) = scale;
  m.H_after.middleCols<3>(State::kGyroscopeBias) = dt_s * Eigen::Matrix3d::Identity();
  for (int j = 0; j < 3; ++j) {
    m.H_after.middleCols<3>(State::kGyroscopeError + 3 * j) = turned[j] * Eigen::Matrix3d::Identity();
  }
  m.H_after.col(State::kDelay) = dt_s * before.steady_turn_acceleration;
  m.H_before.middleCols<3>(State::kPhi) = -scale * ExpSO3(-turned).toRotationMatrix();
  return m;
}

InertialMeasurement MeasuredPush(const InertialMean& read, const MotionState& before, const MotionState& after,
                                 double dt_s) {
  // Velocities of the sensor in the world, and the frame of the span's middle, in which the mean was taken.
  const Eigen::Vector3d r = read.p_event_imu + after.lever_error_m;
  const Eigen::Vector3d v = after.velocity.head<3>() + after.velocity.tail<3>().cross(r);
  const Eigen::Vector3d v_before = before.velocity.head<3>() + before.velocity.tail<3>().cross(r);
  const Eigen::Vector3d half = 0.5 * dt_s * (read.angular_velocity - after.gyroscope_bias);
  const Eigen::Matrix3d R = after.T_world_event.rotation().toRotationMatrix();
  const Eigen::Matrix3d R_before = before.T_world_event.rotation().toRotationMatrix();
  const Eigen::Matrix3d R_middle = R_before * ExpSO3(half).toRotationMatrix();
  const Eigen::Matrix3d A = R_middle.transpose() * R, R_middle_before = R_middle.transpose() * R_before;
  const Eigen::Vector3d pushed = R_middle.transpose() * (R * v - R_before * v_before - after.gravity_world * dt_s);
  const Eigen::Matrix3d askew = after.Mounting(), mounting = (1 + after.accelerometer_scale_error) * askew;

  InertialMeasurement m;
  m.residual = *read.linear_acceleration * dt_s - (mounting * pushed + after.accelerometer_bias * dt_s);
  m.H_after.middleCols<3>(State::kPhi) = -A * Hat(v);
  m.H_after.middleCols<3>(State::kV) = A;
  m.H_after.middleCols<3>(State::kOmega) = -A * Hat(r);
  m.H_after.middleCols<3>(State::kGravity) = -dt_s * R_middle.transpose();
  m.H_after.middleCols<3>(State::kLeverError) =
      A * Hat(after.velocity.tail<3>()) - R_middle_before * Hat(before.velocity.tail<3>());
  m.H_after = (mounting * m.H_after).eval();
  m.H_after.middleCols<3>(State::kAccelerometerBias) = dt_s * Eigen::Matrix3d::Identity();
  for (int j = 0; j < 3; ++j) {
    // How the mounting follows from a column of the gyroscope's error.
    const Eigen::Matrix3d by_column = 0.5 * Hat(Eigen::Vector3d::Unit(j));
    m.H_after.middleCols<3>(State::kGyroscopeError + 3 * j) = -Hat(mounting * pushed) * by_column;
  }
  m.H_after.col(State::kAccelerometerScale) = askew * pushed;
  m.H_before.middleCols<3>(State::kPhi) = R_middle_before * Hat(v_before) + Hat(pushed) * R_middle_before;
  m.H_before.middleCols<3>(State::kV) = -R_middle_before;
  m.H_before.middleCols<3>(State::kOmega) = R_middle_before * Hat(r);
  m.H_before = (mounting * m.H_before).eval();
  return m;
}

}  // namespace devo
