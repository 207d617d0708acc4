// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/residual_scale.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

constexpr double kForgets_s = 1;
constexpr double kMaxSince_s = 0.1;  // after a standstill one surface says no more than after a moment
// Of a bright room seen by a camera that is moved by hand.
constexpr double kUsual_px = 0.26, kUsual_px_s = 100;
// Where errors are alike for all edges they are proportional to the speed, where each has its own they do not depend on
// it: of their variances, something in between.
constexpr double kSpeedExponent = 0.75;
// Calibration errs too, and shows in neither.
constexpr double kMinScale = 0.25, kMaxScale = 10;

}  // namespace

void ResidualScale::Note(double since_s, double mean_residual_px, double flow_px_s) {
  const double miss = mean_residual_px / kUsual_px;
  const double now = miss * miss * std::pow(flow_px_s / kUsual_px_s, kSpeedExponent);
  if (!(since_s > 0) || !std::isfinite(now)) return;
  since_s = std::min(since_s, kMaxSince_s);
  known_s_ = std::min(known_s_ + since_s, kForgets_s);
  scale_ += since_s / known_s_ * (std::clamp(now, kMinScale, kMaxScale) - scale_);
}

}  // namespace devo
