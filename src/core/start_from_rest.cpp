// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/start_from_rest.h"

#include <algorithm>

#include "devo/core/time.h"

namespace devo {
namespace {

// Beyond, errors of the accelerometer have grown to what is guessed anyway.
constexpr double kLongest_s = 3;
constexpr std::int64_t kStep_ns = 10'000'000, kUsedOfRest_ns = 1'000'000'000;

}  // namespace

std::optional<StartFromRest> FollowFromRest(const RestDetector::Span& rest, const LocalMap& map,
                                            const InertialBuffer& inertial, const TrackingOptions& options) {
  if (SecondsFromNs(map.t_ns - rest.end_ns) > kLongest_s) return std::nullopt;
  const std::int64_t begin_ns = std::max(rest.begin_ns, rest.end_ns - kUsedOfRest_ns);
  const auto force = inertial.Mean(begin_ns, std::min(rest.end_ns, map.t_ns));
  if (!force || !force->linear_acceleration) return std::nullopt;
  MotionFilter motion(options);
  motion.Start(begin_ns, Rigid3());
  motion.LearnGravity(*force->linear_acceleration, SecondsFromNs(rest.end_ns - begin_ns));
  while (motion.time_ns() < map.t_ns) {
    const std::int64_t t_ns = std::min(motion.time_ns() + kStep_ns, map.t_ns);
    const auto read = inertial.Mean(motion.time_ns(), t_ns);
    if (!read) return std::nullopt;
    if (t_ns <= rest.end_ns) {
      motion.HoldStill(t_ns, read, rest.scatter);
    } else {
      motion.Advance(t_ns, *read);
    }
  }
  const Rigid3 T_world_rest = map.T_world_ref * motion.pose().inverse();
  motion.Anchor(map.T_world_ref);
  return StartFromRest{motion, {{begin_ns, T_world_rest}, {std::min(rest.end_ns, map.t_ns - 1), T_world_rest}}};
}

}  // namespace devo
