// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/imu_sensor.h"

#include <cmath>

namespace devo::sim {
namespace {

Eigen::Vector3d Gaussian3(Rng* rng) {
  const double x = rng->Gaussian(), y = rng->Gaussian(), z = rng->Gaussian();
  return {x, y, z};
}

}  // namespace

ImuSensor::ImuSensor(const ImuModel& model, std::uint64_t seed) : model_(model), rng_(seed, 0x1a0) {
  gyroscope_bias_ = model_.gyroscope_bias * Gaussian3(&rng_);
  accelerometer_bias_ = model_.accelerometer_bias * Gaussian3(&rng_);
}

ImuSample ImuSensor::Measure(const Trajectory& trajectory, double t_s) {
  const Eigen::Vector3d gravity(0, 0, -model_.gravity);
  const Eigen::Quaterniond R_event_world = trajectory.PoseAt(t_s).rotation().conjugate();
  // White noise of density n, sampled at rate f, has the deviation n sqrt(f); a walk of density w steps by w / sqrt(f).
  const double root = std::sqrt(model_.rate_hz);
  gyroscope_bias_ += model_.gyroscope_walk / root * Gaussian3(&rng_);
  accelerometer_bias_ += model_.accelerometer_walk / root * Gaussian3(&rng_);
  ImuSample sample;
  sample.angular_velocity =
      trajectory.VelocityAt(t_s).tail<3>() + gyroscope_bias_ + model_.gyroscope_noise * root * Gaussian3(&rng_);
  sample.linear_acceleration = R_event_world * (trajectory.AccelerationAt(t_s) - gravity) + accelerometer_bias_ +
                               model_.accelerometer_noise * root * Gaussian3(&rng_);
  return sample;
}

}  // namespace devo::sim
