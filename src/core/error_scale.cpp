// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/error_scale.h"

#include <algorithm>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kMinSpan_s = 0.5, kMaxSpan_s = 1.2;  // one of 1 s at all rates from 1 Hz
// Of a squared difference over its expectation where what is stated of the poses is right: both are stated cautiously.
constexpr double kUsual = 0.38;
// Errors are alike for tenths of a second: it takes some of them to know.
constexpr double kForgets_s = 3;
constexpr double kPrior_s = 1;  // of it are the scale before anything is known
constexpr double kMinScale = 0.05, kMaxScale = 25;

}  // namespace

void ErrorScale::Note(std::int64_t t_ns, const Vector6d& apart, const Matrix6d& stated) {
  const double since_s = past_.empty() ? 0 : SecondsFromNs(t_ns - past_.back().t_ns);
  past_.push_back({t_ns, apart});
  while (SecondsFromNs(t_ns - past_.front().t_ns) > kMaxSpan_s) past_.pop_front();
  if (since_s <= 0 || SecondsFromNs(t_ns - past_.front().t_ns) < kMinSpan_s) return;
  const Vector6d came_apart = apart - past_.front().apart;
  const double square = NormalisedSquare(came_apart, stated) / (2 * 6);
  known_s_ += since_s;
  const double share = since_s / std::min(known_s_ + kPrior_s, kForgets_s);
  scale_ += std::min(1.0, share) * (std::min(square / kUsual, kMaxScale) - scale_);
}

double ErrorScale::variance_scale() const { return std::clamp(scale_, kMinScale, kMaxScale); }

}  // namespace devo
