// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/rest_detector.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {

// Beyond the noise of consumer parts, averaged over the span of a surface.
constexpr double kSteady_rad_s = 0.03, kSteady_m_s2 = 0.3;
constexpr double kLeast_s = 0.15;
// Times the least scatter so far, or what the best consumer parts have: more is a motion that few events show.
constexpr double kAsSteady = 2, kBest_rad_s = 5e-4, kBest_m_s2 = 0.01;
// The first events of a motion come after it began.
constexpr std::int64_t kLate_ns = 100'000'000;
constexpr std::int64_t kStep_ns = 10'000'000;
constexpr std::int64_t kMaxLatency_ns = 100'000'000;     // of readings
constexpr std::int64_t kLongestSpan_ns = 3'000'000'000;  // looked back over

/// Welford, "Note on a method for calculating corrected sums of squares and products", 1962.
void AddToMean(const Eigen::Vector3d& value, int count, Eigen::Vector3d* mean, double* squares) {
  const Eigen::Vector3d before = value - *mean;
  *mean += before / count;
  *squares += before.dot(value - *mean);
}

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
    turn_squares_ = force_squares_ = 0;
  }
  ++count_;
  AddToMean(inertial->angular_velocity, count_, &mean_turn_, &turn_squares_);
  AddToMean(*inertial->linear_acceleration, count_, &mean_force_, &force_squares_);
  if (SecondsFromNs(t_ns - kLate_ns - begin_ns_) < kLeast_s) return;
  const InertialScatter scatter = Scatter();
  if (scatter.turn_rad_s > kAsSteady * least_.turn_rad_s || scatter.force_m_s2 > kAsSteady * least_.force_m_s2) return;
  least_ = {std::clamp(scatter.turn_rad_s, kBest_rad_s, least_.turn_rad_s),
            std::clamp(scatter.force_m_s2, kBest_m_s2, least_.force_m_s2)};
  last_ = Span{begin_ns_, t_ns - kLate_ns, scatter};
}

InertialScatter RestDetector::Scatter() const {
  const double degrees = 3 * std::max(1, count_ - 1);
  return {std::sqrt(turn_squares_ / degrees), std::sqrt(force_squares_ / degrees)};
}

}  // namespace devo
