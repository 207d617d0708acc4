// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_past.h"

#include <algorithm>

#include "devo/core/depth_image.h"
#include "devo/core/time.h"

namespace devo {
namespace {

/// As far as `t_ns`, which is within the step or its end; nothing is measured there.
void Follow(const MotionPast::Step& step, std::int64_t t_ns, const InertialBuffer& inertial, MotionFilter* motion) {
  if (step.kind == MotionPast::Kind::kStill) {
    motion->HoldStill(t_ns, ReadSince(*motion, t_ns, inertial));
    return;
  }
  if (step.inertial && AdvanceTo(t_ns, inertial, motion)) return;
  if (step.kind == MotionPast::Kind::kCoasting) {
    motion->Coast(t_ns);
  } else {
    motion->GoOn(t_ns);
  }
}

}  // namespace

std::optional<InertialMean> ReadSince(const MotionFilter& motion, std::int64_t t_ns, const InertialBuffer& inertial) {
  const std::int64_t delay_ns = NsFromSeconds(motion.state().delay_s);
  return inertial.Mean(motion.time_ns() - delay_ns, t_ns - delay_ns);
}

bool AdvanceTo(std::int64_t t_ns, const InertialBuffer& inertial, MotionFilter* motion) {
  const auto read = ReadSince(*motion, t_ns, inertial);
  if (!read) return false;
  if (t_ns - motion->time_ns() <= MotionFilter::kLongestStep_ns) {
    motion->Advance(t_ns, *read);
    return true;
  }
  MotionFilter ahead = *motion;
  while (t_ns - ahead.time_ns() > MotionFilter::kLongestStep_ns) {
    if (!AdvanceTo(ahead.time_ns() + MotionFilter::kStep_ns, inertial, &ahead)) return false;
  }
  if (!AdvanceTo(t_ns, inertial, &ahead)) return false;
  *motion = ahead;
  return true;
}

MotionFilter::Prediction PredictAt(const MotionFilter& motion, std::int64_t t_ns, const InertialBuffer& inertial) {
  MotionFilter ahead = motion;
  AdvanceTo(t_ns, inertial, &ahead);
  return ahead.Predict(t_ns);
}

void MotionPast::SetOptions(const TrackingOptions& options) {
  for (Made& made : steps_) made.before.SetOptions(options);
}

void MotionPast::Note(const MotionFilter& before, const Step& step) {
  steps_.push_back({before, step});
  while (SecondsFromNs(step.t_ns - steps_.front().step.t_ns) > kMaxDepthLatency_s) steps_.pop_front();
}

std::optional<MotionFilter> MotionPast::Oldest() const {
  if (steps_.empty()) return std::nullopt;
  return steps_.front().before;
}

std::optional<MotionFilter> MotionPast::At(std::int64_t t_ns, const MotionFilter& now,
                                           const InertialBuffer& inertial) const {
  if (t_ns == now.time_ns()) return now;
  const auto within =
      std::find_if(steps_.begin(), steps_.end(), [t_ns](const Made& made) { return made.step.t_ns > t_ns; });
  if (within == steps_.end() || within->before.time_ns() > t_ns) return std::nullopt;
  MotionFilter motion = within->before;
  if (motion.time_ns() < t_ns) Follow(within->step, t_ns, inertial, &motion);
  return motion;
}

std::optional<MotionFilter> MotionPast::AgainInMotion(std::int64_t t_ns, const InertialBuffer& inertial,
                                                      PoseHistory* history) {
  const auto stands_since = [t_ns](const Made& made) {
    return made.step.kind == Kind::kStill && made.before.time_ns() >= t_ns;
  };
  const auto last_before = std::find_if_not(steps_.rbegin(), steps_.rend(), stands_since);
  const auto first = last_before.base();
  if (first == steps_.end()) return std::nullopt;
  const MotionFilter then = first->before;
  if (!ReadSince(then, steps_.back().step.t_ns, inertial)) return std::nullopt;
  for (auto made = first; made != steps_.end(); ++made) {
    made->step.kind = Kind::kMoving;
    made->step.inertial = true;
  }
  return Again(then, inertial, history);
}

MotionFilter MotionPast::Again(const MotionFilter& then, const InertialBuffer& inertial, PoseHistory* history,
                               Since measured) {
  const std::int64_t t_ns = then.time_ns();
  while (!steps_.empty() && steps_.front().step.t_ns <= t_ns) steps_.pop_front();
  const auto T_world_before = history->At(t_ns);
  const Rigid3 T_new_old = T_world_before ? then.pose() * T_world_before->inverse() : Rigid3();
  history->Move(T_new_old);
  history->ForgetAfter(t_ns);
  MotionFilter motion = then;
  for (Made& made : steps_) {
    made.before = motion;
    Follow(made.step, made.step.t_ns, inertial, &motion);
    if (made.step.measured) {
      Rigid3& T_world_aligned = made.step.measured->T_world_aligned;
      if (measured == Since::kMotion) T_world_aligned = T_new_old * T_world_aligned;
      motion.Update(made.step.t_ns, *made.step.measured);
    }
    history->Add(motion.time_ns(), motion.pose());
  }
  return motion;
}

}  // namespace devo
