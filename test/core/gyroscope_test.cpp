// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/gyroscope.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;
using Eigen::Vector3d;

ImuSample At(std::int64_t t_ns, const Vector3d& angular_velocity) { return {t_ns, angular_velocity, Vector3d::Zero()}; }

/// Samples at 1 kHz over the `count` milliseconds after `from_ns`.
void AddSteady(std::int64_t from_ns, int count, const Vector3d& angular_velocity, Gyroscope* gyroscope) {
  for (int k = 1; k <= count; ++k) gyroscope->Add(At(from_ns + k * kMs, angular_velocity));
}

/// A gyroscope of constant bias that has been compared with `poses` true velocities, 10 ms each.
Gyroscope Learnt(int poses, const Vector3d& bias) {
  Gyroscope gyroscope;
  for (int k = 0; k < poses; ++k) {
    const Vector3d truth(0.1 * (k % 7), -0.2 * (k % 3), 0.3);
    AddSteady(10 * k * kMs, 10, truth + bias, &gyroscope);
    gyroscope.LearnBias(10 * k * kMs, 10 * (k + 1) * kMs, truth);
  }
  return gyroscope;
}

/// What it says of no turning at all, long after.
Vector3d RemainingBias(Gyroscope gyroscope, const Vector3d& bias) {
  const std::int64_t later_ns = 1'000'000 * kMs;
  AddSteady(later_ns, 10, bias, &gyroscope);
  return *gyroscope.Mean(later_ns, later_ns + 10 * kMs);
}

TEST(Gyroscope, HasNoMeanWithoutSamplesInTheSpan) {
  Gyroscope gyroscope;
  EXPECT_FALSE(gyroscope.Mean(0, 10 * kMs));
  gyroscope.Add(At(20 * kMs, {1, 2, 3}));
  EXPECT_FALSE(gyroscope.Mean(0, 10 * kMs));
  EXPECT_FALSE(gyroscope.Mean(30 * kMs, 40 * kMs));
}

TEST(Gyroscope, AveragesTheSamplesAfterTheBeginUpToTheEndOfTheSpan) {
  Gyroscope gyroscope;
  for (int k = 0; k < 5; ++k) gyroscope.Add(At(k * kMs, {std::pow(2.0, k), 0, -1.0 * k}));
  EXPECT_LT((*gyroscope.Mean(kMs, 3 * kMs) - Vector3d(6, 0, -2.5)).norm(), 1e-12);
  EXPECT_LT((*gyroscope.Mean(kMs - 1, kMs) - Vector3d(2, 0, -1)).norm(), 1e-12);
}

TEST(Gyroscope, LeavesOutSamplesThatAreNotNewerOrNotFinite) {
  Gyroscope gyroscope;
  gyroscope.Add(At(2 * kMs, {1, 1, 1}));
  gyroscope.Add(At(2 * kMs, {9, 9, 9}));
  gyroscope.Add(At(1 * kMs, {9, 9, 9}));
  gyroscope.Add(At(3 * kMs, {9, std::numeric_limits<double>::quiet_NaN(), 9}));
  gyroscope.Add(At(4 * kMs, {9, 9, std::numeric_limits<double>::infinity()}));
  gyroscope.Add(At(5 * kMs, {3, 3, 3}));
  EXPECT_LT((*gyroscope.Mean(0, 10 * kMs) - Vector3d(2, 2, 2)).norm(), 1e-12);
}

TEST(Gyroscope, LearnsItsBiasFromPoses) {
  const Vector3d bias(0.03, -0.02, 0.01);
  EXPECT_LT((RemainingBias(Learnt(0, bias), bias) - bias).norm(), 1e-12);
  EXPECT_LT(RemainingBias(Learnt(20, bias), bias).norm(), 0.5 * bias.norm());
  EXPECT_LT(RemainingBias(Learnt(500, bias), bias).norm(), 0.03 * bias.norm());
}

TEST(Gyroscope, FollowsABiasThatDriftsAfterItWasLearntForLong) {
  Gyroscope gyroscope = Learnt(3000, {0.03, 0, 0});
  const Vector3d drifted(0, 0.02, 0);
  for (int k = 3000; k < 5000; ++k) {
    AddSteady(10 * k * kMs, 10, drifted, &gyroscope);
    gyroscope.LearnBias(10 * k * kMs, 10 * (k + 1) * kMs, Vector3d::Zero());
  }
  EXPECT_LT(RemainingBias(gyroscope, drifted).norm(), 0.001);
}

TEST(Gyroscope, StatesADeviationThatFallsWithEveryPoseAndCoversTheBiasOfAColdPart) {
  const Vector3d bias(0.05, -0.05, 0.05);
  double before = std::numeric_limits<double>::infinity();
  for (const int poses : {0, 1, 5, 20, 100, 500}) {
    const Gyroscope gyroscope = Learnt(poses, bias);
    EXPECT_LT(gyroscope.sigma_rad_s(), before) << poses << " poses";
    EXPECT_GE(gyroscope.sigma_rad_s(), RemainingBias(gyroscope, bias).cwiseAbs().maxCoeff()) << poses << " poses";
    before = gyroscope.sigma_rad_s();
  }
}

TEST(Gyroscope, LearnsNothingOfASpanWithoutSamples) {
  Gyroscope gyroscope = Learnt(20, {0.03, 0, 0});
  const double sigma_rad_s = gyroscope.sigma_rad_s();
  const Vector3d remaining = RemainingBias(gyroscope, {0.03, 0, 0});
  gyroscope.LearnBias(5000 * kMs, 5010 * kMs, {1, 1, 1});
  EXPECT_EQ(gyroscope.sigma_rad_s(), sigma_rad_s);
  EXPECT_EQ(RemainingBias(gyroscope, {0.03, 0, 0}), remaining);
}

TEST(Gyroscope, ForgetsItsSamplesWhenClearedButNotItsBias) {
  Gyroscope gyroscope = Learnt(500, {0.03, 0, 0});
  gyroscope.Clear();
  EXPECT_FALSE(gyroscope.Mean(0, 5000 * kMs));
  gyroscope.Add(At(1 * kMs, {0.03, 0, 0}));  // time may have gone back
  EXPECT_LT(gyroscope.Mean(0, 1 * kMs)->norm(), 0.001);
}

}  // namespace
}  // namespace devo
