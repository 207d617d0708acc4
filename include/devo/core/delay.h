// SPDX-License-Identifier: BSD-3-Clause
//
// The delay of one sensor against another as a filter's state. Edges and depth err alike for tenths of a second, which
// looks like evidence: only a part of each step is taken (Brink, "Partial-Update Schmidt-Kalman Filter", 2017).
#pragma once

#include <algorithm>

namespace devo {

constexpr double kDelayStep = 0.3;
/// Of the variance that a full step would take away.
constexpr double kDelayDrop = 1 - (1 - kDelayStep) * (1 - kDelayStep);
/// How far a delay wanders in one second, s.
constexpr double kDelayWalk_s = 2e-4;

/// `full_step_s`: of a full update; `max_s`: of the delay, either way.
inline double StepDelay(double delay_s, double full_step_s, double max_s) {
  return std::clamp(delay_s + kDelayStep * full_step_s, -max_s, max_s);
}

}  // namespace devo
