// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/error_scale.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 33'000'000, kSecond_ns = 1'000'000'000;

Vector6d Constant(double value) { return Vector6d::Constant(value); }

/// After `span_s` of differences that are `sigma` of a Gaussian, each for itself, where `stated` is stated.
double ScaleAfter(double span_s, double sigma, const Matrix6d& stated, const Vector6d& offset = Vector6d::Zero(),
                  std::int64_t period_ns = kPeriod_ns) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0, sigma);
  ErrorScale scale;
  for (std::int64_t t_ns = 0; t_ns < static_cast<std::int64_t>(1e9 * span_s); t_ns += period_ns) {
    Vector6d apart = offset;
    for (int k = 0; k < 6; ++k) apart[k] += normal(random);
    scale.Note(t_ns, apart, stated);
  }
  return scale.variance_scale();
}

TEST(ErrorScale, SaysNothingNewBeforeTwoImagesAreHalfASecondApart) {
  EXPECT_EQ(ScaleAfter(0.5, 1, 1e-4 * Matrix6d::Identity()), ErrorScale().variance_scale());
  EXPECT_NE(ScaleAfter(0.6, 1, 1e-4 * Matrix6d::Identity()), ErrorScale().variance_scale());
}

TEST(ErrorScale, GrowsWithTheSquareOfTheErrors) {
  const Matrix6d stated = Matrix6d::Identity();
  const double once = ScaleAfter(10, 0.5, stated), twice = ScaleAfter(10, 1, stated);
  EXPECT_NEAR(twice / once, 4, 0.2);
  EXPECT_NEAR(ScaleAfter(10, 1, 4 * stated), once, 0.05 * once);
}

TEST(ErrorScale, DoesNotCountWhatIsWrongAlikeAllTheTime) {
  const Matrix6d stated = Matrix6d::Identity();
  EXPECT_NEAR(ScaleAfter(10, 0.5, stated, Constant(20)), ScaleAfter(10, 0.5, stated), 1e-9);
}

TEST(ErrorScale, KnowsAsMuchFromOneImagePerSecondAsFromThirty) {
  const Matrix6d stated = Matrix6d::Identity();
  const double often = ScaleAfter(30, 0.7, stated), seldom = ScaleAfter(30, 0.7, stated, Constant(0), kSecond_ns);
  // Three images in memory are few.
  EXPECT_GT(seldom, 0.4 * often);
  EXPECT_LT(seldom, 1.6 * often);
}

TEST(ErrorScale, StaysBoundedWhateverCameBefore) {
  const double wide = ScaleAfter(5, 1e6, Matrix6d::Identity()), narrow = ScaleAfter(30, 0, Matrix6d::Identity());
  EXPECT_TRUE(std::isfinite(wide) && wide < 100) << wide;
  EXPECT_GT(narrow, 0.01);
}

}  // namespace
}  // namespace devo
