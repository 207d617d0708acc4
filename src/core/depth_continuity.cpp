// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_continuity.h"

#include <algorithm>
#include <vector>

#include "devo/core/median.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// What is usual is the median of so many: slips of the tracking do not make jumps usual.
constexpr std::size_t kSteps = 15;
// Squares, over what is usual. Steps of real sensors, events in the dark and abrupt motion reach ten times that.
constexpr double kJump = 25;
constexpr double kLeastUsual = 1;
// A camera that itself moved by so much otherwise than before may well have been tracked wrongly.
constexpr double kSteadyShare = 1.0 / 16;
// Squares, over the jump: once it has jumped, the next image is less than half as far off.
constexpr double kGoesOnShare = 0.25;

double Square(const Vector6d& v, const Matrix6d& information) { return v.dot(information * v); }

}  // namespace

double DepthContinuity::Apart(const Image& image) const {
  const Rigid3 tracked = last_->T_world_tracked.inverse() * image.T_world_tracked;
  const Rigid3 seen = last_->T_world_depth.inverse() * image.T_world_depth;
  return Square(Log(tracked.inverse() * seen), image.information);
}

double DepthContinuity::Unsteady(const Image& image) const {
  const Rigid3 tracked = last_->T_world_tracked.inverse() * image.T_world_tracked;
  const Rigid3 steady = Exp(velocity_ * SecondsFromNs(image.t_ns - last_->t_ns));
  return Square(Log(steady.inverse() * tracked), image.information);
}

void DepthContinuity::Note(const Image& image, double apart) {
  apart_.push_back(apart);
  if (apart_.size() > kSteps) apart_.pop_front();
  velocity_ = Log(last_->T_world_tracked.inverse() * image.T_world_tracked) / SecondsFromNs(image.t_ns - last_->t_ns);
}

double DepthContinuity::Usual() const {
  return std::max(kLeastUsual, Median(std::vector<double>(apart_.begin(), apart_.end())));
}

DepthContinuity::Verdict DepthContinuity::Judge(const Image& image) {
  Verdict verdict = Verdict::kSteady;
  if (last_ && image.t_ns > last_->t_ns) {
    const double apart = Apart(image), unsteady = Unsteady(image);
    const bool tracked_steadily = unsteady < kSteadyShare * apart;
    if (doubted_) {
      if (apart < kGoesOnShare * *doubted_) verdict = Verdict::kJumped;
      // Either way what was usual is not any more; the camera goes on as it did.
      doubted_.reset();
      apart_.clear();
    } else if (!apart_.empty() && apart > kJump * Usual() && tracked_steadily) {
      verdict = Verdict::kDoubtful;
      doubted_ = apart;
    } else {
      // A step that was tracked badly, as the first ones are, does not make a jump usual.
      Note(image, tracked_steadily ? apart : apart / std::max(1.0, unsteady));
    }
  }
  last_ = image;
  return verdict;
}

}  // namespace devo
