// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_noise.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kMean_ns = 9'500'000;  // two samples at 200 Hz, whose stamps may shake
// Sum of the squares of 1, -4, 6, -4, 1.
constexpr double kSquareOfDifference = 70;
constexpr double kForget_s = 0.3;
// A mean of logarithms, as blows and bits that flip are no noise, however large: one difference moves it by so much of
// this at most.
constexpr double kMostApart = 3;
// By how much the logarithm of the mean of three squares lies below that of their variance, on average.
constexpr double kMeanLog = -0.37;
// Of a good sensor, which is what one is taken for until it shows: 0.006 deg/s/sqrt(Hz), 0.1 mg/sqrt(Hz).
constexpr double kLeastTurn_rad2_s = 1e-8, kLeastPush_m2_s3 = 1e-6;

/// Towards the variance that `square` is a sample of.
void Follow(double square, double share, double least, double* variance) {
  if (!std::isfinite(square)) return;
  *variance = std::max(*variance, least);
  const double apart = std::log(std::max(square, least) / *variance) - kMeanLog;
  *variance *= std::exp(share * std::clamp(apart, -kMostApart, kMostApart));
}

}  // namespace

void InertialNoise::Add(const ImuSample& sample) {
  if (sample.t_ns - last_ns_ > kMaxImuGap_ns) {
    have_ = 0;
    count_ = 0;
  } else if (count_ > 0 && sample.t_ns - begin_ns_ >= kMean_ns) {
    EndMean(sample.t_ns);
  }
  if (count_ == 0) {
    begin_ns_ = sample.t_ns;
    sum_.setZero();
  }
  sum_.head<3>() += sample.angular_velocity;
  sum_.tail<3>() += sample.linear_acceleration;
  ++count_;
  last_ns_ = sample.t_ns;
}

void InertialNoise::EndMean(std::int64_t t_ns) {
  std::rotate(means_.begin(), means_.begin() + 1, means_.end());
  means_.back() = sum_ / count_;
  count_ = 0;
  have_ = std::min(have_ + 1, kMeans);
  if (have_ == kMeans) NoteDifference(SecondsFromNs(t_ns - begin_ns_));
}

void InertialNoise::NoteDifference(double mean_s) {
  const Vector difference = means_[0] - 4 * means_[1] + 6 * means_[2] - 4 * means_[3] + means_[4];
  seen_s_ = std::min(seen_s_ + mean_s, kForget_s);
  const double share = std::min(1.0, mean_s / seen_s_), per_density = mean_s / (3 * kSquareOfDifference);
  Follow(per_density * difference.head<3>().squaredNorm(), share, kLeastTurn_rad2_s, &density_.turn_rad2_s);
  Follow(per_density * difference.tail<3>().squaredNorm(), share, kLeastPush_m2_s3, &density_.push_m2_s3);
}

}  // namespace devo
