// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_measurement.h"

#include <functional>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr double kStep_s = 0.01;

Vector6d Twist(double scale) {
  Vector6d twist;
  twist << 0.4, -0.2, 0.1, 0.3, -0.5, 0.2;
  return scale * twist;
}

/// In motion, with every error that a sensor may have.
MotionState Before() {
  MotionState state;
  state.T_world_event = Exp(Twist(1));
  state.velocity = Twist(-2);
  state.acceleration = Twist(5);
  state.gravity_world = {1, 9.6, -1.5};
  state.gyroscope_bias = {0.02, -0.01, 0.03};
  state.accelerometer_bias = {-0.2, 0.1, 0.3};
  state.gyroscope_error << 0.01, 0.02, -0.01, -0.015, 0.02, 0.03, 0.02, -0.02, -0.01;
  state.lever_error_m = {0.02, -0.01, 0.03};
  state.accelerometer_scale_error = 0.02;
  return state;
}

MotionState After() {
  MotionState state = Before();
  state.T_world_event = state.T_world_event * Exp(Twist(-0.02));
  state.velocity += Twist(0.06);
  return state;
}

InertialMean Read() { return {{-0.5, 1.1, -0.3}, Eigen::Vector3d(2, -9, 1), {0.05, -0.02, 0.1}}; }

using Measure = std::function<InertialMeasurement(const InertialMean&, const MotionState&, const MotionState&, double)>;

/// Largest difference between the analytic derivative of what the states say and the numeric one of the residual, over
/// the columns [from, to). `after`: by the state after the step, else by that before it.
double WorstColumn(const Measure& measure, bool after, int from, int to) {
  constexpr double kStep = 1e-6;
  const InertialMeasurement at = measure(Read(), Before(), After(), kStep_s);
  double worst = 0;
  for (int i = from; i < to; ++i) {
    const auto residual = [&](double step) {
      MotionState now = After(), then = Before();
      (after ? now : then).Correct(step * MotionState::Vector::Unit(i));
      return measure(Read(), then, now, kStep_s).residual;
    };
    const Eigen::Vector3d numeric = -(residual(kStep) - residual(-kStep)) / (2 * kStep);
    worst = std::max(worst, ((after ? at.H_after : at.H_before).col(i) - numeric).norm());
  }
  return worst;
}

constexpr int kPose = MotionState::kRho, kEnd = MotionState::kSize;

// The linearisation leaves out how far a small turn is not a vector (a hundredth here) and how biases turn the frame of
// a step's middle.
TEST(InertialMeasurement, HasTheDerivativeOfATurnByTheStateAfterIt) {
  EXPECT_LT(WorstColumn(MeasuredTurn, true, kPose, MotionState::kDelay), 0.015);
  EXPECT_LT(WorstColumn(MeasuredTurn, true, MotionState::kGyroscopeError, kEnd), 1e-9);
}

TEST(InertialMeasurement, HasTheDerivativeOfATurnByTheStateBeforeIt) {
  EXPECT_LT(WorstColumn(MeasuredTurn, false, kPose, MotionState::kChanging), 0.015);
}

TEST(InertialMeasurement, HasTheDerivativeOfAPushByTheStateAfterIt) {
  EXPECT_LT(WorstColumn(MeasuredPush, true, kPose, MotionState::kGyroscopeBias), 1e-8);
  EXPECT_LT(WorstColumn(MeasuredPush, true, MotionState::kGyroscopeBias, MotionState::kAccelerometerBias), 0.01);
  EXPECT_LT(WorstColumn(MeasuredPush, true, MotionState::kAccelerometerBias, MotionState::kDelay), 1e-8);
  EXPECT_LT(WorstColumn(MeasuredPush, true, MotionState::kGyroscopeError, MotionState::kLeverError), 0.003);
  EXPECT_LT(WorstColumn(MeasuredPush, true, MotionState::kLeverError, kEnd), 1e-8);
}

TEST(InertialMeasurement, HasTheDerivativeOfAPushByTheStateBeforeIt) {
  EXPECT_LT(WorstColumn(MeasuredPush, false, kPose, MotionState::kChanging), 1e-6);
}

TEST(InertialMeasurement, SaysNothingOfAStateThatExplainsWhatWasRead) {
  const MotionState before = Before(), after = After();
  InertialMean read = Read();
  read.angular_velocity -= MeasuredTurn(read, before, after, kStep_s).residual / kStep_s;
  *read.linear_acceleration -= MeasuredPush(read, before, after, kStep_s).residual / kStep_s;
  EXPECT_LT(MeasuredTurn(read, before, after, kStep_s).residual.norm(), 1e-12);
  EXPECT_LT(MeasuredPush(read, before, after, kStep_s).residual.norm(), 1e-12);
}

TEST(MotionState, TakesTheMountingFromHowTheGyroscopeIsAskew) {
  MotionState state;
  const Eigen::Vector3d askew(0.01, -0.02, 0.015);
  state.gyroscope_error = Hat(askew);
  state.gyroscope_error.diagonal().setConstant(0.03);
  EXPECT_LT((state.Mounting() - ExpSO3(askew).toRotationMatrix()).norm(), 1e-12);
  EXPECT_LT((state.Calibration().rotation - askew).norm(), 1e-12);
  EXPECT_LT((state.Calibration().gyroscope_scale - Eigen::Vector3d::Constant(0.03)).norm(), 1e-12);
}

}  // namespace
}  // namespace devo
