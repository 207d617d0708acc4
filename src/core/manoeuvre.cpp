// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/manoeuvre.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

constexpr double kLeastShare = 1.0 / 16;
// What is stated of poses is cautious: lively motions that fit have 0.1 to 0.3, calm ones a hundredth of it.
constexpr double kFittingSquare = 0.3;
// Of the accelerations found, which are smoothed.
constexpr double kTimesFound = 30;
// Surprises may be noise as well, and say nothing of motions that are livelier than options take one to be.
constexpr double kTimesFoundOfLivelier = 1.4, kLiveliestShare = 4;
// It must not miss a stop, and forgets a shake soon enough to help.
constexpr double kGrows_s = 0.02, kFades_s = 0.25;

}  // namespace

void Manoeuvre::Note(double dt_s, double moved_square, double acceleration_square) {
  const double now = std::max(moved_square / kFittingSquare * share_, kTimesFound * acceleration_square);
  if (!std::isfinite(now) || !(dt_s > 0)) return;
  const double livelier = std::min(kTimesFoundOfLivelier * acceleration_square, kLiveliestShare);
  const double bounded = std::max(std::clamp(now, kLeastShare, 1.0), livelier);
  share_ += (1 - std::exp(-dt_s / (bounded > share_ ? kGrows_s : kFades_s))) * (bounded - share_);
}

}  // namespace devo
