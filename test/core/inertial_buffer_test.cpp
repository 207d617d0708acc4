// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_buffer.h"

#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "devo/core/rigid3.h"

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;
using Eigen::Vector3d;

ImuSample At(std::int64_t t_ns, const Vector3d& angular_velocity, const Vector3d& acceleration = {0, 0, 9.8}) {
  return {t_ns, angular_velocity, acceleration, {0.1, 0, 0}};
}

/// Samples every 5 ms from 0 to 100 ms that grow evenly: 1 rad/s and 10 m/s^2 in a second.
InertialBuffer Growing() {
  InertialBuffer buffer;
  for (int ms = 0; ms <= 100; ms += 5) buffer.Add(At(ms * kMs, {1e-3 * ms, 0, 0}, {0, 1e-2 * ms, 0}));
  return buffer;
}

TEST(InertialBuffer, LeavesOutWhatIsNoReading) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto empty_with = [](const Vector3d& angular_velocity, const Vector3d& acceleration) {
    InertialBuffer buffer;
    buffer.Add(At(0, angular_velocity, acceleration));
    return !buffer.begin_ns();
  };
  EXPECT_TRUE(empty_with({nan, 0, 0}, {0, 0, 9.8}));
  EXPECT_TRUE(empty_with({0, 0, 0}, {0, 1e300, 0}));
  EXPECT_TRUE(empty_with({0, -1e20, 0}, {0, 0, 9.8}));
  EXPECT_FALSE(empty_with({4000, 0, 0}, {0, 0, 16000})) << "degrees and thousandths of g are told by their fit";
  EXPECT_FALSE(empty_with({1, 0, 0}, {nan, nan, nan})) << "no accelerometer";
}

TEST(InertialBuffer, HasNoMeanOfASpanThatItsSamplesLeaveOpen) {
  EXPECT_FALSE(InertialBuffer().Mean(0, 10 * kMs));
  const InertialBuffer buffer = Growing();
  EXPECT_FALSE(buffer.Mean(-1, 10 * kMs));
  EXPECT_FALSE(buffer.Mean(90 * kMs, 120 * kMs));
  EXPECT_FALSE(buffer.Mean(10 * kMs, 10 * kMs));
}

TEST(InertialBuffer, AveragesOverTheSpanItselfWhereverTheSamplesLie) {
  const InertialBuffer buffer = Growing();
  for (const auto& [from_ms, to_ms] : {std::make_pair(10, 20), {11, 13}, {12, 27}, {0, 100}}) {
    const auto mean = buffer.Mean(from_ms * kMs, to_ms * kMs);
    ASSERT_TRUE(mean);
    EXPECT_NEAR(mean->angular_velocity.x(), 1e-3 * 0.5 * (from_ms + to_ms), 1e-9) << from_ms << " " << to_ms;
    EXPECT_NEAR(mean->linear_acceleration->y(), 1e-2 * 0.5 * (from_ms + to_ms), 1e-9) << from_ms << " " << to_ms;
    EXPECT_EQ(mean->p_event_imu, Vector3d(0.1, 0, 0));
  }
}

TEST(InertialBuffer, HoldsTheLastSampleForAMoment) {
  const auto mean = Growing().Mean(95 * kMs, 110 * kMs);
  ASSERT_TRUE(mean);
  EXPECT_NEAR(mean->angular_velocity.x(), (5 * 0.0975 + 10 * 0.1) / 15, 1e-9);
}

TEST(InertialBuffer, HoldsTheLastSampleOfASlowSensorUntilTheNextIsDue) {
  InertialBuffer buffer;
  for (int ms = 0; ms <= 100; ms += 20) buffer.Add(At(ms * kMs, {1, 0, 0}));
  EXPECT_TRUE(buffer.Mean(95 * kMs, 124 * kMs));
  EXPECT_FALSE(buffer.Mean(95 * kMs, 126 * kMs)) << "it is missing";
}

TEST(InertialBuffer, ReachesAsFarBackHoweverFastTheSensorIs) {
  for (const std::int64_t period_us : {500, 5000}) {
    InertialBuffer buffer;
    for (std::int64_t t_us = 0; t_us <= 6'000'000; t_us += period_us) buffer.Add(At(1000 * t_us, {1, 0, 0}));
    EXPECT_TRUE(buffer.Mean(1600 * kMs, 6000 * kMs)) << period_us;
  }
}

TEST(InertialBuffer, TurnsThePushOfTheLastSecondIntoTheFrameOfItsEnd) {
  // Two seconds of turning about x by 1 rad/s under gravity: in the end only gravity is left, not its circle.
  const Vector3d turn(1, 0, 0);
  const auto force = [&](int ms) -> Vector3d { return ExpSO3(-1e-3 * ms * turn) * Vector3d(0, 0, 9.8); };
  InertialBuffer buffer;
  EXPECT_FALSE(buffer.MeanPush(2000 * kMs));
  for (int ms = 0; ms <= 2500; ms += 5) buffer.Add(At(ms * kMs, turn, force(ms)));
  const auto push = buffer.MeanPush(2000 * kMs);
  ASSERT_TRUE(push);
  EXPECT_NEAR(push->span_s, 1, 0.02);
  EXPECT_LT((push->force - force(2000)).norm(), 0.02);
}

TEST(InertialBuffer, HasNoPushOfASensorThatHasFallenSilent) {
  InertialBuffer buffer;
  for (int ms = 0; ms <= 1000; ms += 5) buffer.Add(At(ms * kMs, Vector3d::Zero()));
  EXPECT_TRUE(buffer.MeanPush(1040 * kMs));
  EXPECT_FALSE(buffer.MeanPush(30'000 * kMs));
}

TEST(InertialBuffer, HasNoMeanAcrossAGap) {
  InertialBuffer buffer;
  buffer.Add(At(0, {1, 0, 0}));
  buffer.Add(At(200 * kMs, {1, 0, 0}));
  EXPECT_FALSE(buffer.Mean(10 * kMs, 20 * kMs));
}

TEST(InertialBuffer, HasNoMeanWhileItsSamplesAreTooNoisyToBeOfUse) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  InertialBuffer buffer;
  std::int64_t t_ns = 0;
  const auto has_mean_after = [&](double sigma_rad_s) {
    for (int k = 0; k < 600; ++k) {
      t_ns += 5 * kMs;
      buffer.Add(At(t_ns, sigma_rad_s * Vector3d(normal(random), normal(random), normal(random))));
    }
    return buffer.Mean(t_ns - 10 * kMs, t_ns).has_value();
  };
  // At 200 Hz: 0.07, 0.2 and again 0.07 deg/s/sqrt(Hz).
  EXPECT_TRUE(has_mean_after(0.017));
  EXPECT_FALSE(has_mean_after(0.05));
  EXPECT_TRUE(has_mean_after(0.017));
}

TEST(InertialBuffer, HasNoMeanOfASensorThatIsNotToBeUsedButOfWhatItRead) {
  InertialBuffer buffer = Growing();
  buffer.SetUsed(false);
  EXPECT_FALSE(buffer.Mean(10 * kMs, 20 * kMs));
  EXPECT_TRUE(buffer.MeanRead(10 * kMs, 20 * kMs));
  buffer.Clear();
  EXPECT_TRUE(buffer.used());
}

TEST(InertialBuffer, LeavesOutSamplesThatAreNotNewerOrNotFinite) {
  InertialBuffer buffer;
  buffer.Add(At(0, {1, 1, 1}));
  buffer.Add(At(0, {9, 9, 9}));
  buffer.Add(At(-1 * kMs, {9, 9, 9}));
  buffer.Add(At(3 * kMs, {9, std::numeric_limits<double>::quiet_NaN(), 9}));
  buffer.Add(At(5 * kMs, {3, 3, 3}));
  EXPECT_LT((buffer.Mean(0, 5 * kMs)->angular_velocity - Vector3d(2, 2, 2)).norm(), 1e-12);
}

TEST(InertialBuffer, HasNoAccelerationOfASensorWithoutAnAccelerometer) {
  InertialBuffer buffer;
  const Vector3d none = Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  buffer.Add(At(0, {1, 0, 0}, none));
  buffer.Add(At(5 * kMs, {1, 0, 0}, none));
  ASSERT_TRUE(buffer.Mean(0, 5 * kMs));
  EXPECT_FALSE(buffer.Mean(0, 5 * kMs)->linear_acceleration);
}

TEST(InertialBuffer, ForgetsItsSamplesWhenCleared) {
  InertialBuffer buffer = Growing();
  buffer.Clear();
  EXPECT_FALSE(buffer.Mean(0, 10 * kMs));
  buffer.Add(At(0, {1, 0, 0}));  // time may have gone back
  EXPECT_TRUE(buffer.Mean(0, 1 * kMs));
}

}  // namespace
}  // namespace devo
