// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/depth_clock.h"

#include <cmath>
#include <cstdio>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kBehind_s = 2, kAhead_s = 1;

}  // namespace

bool IsOfTheirTime(std::int64_t depth_ns, std::int64_t surface_ns) {
  const double ahead_s = SecondsFromNs(depth_ns - surface_ns);
  return ahead_s > -kBehind_s && ahead_s < kAhead_s;
}

std::string ComplaintOfDepthClock(std::int64_t depth_ns, std::int64_t surface_ns) {
  if (IsOfTheirTime(depth_ns, surface_ns)) return "";
  const double ahead_s = SecondsFromNs(depth_ns - surface_ns);
  char text[240];
  std::snprintf(
      text, sizeof(text),
      "stamps of the depth are %.1f s %s the events, expected at most %.0f s behind and %.0f s ahead: check the "
      "drivers' clocks and depth_time_offset_s",
      std::abs(ahead_s), ahead_s > 0 ? "ahead of" : "behind", kBehind_s, kAhead_s);
  return text;
}

}  // namespace devo
