// SPDX-License-Identifier: BSD-3-Clause
//
// What an inertial sensor's mean reading over a step says of the motion before and after it.
#pragma once

#include <Eigen/Core>

#include "devo/core/inertial_buffer.h"
#include "devo/core/motion_state.h"

namespace devo {

/// Depends on the state before a step and after it.
struct InertialMeasurement {
  using Jacobian = Eigen::Matrix<double, 3, MotionState::kSize>;
  Eigen::Vector3d residual;              ///< what was read, less what the states say, times the step's duration
  Jacobian H_before = Jacobian::Zero();  ///< of what the states say by a correction of that before the step
  /// By a correction of that after it: in this are also what does not change meanwhile (biases and the like).
  Jacobian H_after = Jacobian::Zero();
};

/// Turned angle, rad: read = (I + gyroscope_error) turned + gyroscope_bias dt. For small turns between the states. By
/// the delay: as the states' angular acceleration has it.
InertialMeasurement MeasuredTurn(const InertialMean& read, const MotionState& before, const MotionState& after,
                                 double dt_s);

/// Change of velocity, m/s, in the frame of the span's middle: read = (1 + scale error) mounting (change of the
/// sensor's velocity - gravity dt) + accelerometer_bias dt. Needs read.linear_acceleration.
InertialMeasurement MeasuredPush(const InertialMean& read, const MotionState& before, const MotionState& after,
                                 double dt_s);

}  // namespace devo
