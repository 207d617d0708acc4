// SPDX-License-Identifier: BSD-3-Clause
//
// The delay of one sensor against another as a filter's state. Edges and depth err alike for tenths of a second, which
// looks like evidence: only a part of each step is taken (Brink, "Partial-Update Schmidt-Kalman Filter", 2017).
#pragma once

#include <algorithm>

namespace devo {

/// What is not known of a delay at first, s: clocks of one host, a sensor's own filter, half an exposure, the latency
/// of dark pixels.
constexpr double kDelaySigma_s = 0.01;
/// How far a delay wanders in one second, s.
constexpr double kDelayWalk_s = 2e-4;

/// Of the variance that a full step would take away, what a step of this share takes.
constexpr double DropOfStep(double step) { return 1 - (1 - step) * (1 - step); }

/// `step_s`: by how much it is to move; `max_s`: of the delay, either way.
inline double StepDelay(double delay_s, double step_s, double max_s) {
  return std::clamp(delay_s + step_s, -max_s, max_s);
}

}  // namespace devo
