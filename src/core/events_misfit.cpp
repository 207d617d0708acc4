// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/events_misfit.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kExpected = 6;      // of a normalised square: the degrees of freedom
constexpr double kMostSquare = 400;  // an image that is aligned to a wrong place says no more than this
// A few hundredths of a second of false events are centimetres; where they fit again, they do so for a while first.
constexpr double kGrows_s = 0.05, kFades_s = 0.4;

}  // namespace

void EventsMisfit::Note(std::int64_t t_ns, double square, bool believed) {
  if (t_ns <= noted_ns_ || !std::isfinite(square)) return;
  const double since_s = SecondsFromNs(t_ns - noted_ns_);
  mean_ = std::min(mean_, TimesAt(t_ns));
  noted_ns_ = t_ns;
  if (since_s > kInQuickSuccession_s) return;
  const double now = std::min(square, believed ? kMostSquare : kExpected) / kExpected;
  mean_ += (1 - std::exp(-since_s / (now > mean_ ? kGrows_s : kFades_s))) * (now - mean_);
}

double EventsMisfit::TimesAt(std::int64_t t_ns) const {
  const double without_s = std::max(0.0, SecondsFromNs(t_ns - noted_ns_) - kInQuickSuccession_s);
  return 1 + std::max(0.0, mean_ - 1) * std::exp(-without_s / kFades_s);
}

}  // namespace devo
