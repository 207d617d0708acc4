// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_state.h"

namespace devo {

void MotionState::Correct(const Vector& by) {
  T_world_event = T_world_event * Exp(by.segment<6>(kRho));
  velocity += by.segment<6>(kV);
  acceleration += by.segment<6>(kA);
  shared_error += by.segment<6>(kSharedError);
  gravity_world += by.segment<3>(kGravity);
  gyroscope_bias += by.segment<3>(kGyroscopeBias);
  accelerometer_bias += by.segment<3>(kAccelerometerBias);
  gyroscope_error += Eigen::Map<const Eigen::Matrix3d>(by.data() + kGyroscopeError);
  lever_error_m += by.segment<3>(kLeverError);
  accelerometer_scale_error += by[kAccelerometerScale];
}

Eigen::Vector3d MotionState::MountingAngles() const {
  // The antisymmetric part.
  const Eigen::Matrix3d& M = gyroscope_error;
  return 0.5 * Eigen::Vector3d(M(2, 1) - M(1, 2), M(0, 2) - M(2, 0), M(1, 0) - M(0, 1));
}

Eigen::Matrix3d MotionState::Mounting() const { return ExpSO3(MountingAngles()).toRotationMatrix(); }

InertialCalibration MotionState::Calibration() const {
  return {gyroscope_bias, gyroscope_error.diagonal(), accelerometer_bias, accelerometer_scale_error, MountingAngles(),
          lever_error_m};
}

}  // namespace devo
