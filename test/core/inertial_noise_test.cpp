// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_noise.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace devo {
namespace {

using Eigen::Vector3d;

struct Sensor {
  double rate_hz = 200;
  double turn_sigma = 0, push_sigma = 0;  ///< of each reading, rad/s and m/s^2
  double glitch_share = 0;                ///< of the readings that are far off
};

/// What a sensor reads in a hand that swings to and fro 3 times a second, by 1 rad/s and 5 m/s^2.
class SwungSensor {
 public:
  explicit SwungSensor(const Sensor& sensor) : sensor_(sensor) {}

  void Change(const Sensor& sensor) { sensor_ = sensor; }

  void Read(double seconds, InertialNoise* noise) {
    const int end = k_ + static_cast<int>(seconds * sensor_.rate_hz);
    for (; k_ < end; ++k_) noise->Add(At(k_ / sensor_.rate_hz));
  }

 private:
  ImuSample At(double t_s) {
    std::normal_distribution<double> normal;
    const auto noise = [&](double sigma) -> Vector3d {
      return Vector3d::NullaryExpr([&] { return sigma * normal(random_); });
    };
    const double phase = 2 * M_PI * 3 * t_s;
    ImuSample sample;
    sample.t_ns = std::llround(1e9 * t_s);
    sample.angular_velocity = Vector3d(std::sin(phase), std::cos(phase), 0) + noise(sensor_.turn_sigma);
    sample.linear_acceleration = Vector3d(5 * std::cos(phase), 0, 9.8) + noise(sensor_.push_sigma);
    if (std::uniform_real_distribution<double>()(random_) < sensor_.glitch_share) sample.angular_velocity.x() = 30;
    return sample;
  }

  Sensor sensor_;
  std::mt19937 random_{1};
  int k_ = 0;
};

InertialNoise::Density DensityOf(const Sensor& sensor, double seconds = 3) {
  InertialNoise noise;
  SwungSensor(sensor).Read(seconds, &noise);
  return noise.density();
}

TEST(InertialNoise, FindsTheNoiseOfASensorThatMovesAtAnyRate) {
  for (const double rate_hz : {100., 200., 250., 1000.}) {
    const auto density = DensityOf({rate_hz, 0.03, 0.5});
    EXPECT_NEAR(std::sqrt(density.turn_rad2_s * rate_hz), 0.03, 0.006) << rate_hz;
    EXPECT_NEAR(std::sqrt(density.push_m2_s3 * rate_hz), 0.5, 0.1) << rate_hz;
  }
}

TEST(InertialNoise, TakesAMotionForNoNoise) {
  const auto density = DensityOf({});
  EXPECT_LT(std::sqrt(density.turn_rad2_s / 0.01), 0.003) << "in rad/s of a mean over 10 ms, of 1 rad/s";
  EXPECT_LT(std::sqrt(density.push_m2_s3 / 0.01), 0.015) << "in m/s^2, of 5 m/s^2";
}

TEST(InertialNoise, TakesReadingsThatAreFarOffForNoNoise) {
  const Sensor sensor{200, 0.003, 0.03}, glitching{200, 0.003, 0.03, 0.01};
  EXPECT_LT(DensityOf(glitching).turn_rad2_s, 3 * DensityOf(sensor).turn_rad2_s);
}

TEST(InertialNoise, FollowsAVibrationThatBeginsAndEnds) {
  InertialNoise noise;
  SwungSensor sensor({200, 0.002, 0.03});
  sensor.Read(1, &noise);
  const double quiet = noise.density().turn_rad2_s;
  sensor.Change({200, 0.04, 0.5});
  sensor.Read(1, &noise);
  EXPECT_NEAR(std::sqrt(noise.density().turn_rad2_s * 200), 0.04, 0.012);
  sensor.Change({200, 0.002, 0.03});
  sensor.Read(1, &noise);
  EXPECT_LT(noise.density().turn_rad2_s, 2 * quiet);
}

TEST(InertialNoise, KnowsNothingOfAnAccelerometerThatThereIsNot) {
  InertialNoise noise;
  for (int k = 0; k < 100; ++k) {
    noise.Add({k * 5'000'000, Vector3d::Zero(), Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()), {}});
  }
  EXPECT_EQ(noise.density().push_m2_s3, 0);
  EXPECT_GT(noise.density().turn_rad2_s, 0);
}

TEST(InertialNoise, ComparesNothingAcrossAGap) {
  InertialNoise noise;
  const auto add = [&noise](int from_ms, const Vector3d& turn) {
    for (int ms = from_ms; ms < from_ms + 200; ms += 5) noise.Add({ms * 1'000'000, turn, {0, 0, 9.8}, {}});
  };
  add(0, {0, 0, 0});
  const double before = noise.density().turn_rad2_s;
  add(1000, {5, 0, 0});
  EXPECT_LE(noise.density().turn_rad2_s, before);
}

}  // namespace
}  // namespace devo
