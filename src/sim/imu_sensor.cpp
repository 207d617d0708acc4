// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/imu_sensor.h"

#include <cmath>

namespace devo::sim {
namespace {

Eigen::Vector3d Gaussian3(Rng* rng) {
  const double x = rng->Gaussian(), y = rng->Gaussian(), z = rng->Gaussian();
  return {x, y, z};
}

/// What a turn adds to the acceleration at `p` of a body that turns, both in its frame: w' x p + w x (w x p).
Eigen::Vector3d FromLever(const Trajectory& trajectory, double t_s, const Eigen::Vector3d& p) {
  constexpr double kStep_s = 1e-3;
  const auto turn_at = [&](double at_s) -> Eigen::Vector3d { return trajectory.VelocityAt(at_s).tail<3>(); };
  const Eigen::Vector3d turn = turn_at(t_s);
  const Eigen::Vector3d change = (turn_at(t_s + kStep_s) - turn_at(t_s - kStep_s)) / (2 * kStep_s);
  return change.cross(p) + turn.cross(turn.cross(p));
}

}  // namespace

Rigid3 ImuInDavis() { return Rigid3(ExpSO3({0.011, -0.004, -0.015}), {-0.003, -0.008, -0.006}); }

Rigid3 ImuBesideVectorRegularCamera() {
  Eigen::Matrix3d R;
  R << 0.017248644, -0.999803714, 0.009747718, 0.012834636, -0.009526963, -0.999872246, 0.999768851, 0.017371549,
      0.012667790;
  return Rigid3(Eigen::Quaterniond(R).normalized(), {0.07733078, -0.01663789, -0.14481844});
}

ImuSensor::ImuSensor(const ImuModel& model, std::uint64_t seed) : model_(model), rng_(seed, 0x1a0) {
  gyroscope_bias_ = model_.gyroscope_bias * Gaussian3(&rng_);
  accelerometer_bias_ = model_.accelerometer_bias * Gaussian3(&rng_);
}

ImuSample ImuSensor::Measure(const Trajectory& trajectory, double t_s) {
  const Eigen::Vector3d gravity(0, 0, -model_.gravity);
  const Eigen::Quaterniond R_imu_event = model_.T_event_imu.rotation().conjugate();
  const Eigen::Vector3d turn = trajectory.VelocityAt(t_s).tail<3>();
  const Eigen::Vector3d force =
      trajectory.PoseAt(t_s).rotation().conjugate() * (trajectory.AccelerationAt(t_s) - gravity) +
      FromLever(trajectory, t_s, model_.T_event_imu.translation());
  // White noise of density n, sampled at rate f, has the deviation n sqrt(f); a walk of density w steps by w / sqrt(f).
  const double root = std::sqrt(model_.rate_hz);
  gyroscope_bias_ += model_.gyroscope_walk / root * Gaussian3(&rng_);
  accelerometer_bias_ += model_.accelerometer_walk / root * Gaussian3(&rng_);
  ImuSample sample;
  sample.angular_velocity = R_imu_event * turn + gyroscope_bias_ + model_.gyroscope_noise * root * Gaussian3(&rng_);
  sample.linear_acceleration =
      R_imu_event * force + accelerometer_bias_ + model_.accelerometer_noise * root * Gaussian3(&rng_);
  return sample;
}

}  // namespace devo::sim
