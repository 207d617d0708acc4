// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/gyroscope.h"

#include <algorithm>

namespace devo {
namespace {

constexpr std::size_t kMaxSamples = 4000;  // 2.5 s of the fastest drivers
// Consumer parts: bias up to a degree per second when cold, noise of 0.01 deg/s/sqrt(Hz), and a mounting known to a
// degree.
constexpr double kColdBias_rad_s = 0.05, kWarmSigma_rad_s = 0.01;
constexpr int kForgetPoses = 500;

}  // namespace

void Gyroscope::Add(const ImuSample& sample) {
  if (!sample.angular_velocity.allFinite() || (!samples_.empty() && sample.t_ns <= samples_.back().t_ns)) return;
  samples_.push_back(sample);
  if (samples_.size() > kMaxSamples) samples_.pop_front();
}

std::optional<Eigen::Vector3d> Gyroscope::Mean(std::int64_t from_ns, std::int64_t to_ns) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  int count = 0;
  for (auto sample = samples_.rbegin(); sample != samples_.rend() && sample->t_ns > from_ns; ++sample) {
    if (sample->t_ns > to_ns) continue;
    sum += sample->angular_velocity;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return Eigen::Vector3d(sum / count - bias_);
}

void Gyroscope::LearnBias(std::int64_t from_ns, std::int64_t to_ns, const Eigen::Vector3d& angular_velocity) {
  const auto mean = Mean(from_ns, to_ns);
  if (!mean) return;
  learnt_ = std::min(learnt_ + 1, kForgetPoses);
  bias_ += (*mean - angular_velocity) / (learnt_ + 10);
}

double Gyroscope::sigma_rad_s() const { return kWarmSigma_rad_s + kColdBias_rad_s / (1 + 0.1 * learnt_); }

}  // namespace devo
