// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/statistics.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {
constexpr std::int64_t kRateWindowNs = 2'000'000'000;
constexpr std::size_t kMaxStamps = 50000;  // more than any driver's messages in the window
constexpr std::size_t kMaxValues = 2000;
}  // namespace

void RateMeter::Add(std::int64_t t_ns) {
  if (!stamps_.empty() && t_ns < stamps_.back()) stamps_.clear();
  stamps_.push_back(t_ns);
  // Stamps that stand still (zeros of a driver) never leave the window.
  while (t_ns - stamps_.front() > kRateWindowNs || stamps_.size() > kMaxStamps) stamps_.pop_front();
}

double RateMeter::Hz() const {
  if (stamps_.size() < 2 || stamps_.back() == stamps_.front()) return 0;
  return static_cast<double>(stamps_.size() - 1) / SecondsFromNs(stamps_.back() - stamps_.front());
}

void Quantiles::Add(double value) {
  if (values_.size() < kMaxValues) {
    values_.push_back(value);
  } else {
    values_[next_] = value;
    next_ = (next_ + 1) % kMaxValues;
  }
}

double Quantiles::At(double share) const {
  if (values_.empty()) return 0;
  std::vector<double> sorted = values_;
  const auto index = static_cast<std::ptrdiff_t>(std::lround(share * static_cast<double>(sorted.size() - 1)));
  std::nth_element(sorted.begin(), sorted.begin() + index, sorted.end());
  return sorted[static_cast<std::size_t>(index)];
}

}  // namespace devo
