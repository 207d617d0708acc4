// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

namespace devo {

/// Rate of stamped data over the last two seconds of its own (data) time. Not thread-safe.
class RateMeter {
 public:
  /// A stamp older than the last one starts anew.
  void Add(std::int64_t t_ns);

  /// Per second of data time; 0 with fewer than two stamps.
  double Hz() const;

  std::size_t kept() const { return stamps_.size(); }  ///< stamps of the window
  std::int64_t last_ns() const { return stamps_.empty() ? 0 : stamps_.back(); }

 private:
  std::deque<std::int64_t> stamps_;
};

/// Quantiles of the last 2000 values. Not thread-safe.
class Quantiles {
 public:
  void Add(double value);
  std::size_t size() const { return values_.size(); }

  /// `share` in [0, 1]: 0.5 is the median, 1 the maximum. 0 without values.
  double At(double share) const;

 private:
  std::vector<double> values_;  // a ring once full
  std::size_t next_ = 0;
};

}  // namespace devo
