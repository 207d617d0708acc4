// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/rest_detector.h"

#include "devo/core/time.h"

namespace devo {
namespace {

// Beyond the noise of consumer parts, averaged over the span of a surface.
constexpr double kSteady_rad_s = 0.03, kSteady_m_s2 = 0.3;
constexpr double kLeast_s = 0.15;
// The first events of a motion come after it began.
constexpr std::int64_t kLate_ns = 100'000'000;

}  // namespace

void RestDetector::Clear() { *this = RestDetector(); }

void RestDetector::Start(std::int64_t t_ns) {
  Clear();
  t_ns_ = t_ns;
  started_ = true;
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
