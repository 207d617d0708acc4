// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_fusion.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "devo/core/time.h"

namespace devo {
namespace {

// What depth does not get wrong by noise alone it gets wrong alike for about this long: images that follow each other
// sooner count for less. Where no inertial sensor guides them poses need depth sooner.
constexpr double kAlikeGuided_s = 0.5, kAlikeAlone_s = 0.1;
// By so much events' map and depth are apart in image after image, whatever the motion: m and rad.
constexpr double kMapsApart = 3e-3;
constexpr double kPast_s = 1;
constexpr double kLeastMotion = 5e-3;  // m and rad: less may be a sensor that warms up
constexpr double kMaxPeriod_s = 0.25;  // between two depth images that tell the velocity
// Real depth errs in more ways than are stated (its calibration moves, its clock is off). What differs more than usual,
// as a normalised square, may be its error as well as the pose's, unless something else says that it is the pose.
constexpr double kUsualSquare = 4;
// Depth that is aligned to the wrong place is so at another one each time. What contradicts in a row, and each time
// alike (but for how fast a false pose drifts), is right, whatever events match: a map that was made from a false pose
// fits it.
constexpr int kAlikeInARow = 3;
constexpr double kDrift_m_s = 0.1;  // also in rad/s
// So fast a pose may have gone astray since depth agreed with it. Also in radians.
constexpr double kAstray_m_s = 1;
// What is stated is cautious (it counts what a motion might have done), but does not know that errors of a velocity
// that events alone tell last until depth mends them.
constexpr double kStatedGuided = 0.21, kStatedAlone = 0.18;
// Where depth comes seldom, poses are better than is stated of them.
constexpr double kPeriodExponent = 0.2, kForgetsPeriod_s = 1;
constexpr double kAgrees_s = 0.1, kMaxSince_s = 2, kGrowthAlone = 0.3;
// How events and depth come apart is known from few moments: by itself it says half of what it seems to, as a power.
constexpr double kErrorExponent = 0.5;

}  // namespace

bool DepthFusion::KnowsVelocity(double period_s) const {
  const double since_s = last_ ? SecondsFromNs(last_->t_ns - velocity_since_ns_) : 0;
  return since_s > 0 && since_s < period_s;
}

void DepthFusion::NoteVelocity(const DepthPose& depth) {
  const DepthPose before = std::exchange(last_, depth).value_or(depth);
  velocity_since_ns_ = before.t_ns;
  velocity_.setZero();
  if (KnowsVelocity(kMaxPeriod_s)) {
    velocity_ = Log(before.T_world_event.inverse() * depth.T_world_event) / SecondsFromNs(depth.t_ns - before.t_ns);
  }
  past_.push_back(depth);
  while (SecondsFromNs(depth.t_ns - past_.front().t_ns) > kPast_s) past_.pop_front();
}

bool DepthFusion::SawMotionSince(std::int64_t t_ns) const {
  const auto first =
      std::find_if(past_.begin(), past_.end(), [t_ns](const DepthPose& pose) { return pose.t_ns > t_ns; });
  if (first == past_.end() || first + 1 == past_.end()) return false;
  const Vector6d moved = Log(first->T_world_event.inverse() * past_.back().T_world_event);
  const Matrix6d covariance = first->Covariance() + past_.back().Covariance();
  const Vector6d known = first->KnownDirections() * past_.back().KnownDirections() * moved;
  return known.norm() > kLeastMotion && NormalisedSquare(moved, covariance) > kHardlyTheSame;
}

bool DepthFusion::AgreedWithin(double span_s, std::int64_t t_ns) const {
  return found_ns_ != 0 && SecondsFromNs(t_ns - found_ns_) < span_s;
}

bool DepthFusion::AgreedInPartWithin(double span_s, std::int64_t t_ns) const {
  return agreed_ && SecondsFromNs(t_ns - agreed_->t_ns) < span_s;
}

Matrix6d DepthFusion::BoundAt(std::int64_t t_ns) const {
  if (!agreed_) return Matrix6d::Zero();
  const double astray_m = kAstray_m_s * std::max(1e-2, SecondsFromNs(t_ns - agreed_->t_ns));
  return agreed_->KnownDirections() / (astray_m * astray_m);
}

double DepthFusion::VarianceScale(std::int64_t t_ns, bool guided) const {
  const double apart = std::pow(error_scale_.variance_scale(), kErrorExponent);
  if (guided) return kStatedGuided * apart * std::pow(std::min(1.0, kUsualPeriod_s / period_s_), kPeriodExponent);
  const double since_s = found_ns_ != 0 ? std::clamp(SecondsFromNs(t_ns - found_ns_), 0.0, kMaxSince_s) : kMaxSince_s;
  return kStatedAlone * apart * std::pow(1 + since_s / kAgrees_s, kGrowthAlone);
}

void DepthFusion::NoteContradiction(std::int64_t t_ns, bool contradicts, const Vector6d& residual,
                                    const Matrix6d& covariance) {
  if (!contradicts) {
    alike_in_a_row_ = 0;
    return;
  }
  const double drift_m = kDrift_m_s * SecondsFromNs(t_ns - contradicted_ns_);
  const Matrix6d apart = 2 * covariance + drift_m * drift_m * Matrix6d::Identity();
  const bool alike = NormalisedSquare(residual - contradicted_, apart) < kHardlyTheSame;
  alike_in_a_row_ = alike ? alike_in_a_row_ + 1 : 1;
  contradicted_ns_ = t_ns;
  contradicted_ = residual;
}

void DepthFusion::NotePeriod(double since_s) {
  const double share = std::min(1.0, since_s / kForgetsPeriod_s);
  period_s_ += share * (std::min(since_s, kForgetsPeriod_s) - period_s_);
}

std::optional<DepthFusion::Correction> DepthFusion::Correct(const DepthPose& depth, const Estimate& estimate) {
  NoteVelocity(depth);
  const double since_s = agreed_ ? std::max(1e-3, SecondsFromNs(depth.t_ns - agreed_->t_ns)) : kAlikeGuided_s;
  const Matrix6d I = Matrix6d::Identity();
  const Vector6d residual = Log(estimate.T_world_event.inverse() * depth.T_world_event);
  const Vector6d& per_delay = depth.per_delay;
  const Matrix6d alone = depth.Covariance();
  delay_.Wander(since_s);
  const Matrix6d rest = delay_.variance_s2() * per_delay * per_delay.transpose();
  const Matrix6d stated = estimate.covariance + alone + rest;
  const bool knows_all = depth.KnowsAllDirections();
  if (knows_all) error_scale_.Note(depth.t_ns, residual, estimate.variance_scale * stated);
  const double square = NormalisedSquare(residual, stated);
  const bool contradicts = square > kHardlyTheSame;
  if (knows_all) NoteContradiction(depth.t_ns, contradicts, residual, alone + rest);
  const bool believed = depth.confirmed || alike_in_a_row_ >= kAlikeInARow;
  const bool wrong = knows_all ? believed : estimate.doubtful;
  replacements_ = contradicts && knows_all && believed ? replacements_ + 1 : 0;
  if (contradicts && !wrong) {
    contradictions_ += knows_all ? 1 : 0;
    return std::nullopt;
  }
  if (!contradicts || knows_all) contradictions_ = 0;
  // Such a pose is as wrong as depth says, in the directions that depth knows.
  const double widened = std::max(1.0, square / kHardlyTheSame);
  const Matrix6d covariance = widened * estimate.covariance;
  agreed_ = depth;
  NotePeriod(since_s);
  if (knows_all) found_ns_ = depth.t_ns;

  const double alike_s = depth.shared_share * (estimate.guided ? kAlikeGuided_s : kAlikeAlone_s);
  Matrix6d R = std::max(1.0, alike_s / since_s) * alone + rest;
  if (!estimate.guided && !estimate.doubtful && !contradicts)
    R += std::max(0.0, square / kUsualSquare - 1) * (covariance + R);
  const Matrix6d s_inverse = (covariance + R).ldlt().solve(I);
  // Where directions are open, too little is left to tell a delay from an error of the velocity, and of a pose that was
  // false any delay would explain a part.
  const bool tells_delay = knows_all && !contradicts;
  const Matrix6d alike = kMapsApart * kMapsApart * I;
  const Vector6d gain = (tells_delay ? delay_.variance_s2() : 0) * ((covariance + R + alike).ldlt().solve(per_delay));
  delay_.Step(gain.dot(residual), gain.dot(per_delay), estimate.event_delay_s);
  return Correction{covariance * (s_inverse * residual), R.ldlt().solve(I), widened};
}

}  // namespace devo
