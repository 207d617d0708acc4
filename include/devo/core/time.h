// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace devo {

/// All times inside the odometry are integer nanoseconds of data time; seconds appear only as durations.
inline double SecondsFromNs(std::int64_t duration_ns) { return 1e-9 * static_cast<double>(duration_ns); }

inline std::int64_t NsFromSeconds(double duration_s) {
  return static_cast<std::int64_t>(std::llround(1e9 * duration_s));
}

/// How many come in this time at this rate, at least one.
inline int CountIn(double span_s, double rate_hz) {
  return std::max(1, static_cast<int>(std::lround(span_s * rate_hz)));
}

}  // namespace devo
