// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/rest_detector.h"

#include <algorithm>

#include "devo/core/time.h"

namespace devo {
namespace {

// Beyond the noise of consumer parts, averaged over the span of a surface.
constexpr double kSteady_rad_s = 0.03, kSteady_m_s2 = 0.3;
constexpr double kLeast_s = 0.15;
// The first events of a motion come after it began.
constexpr std::int64_t kLate_ns = 100'000'000;
constexpr std::int64_t kStep_ns = 10'000'000;
constexpr std::int64_t kMaxLatency_ns = 100'000'000;     // of readings
constexpr std::int64_t kLongestSpan_ns = 3'000'000'000;  // looked back over

}  // namespace

void RestDetector::Clear() { *this = RestDetector(); }

void RestDetector::Start(std::int64_t t_ns) {
  Clear();
  t_ns_ = t_ns;
  started_ = true;
}

void RestDetector::NoteUntil(std::int64_t t_ns, bool quiet, const InertialBuffer& readings) {
  if (!started_ || t_ns - t_ns_ > kLongestSpan_ns) {
    const auto begin_ns = readings.begin_ns();
    Start(quiet && begin_ns ? std::max(*begin_ns, t_ns - kLongestSpan_ns) : t_ns);
  }
  while (t_ns_ < t_ns) {
    const std::int64_t until_ns = std::min(t_ns_ + kStep_ns, t_ns);
    const auto inertial = readings.Mean(t_ns_, until_ns);
    if (quiet && !inertial && t_ns - until_ns < kMaxLatency_ns) break;
    Note(until_ns, quiet, inertial);
  }
}

bool RestDetector::IsAsBefore(const InertialMean& inertial) const {
  return (inertial.angular_velocity - mean_turn_).norm() < kSteady_rad_s &&
         (*inertial.linear_acceleration - mean_force_).norm() < kSteady_m_s2;
}

void RestDetector::Note(std::int64_t t_ns, bool quiet, const std::optional<InertialMean>& inertial) {
  const std::int64_t before_ns = t_ns_;
  t_ns_ = t_ns;
  if (!quiet || !inertial || !inertial->linear_acceleration) {
    count_ = 0;
    return;
  }
  if (count_ == 0 || !IsAsBefore(*inertial)) {
    count_ = 0;
    begin_ns_ = before_ns;
    mean_turn_.setZero();
    mean_force_.setZero();
  }
  ++count_;
  mean_turn_ += (inertial->angular_velocity - mean_turn_) / count_;
  mean_force_ += (*inertial->linear_acceleration - mean_force_) / count_;
  if (SecondsFromNs(t_ns - kLate_ns - begin_ns_) >= kLeast_s) last_ = Span{begin_ns_, t_ns - kLate_ns};
}

}  // namespace devo
