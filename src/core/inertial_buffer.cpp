// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_buffer.h"

#include <algorithm>
#include <cmath>

#include "devo/core/inertial_fit.h"
#include "devo/core/rigid3.h"
#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kKept_s = 4.5;  // as far as a start from rest looks back
constexpr double kPushSpan_s = 1;

using Vector = Eigen::Matrix<double, 6, 1>;

Vector Reading(const ImuSample& sample) {
  Vector reading;
  reading << sample.angular_velocity, sample.linear_acceleration;
  return reading;
}

}  // namespace

void InertialBuffer::Add(const ImuSample& sample) {
  if (!IsReading(sample) || (!samples_.empty() && sample.t_ns <= samples_.back().t_ns)) return;
  samples_.push_back(sample);
  noise_.Add(sample);
  while (SecondsFromNs(sample.t_ns - samples_.front().t_ns) > kKept_s) samples_.pop_front();
}

std::int64_t InertialBuffer::HoldOf_ns(std::int64_t period_ns) {
  return std::clamp(period_ns + period_ns / 4, kLeastHold_ns, kMaxImuGap_ns);
}

std::int64_t InertialBuffer::Hold_ns() const {
  if (samples_.size() < 2) return kLeastHold_ns;
  return HoldOf_ns(samples_.back().t_ns - samples_[samples_.size() - 2].t_ns);
}

void InertialBuffer::Clear() {
  samples_.clear();
  noise_.Clear();
  used_ = true;
}

std::optional<std::int64_t> InertialBuffer::begin_ns() const {
  if (samples_.empty()) return std::nullopt;
  return samples_.front().t_ns;
}

std::optional<InertialMean> InertialBuffer::Mean(std::int64_t from_ns, std::int64_t to_ns) const {
  if (!used_ || IsTooNoisy(std::sqrt(noise().turn_rad2_s))) return std::nullopt;
  return MeanRead(from_ns, to_ns);
}

std::optional<InertialMean> InertialBuffer::MeanRead(std::int64_t from_ns, std::int64_t to_ns) const {
  if (samples_.empty() || to_ns <= from_ns || samples_.front().t_ns > from_ns ||
      samples_.back().t_ns + Hold_ns() < to_ns) {
    return std::nullopt;
  }
  // From the last sample that is not later than the span's begin.
  auto sample = std::upper_bound(samples_.begin(), samples_.end(), from_ns,
                                 [](std::int64_t t, const ImuSample& s) { return t < s.t_ns; }) -
                1;
  Vector sum = Vector::Zero();
  for (std::int64_t t_ns = from_ns; t_ns < to_ns; ++sample) {
    const auto next = sample + 1;
    if (next == samples_.end()) {
      sum += Reading(*sample) * SecondsFromNs(to_ns - t_ns);
      break;
    }
    if (next->t_ns - sample->t_ns > kMaxImuGap_ns) return std::nullopt;
    const std::int64_t until_ns = std::min(next->t_ns, to_ns);
    const double middle = SecondsFromNs((t_ns - sample->t_ns) + (until_ns - sample->t_ns)) /
                          (2 * SecondsFromNs(next->t_ns - sample->t_ns));
    sum += ((1 - middle) * Reading(*sample) + middle * Reading(*next)) * SecondsFromNs(until_ns - t_ns);
    t_ns = until_ns;
  }
  const Vector mean = sum / SecondsFromNs(to_ns - from_ns);
  InertialMean result{mean.head<3>(), std::nullopt, samples_.back().p_event_imu, noise()};
  if (mean.tail<3>().allFinite()) result.linear_acceleration = mean.tail<3>();
  return result;
}

std::optional<InertialBuffer::Push> InertialBuffer::MeanPush(std::int64_t t_ns) const {
  Eigen::Quaterniond q_end_now = Eigen::Quaterniond::Identity();
  Push push{Eigen::Vector3d::Zero(), 0};
  for (auto sample = samples_.rbegin(); sample != samples_.rend() && sample + 1 != samples_.rend(); ++sample) {
    const auto before = sample + 1;
    const double dt_s = SecondsFromNs(sample->t_ns - before->t_ns);
    if (sample->t_ns > t_ns) continue;
    if (push.span_s == 0 && t_ns - sample->t_ns > kMaxImuGap_ns) break;  // the sensor has fallen silent since
    if (dt_s > SecondsFromNs(kMaxImuGap_ns) || push.span_s > kPushSpan_s) break;
    const Eigen::Vector3d force = 0.5 * (sample->linear_acceleration + before->linear_acceleration);
    const Eigen::Vector3d turn = 0.5 * dt_s * (sample->angular_velocity + before->angular_velocity);
    if (!force.allFinite()) break;
    push.force += dt_s * (q_end_now * (ExpSO3(-0.5 * turn) * force));
    q_end_now = q_end_now * ExpSO3(-turn);
    push.span_s += dt_s;
  }
  if (push.span_s <= 0) return std::nullopt;
  push.force /= push.span_s;
  return push;
}

}  // namespace devo
