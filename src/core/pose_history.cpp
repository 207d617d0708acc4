// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/pose_history.h"

#include <algorithm>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kVelocitySpan_ns = 20'000'000;

}  // namespace

void PoseHistory::Add(std::int64_t t_ns, const Rigid3& T_world_event) {
  if (!poses_.empty() && t_ns <= poses_.back().t_ns) return;
  poses_.push_back({t_ns, T_world_event});
  while (SecondsFromNs(t_ns - poses_.front().t_ns) > length_s_) poses_.pop_front();
}

void PoseHistory::Move(const Rigid3& T_new_old) {
  for (Stamped& pose : poses_) pose.T_world_event = T_new_old * pose.T_world_event;
}

void PoseHistory::ForgetAfter(std::int64_t t_ns) {
  while (!poses_.empty() && poses_.back().t_ns > t_ns) poses_.pop_back();
}

std::optional<Rigid3> PoseHistory::At(std::int64_t t_ns, double extrapolate_s) const {
  if (poses_.empty()) return std::nullopt;
  const double before_s = SecondsFromNs(poses_.front().t_ns - t_ns);
  const double after_s = SecondsFromNs(t_ns - poses_.back().t_ns);
  if (before_s > extrapolate_s || after_s > extrapolate_s) return std::nullopt;
  if (poses_.size() == 1) return poses_.front().T_world_event;
  auto b = std::lower_bound(poses_.begin(), poses_.end(), t_ns,
                            [](const Stamped& pose, std::int64_t t) { return pose.t_ns < t; });
  b = std::clamp(b, poses_.begin() + 1, poses_.end() - 1);
  const auto a = b - 1;
  const double s = SecondsFromNs(t_ns - a->t_ns) / SecondsFromNs(b->t_ns - a->t_ns);
  return Interpolate(a->T_world_event, b->T_world_event, s);
}

std::optional<Vector6d> PoseHistory::VelocityAt(std::int64_t t_ns) const {
  if (poses_.empty()) return std::nullopt;
  const std::int64_t from_ns = std::max(t_ns - kVelocitySpan_ns / 2, poses_.front().t_ns);
  const std::int64_t to_ns = std::min(t_ns + kVelocitySpan_ns / 2, poses_.back().t_ns);
  if (to_ns - from_ns < kVelocitySpan_ns / 2) return std::nullopt;
  return Log(At(from_ns)->inverse() * *At(to_ns)) / SecondsFromNs(to_ns - from_ns);
}

}  // namespace devo
