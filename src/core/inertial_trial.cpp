// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_trial.h"

#include <algorithm>
#include <utility>

#include "devo/core/inertial_fit.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// A sensor that fits is at 1 in its first seconds in all but three of 140 recordings, dark or with next to no events.
constexpr double kDoubtful = 3;
constexpr double kFirst_s = 2, kMaxStep_s = 0.1;
constexpr double kSpan_s = 0.1;         // of a turn, so that errors of its poses do not count for much
constexpr double kTurning_rad_s = 0.1;  // beside which the bias of a cold sensor is little
constexpr double kTurned_s = 0.6, kForgets_s = 2;
// Of the turns' squares: a sensor on other axes or in another unit is apart by about as much as they are.
constexpr double kReadsTurns = 0.1;

}  // namespace

bool InertialTrial::Judge(const Moment& now, double times_its_errors, const InertialBuffer& readings) {
  // What was moved before the sensor came says nothing of it.
  if (now.moves && times_its_errors > 0) moved_s_ += std::clamp(SecondsFromNs(now.t_ns - t_ns_), 0.0, kMaxStep_s);
  t_ns_ = now.t_ns;
  if (now.trusted) {
    Compare(now, readings);
  } else {
    last_.reset();
  }
  if (!readings.used()) return ReadsTheTurns();
  const bool known = moved_s_ > kFirst_s || ReadsTheTurns();
  if (!(known ? FitsNotAtAll(times_its_errors) : times_its_errors > kDoubtful)) return true;
  turning_s_ = turn_square_ = apart_square_ = 0;
  last_.reset();
  return false;
}

void InertialTrial::Compare(const Moment& now, const InertialBuffer& readings) {
  const double since_s = last_ ? SecondsFromNs(now.t_ns - last_->t_ns) : 0;
  if (last_ && since_s < kSpan_s) return;
  const auto before = std::exchange(last_, now);
  if (!before || since_s > 2 * kSpan_s) return;
  const auto read = readings.MeanRead(before->t_ns, now.t_ns);
  const Eigen::Vector3d turn =
      LogSO3(before->T_world_event.rotation().conjugate() * now.T_world_event.rotation()) / since_s;
  if (!read || turn.norm() < kTurning_rad_s) return;
  turning_s_ += since_s;
  const double share = since_s / std::min(turning_s_, kForgets_s);
  turn_square_ += share * (turn.squaredNorm() - turn_square_);
  apart_square_ += share * ((read->angular_velocity - turn).squaredNorm() - apart_square_);
}

bool InertialTrial::ReadsTheTurns() const {
  return turning_s_ >= kTurned_s && apart_square_ < kReadsTurns * turn_square_;
}

}  // namespace devo
