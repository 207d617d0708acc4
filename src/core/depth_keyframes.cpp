// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_keyframes.h"

#include <algorithm>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "devo/core/depth_search.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// A keyframe that shows less of the image than this is replaced.
constexpr double kKeepOverlap = 0.7;
/// Of keyframes that are tried: within them projective association meets the same surfaces. Distance over their depth.
struct ViewBounds {
  double angle_rad, distance_share;
};
constexpr ViewBounds kNearViews = {0.5, 0.3}, kFarViews = {1, 0.8};
constexpr int kMaxTried = 3;
constexpr std::size_t kMaxKeyframes = 60;  // of about 150 kB
// Most of what a depth camera gets wrong alike everywhere is the same in two views that are near to each other; of two
// that share little it is more than of this distance (of the depth, or rad).
constexpr double kOtherView = 0.3, kLeastBias = 0.1, kMostBias = 2;
constexpr double kKnown_m = 0.05;        // also in radians
constexpr double kSearchEvery_s = 0.15;  // for a lost camera
// How well the pose of the first map's image is known, also in radians.
constexpr double kFirst_m = 5e-3;

/// Of directions that are known to a few centimetres and hundredths of a radian; of others nothing.
Matrix6d OfKnownDirections(const Matrix6d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
  const Vector6d& all = eigen.eigenvalues();
  const Vector6d values = (all.array() > 1 / (kKnown_m * kKnown_m)).select(all, 0.0);
  return eigen.eigenvectors() * values.asDiagonal() * eigen.eigenvectors().transpose();
}

double LargestSigma(const Eigen::Matrix3d& covariance) {
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly).eigenvalues()(2));
}

}  // namespace

DepthKeyframes::DepthKeyframes(const Rig& rig, const MappingOptions& options)
    : aligner_(rig.depth_camera), options_(options), T_event_depth_(rig.T_event_depth) {}

void DepthKeyframes::Clear() {
  keyframes_.clear();
  current_ = -1;
  searched_ns_ = 0;
  continuity_.Reset();
}

Rigid3 DepthKeyframes::WorldFromKeyframe(const Keyframe& keyframe, double delay_s) const {
  // Its pose was that of the time at which it was thought to be made.
  return keyframe.view.T_world_event * Exp(keyframe.view.velocity_event * (delay_s - keyframe.view.delay_s)) *
         T_event_depth_;
}

std::optional<DepthKeyframes::Match> DepthKeyframes::AlignTo(std::size_t index, Reach reach, const DepthCells& now,
                                                             const View& view) const {
  const Keyframe& keyframe = keyframes_[index];
  const Rigid3 T_start = WorldFromKeyframe(keyframe, view.delay_s).inverse() * view.T_world_event * T_event_depth_;
  const auto result = aligner_.Align(keyframe.cells, now, T_start, reach);
  if (!result) return std::nullopt;
  Match match{static_cast<int>(index), reach, *result, Rests::kOnMany};
  if (view.lost || !view.trusted || !options_.ideas.doubt_things) return match;
  const auto alone = aligner_.OnWhatAloneHolds(keyframe.cells, now, *result);
  if (alone.empty()) return match;
  const auto contradicts = [&](const Match& m) {
    return MakePose(m, view).Contradicts(view.T_world_event, view.covariance);
  };
  if (!contradicts(match)) {
    match.rests = Rests::kOnOneThing;
    return match;
  }
  const auto of_rest = aligner_.Align(keyframe.cells, now, T_start, reach, alone);
  if (!of_rest) return std::nullopt;
  const Match rest{static_cast<int>(index), reach, *of_rest, Rests::kWithoutIt};
  // What all else contradicts as well is the events' pose, whatever has moved.
  return contradicts(rest) ? match : rest;
}

void DepthKeyframes::Try(std::size_t index, Reach reach, const DepthCells& now, const View& view, Match* best) const {
  const auto match = AlignTo(index, reach, now, view);
  if (match && (best->keyframe < 0 || match->result.overlap > best->result.overlap)) *best = *match;
}

bool DepthKeyframes::MayOverlap(const Keyframe& keyframe, Reach reach, const View& view) const {
  if (keyframe.view.chapter != view.chapter) return false;
  const Rigid3 T_key_now = keyframe.view.T_world_event.inverse() * view.T_world_event;
  const ViewBounds& within = reach == Reach::kFar ? kFarViews : kNearViews;
  return RotationAngle(T_key_now) <= within.angle_rad &&
         T_key_now.translation().norm() <= within.distance_share * keyframe.cells.median_m;
}

void DepthKeyframes::TryOthers(const DepthCells& now, const View& view, Match* best) const {
  int tried = 0;
  // The oldest first: the least has gone wrong before it.
  for (std::size_t i = 0; i < keyframes_.size() && tried < kMaxTried; ++i) {
    if (static_cast<int>(i) == current_ || !MayOverlap(keyframes_[i], Reach::kNear, view)) continue;
    ++tried;
    Try(i, Reach::kNear, now, view, best);
    if (best->keyframe >= 0 && best->result.overlap >= kKeepOverlap) return;
  }
}

DepthKeyframes::Match DepthKeyframes::FindFar(const DepthCells& now, const View& view) const {
  Match best;
  int tried = 0;
  // The newest first: it is the nearest.
  for (std::size_t i = keyframes_.size(); i-- > 0 && tried < kMaxTried;) {
    if (!MayOverlap(keyframes_[i], Reach::kFar, view)) continue;
    ++tried;
    Try(i, Reach::kFar, now, view, &best);
  }
  return best;
}

DepthKeyframes::Match DepthKeyframes::FindNear(const DepthCells& now, const View& view) const {
  Match best;
  const auto current = static_cast<std::size_t>(current_);
  if (current_ >= 0 && keyframes_[current].view.chapter == view.chapter) Try(current, Reach::kNear, now, view, &best);
  if (best.keyframe < 0 || best.result.overlap < kKeepOverlap) TryOthers(now, view, &best);
  return best;
}

std::optional<DepthKeyframes::Found> DepthKeyframes::Find(const DepthCells& now, const View& view) const {
  const auto found_by = [&](const Match& match) {
    Found found{match, MakePose(match, view)};
    const bool doubtful = view.lost || found.pose.SquareApart(view.T_world_event, view.covariance) > view.doubtful_from;
    found.pose.confirmed = doubtful && match.rests == Rests::kOnMany && IsConfirmed(match, found.pose, now, view);
    return found;
  };
  std::optional<Found> found;
  const Match near = FindNear(now, view);
  if (near.keyframe >= 0) {
    found = found_by(near);
    const DepthPose& pose = found->pose;
    const bool fits = pose.KnowsAllDirections() && !pose.Contradicts(view.T_world_event, view.covariance);
    if (fits || pose.confirmed || near.result.overlap >= kKeepOverlap) return found;
  }
  // From a start too far off it may have met few surfaces, or stopped on its way.
  const Match far = FindFar(now, view);
  if (far.keyframe < 0 || (found && far.result.overlap <= near.result.overlap)) return found;
  Found farther = found_by(far);
  return !found || farther.pose.confirmed ? farther : found;
}

std::vector<Rigid3> DepthKeyframes::StartsFor(const Keyframe& keyframe, const View& view) const {
  if (!view.turn_known) return TurnedStarts();
  if (!MayOverlap(keyframe, Reach::kFar, view)) return {};
  return ShiftedStarts(WorldFromKeyframe(keyframe, view.delay_s).inverse() * view.T_world_event * T_event_depth_,
                       LargestSigma(view.covariance.topLeftCorner<3, 3>()));
}

std::optional<DepthKeyframes::Found> DepthKeyframes::FindLost(const DepthCells& now, const View& view,
                                                              std::int64_t t_ns) {
  auto found = Find(now, view);
  if (found && found->pose.confirmed) return found;
  if (SecondsFromNs(t_ns - searched_ns_) < kSearchEvery_s) return std::nullopt;
  searched_ns_ = t_ns;
  return Search(now, view);
}

std::optional<DepthKeyframes::Found> DepthKeyframes::Search(const DepthCells& now, const View& view) const {
  int tried = 0;
  for (std::size_t i = keyframes_.size(); i-- > 0 && tried < kMaxTried;) {
    const Keyframe& keyframe = keyframes_[i];
    const auto starts = keyframe.view.chapter == view.chapter ? StartsFor(keyframe, view) : std::vector<Rigid3>();
    if (starts.empty()) continue;
    ++tried;
    const auto T_key_depth = SearchPlace(aligner_, keyframe.cells, now, starts);
    if (!T_key_depth) continue;
    View there = view;
    there.T_world_event = WorldFromKeyframe(keyframe, view.delay_s) * *T_key_depth * T_event_depth_.inverse();
    auto match = AlignTo(i, Reach::kNear, now, there);
    if (!match) continue;
    match->reach = Reach::kFar;
    Found found{*match, MakePose(*match, there)};
    found.pose.confirmed = found.pose.KnowsAllDirections();
    if (found.pose.confirmed) return found;
  }
  return std::nullopt;
}

DepthPose DepthKeyframes::MakePose(const Match& match, const View& view) const {
  const Keyframe& keyframe = keyframes_[static_cast<std::size_t>(match.keyframe)];
  const Rigid3 T_depth_event = T_event_depth_.inverse();
  const Rigid3 T_key_event = match.result.T_ref_depth * T_depth_event;
  DepthPose pose;
  pose.chapter = view.chapter;
  pose.T_world_event = WorldFromKeyframe(keyframe, view.delay_s) * T_key_event;
  const Matrix6d A = Adjoint(T_depth_event);
  const Matrix6d H = A.transpose() * match.result.information * A / errors_.CellsPerMeasurement();
  // (H^-1 + bias)^-1, where H may be singular.
  Vector6d bias;
  bias << Eigen::Vector3d::Constant(keyframe.cells.median_m), Eigen::Vector3d::Ones();
  const double apart = ViewsApart(match.result.T_ref_depth, keyframe.cells.median_m);
  bias *= errors_.BiasShare() * std::min(kMostBias, kLeastBias + apart / kOtherView);
  Vector6d variance = bias.cwiseAbs2();
  if (keyframe.first) variance.array() += kFirst_m * kFirst_m;
  const Matrix6d B = variance.cwiseInverse().asDiagonal();
  // Little by little, the events' errors would pass for knowledge in a direction that is left open.
  pose.information = OfKnownDirections(H - H * (B + H).inverse() * H);
  // Of the keyframe's event camera to that of now, both of which were where they were this much later.
  const Rigid3 T_event_keyevent = (T_event_depth_ * T_key_event).inverse();
  pose.per_delay = view.velocity_event - Adjoint(T_event_keyevent) * keyframe.view.velocity_event;
  pose.delay_sigma_s = view.delay_sigma_s;
  pose.shared_share = errors_.SharedShare();
  return pose;
}

bool DepthKeyframes::IsConfirmed(const Match& match, const DepthPose& pose, const DepthCells& now,
                                 const View& view) const {
  if (!pose.KnowsAllDirections()) return false;
  View other_side = view;
  other_side.T_world_event = pose.T_world_event * (view.T_world_event.inverse() * pose.T_world_event);
  const auto again = AlignTo(static_cast<std::size_t>(match.keyframe), match.reach, now, other_side);
  return again && !MakePose(*again, other_side).Contradicts(pose.T_world_event, pose.CovarianceOfPlace());
}

void DepthKeyframes::Keep(DepthCells cells, const View& view) {
  if (keyframes_.size() == kMaxKeyframes) {
    keyframes_.erase(std::min_element(keyframes_.begin(), keyframes_.end(),
                                      [](const Keyframe& a, const Keyframe& b) { return a.last_used < b.last_used; }));
  }
  keyframes_.push_back({std::move(cells), view, calls_});
  current_ = static_cast<int>(keyframes_.size()) - 1;
  continuity_.Reset();
}

void DepthKeyframes::KeepFirst(const DepthImage& depth, const View& view, bool stand_in) {
  ++calls_;
  Keep(aligner_.Reduce(depth.depth_m, options_.min_depth_m, options_.max_depth_m), view);
  keyframes_.back().first = true;
  keyframes_.back().stand_in = stand_in;
}

DepthContinuity::Verdict DepthKeyframes::Judge(const Match& match, const DepthPose& pose, const View& view,
                                               std::int64_t t_ns) {
  if (match.keyframe != current_ || match.reach == Reach::kFar || !view.trusted || !options_.ideas.depth_jumps)
    continuity_.Reset();
  return continuity_.Judge({t_ns, view.T_world_event, pose.T_world_event, pose.information});
}

void DepthKeyframes::Learn(const Match& match, const DepthCells& now, const View& view) {
  if (!options_.ideas.learn_depth_errors || !view.trusted || view.lost || match.reach == Reach::kFar) return;
  const DepthCells& ref = keyframes_[static_cast<std::size_t>(match.keyframe)].cells;
  if (const auto residuals = aligner_.ResidualsOf(ref, now, match.result)) errors_.Note(*residuals);
}

std::optional<DepthPose> DepthKeyframes::Align(const DepthImage& depth, const View& view) {
  ++calls_;
  DepthCells now = aligner_.Reduce(depth.depth_m, options_.min_depth_m, options_.max_depth_m);
  auto found = view.lost ? FindLost(now, view, depth.t_ns) : Find(now, view);
  without_things_ += found && found->match.rests == Rests::kWithoutIt ? 1 : 0;
  if (found) {
    const DepthContinuity::Verdict verdict = Judge(found->match, found->pose, view, depth.t_ns);
    if (verdict == DepthContinuity::Verdict::kDoubtful) return std::nullopt;
    Learn(found->match, now, view);
    current_ = found->match.keyframe;
    keyframes_[static_cast<std::size_t>(current_)].last_used = calls_;
    if (verdict == DepthContinuity::Verdict::kJumped) {
      ++jumps_;
      Clear();
      found.reset();
    }
  }
  const bool replaced = found && keyframes_[static_cast<std::size_t>(current_)].stand_in;
  if (view.trusted && (!found || found->match.result.overlap < kKeepOverlap || replaced) && now.median_m > 0) {
    // At the pose before it would say the opposite of the next image, and where the view leaves little overlap each is
    // a keyframe: errors would grow from one to the next.
    View kept = view;
    if (found) kept.T_world_event = Corrected(view.T_world_event, view.covariance, found->pose);
    if (replaced) keyframes_.erase(keyframes_.begin() + current_);
    Keep(std::move(now), kept);
  }
  return found ? std::make_optional(found->pose) : std::nullopt;
}

}  // namespace devo
