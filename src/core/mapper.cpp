// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/mapper.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "devo/core/depth_guess.h"
#include "devo/core/edge_lag.h"
#include "devo/core/edge_motion.h"
#include "devo/core/events_misfit.h"
#include "devo/core/scene_depth.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// As many as there are in kMaxDepthLatency_s at 100 Hz; at higher rates not all are kept.
constexpr std::size_t kMaxSurfaces = 32;
// Depth images wait for a surface of their time: where events are missing for a second, until they come back.
constexpr std::size_t kMaxDepths = 32, kMaxSweeps = 4;
// The first reference decides the scale of all that follows: it waits for enough edges.
constexpr std::size_t kMinPointsOfFirst = 200, kMinPoints = 40;
constexpr double kMargin_px = 3;  // from the image's border, where edges of a depth that is guessed are left out
// The local map is composed anew when the view has moved by this share of the scene's depth, or this angle.
constexpr double kViewShare = 0.03, kViewAngle_rad = 0.05;
constexpr std::size_t kExplainedStep = 8;
// Between depth images the map is observed, and grows, this often. It is observed wherever the view is another one,
// too, once a depth image has not come for as long.
constexpr double kObserveEvery_s = 0.04;
constexpr double kSceneMoved = 0.5;  // cells of the scene's depth: from there on it is seen anew
// Where a depth camera reads less of its image, most things are beyond its range, and farther than those around them. A
// point that is guessed too near takes its depth from the way, and the way then its length from such points, unless it
// is as well known as this: m, or as a share of it.
constexpr double kReadsMost = 0.3, kWayKnown_m = 5e-3, kWayKnownShare = 0.01;
// What is stated of a pose that no inertial sensor guides grows once depth has contradicted it: what is farther off
// than this (DepthPose::SquareApart) may contradict tracking's own idea of it.
constexpr double kDoubtfulAlone = 3;
// Surfaces of views nearer to each other have much of their errors in common: one of them refines the map.
constexpr double kNewView = 0.01;

/// Of at least three in the order of their time, the one that its neighbours replace best, the oldest of several;
/// neither the first nor the last.
template <typename TimeAt>
std::ptrdiff_t Dispensable(std::size_t size, const TimeAt& time_ns_at) {
  const auto gap_ns = [&](std::size_t i) { return time_ns_at(i + 1) - time_ns_at(i - 1); };
  std::size_t least = 1;
  for (std::size_t i = 2; i + 1 < size; ++i) least = gap_ns(i) < gap_ns(least) ? i : least;
  return static_cast<std::ptrdiff_t>(least);
}

/// With the camera and the pose of the depth images: those made of sweeps are in the undistorted event image.
Rig DepthImageRig(Rig rig) {
  if (rig.depth_from_lidar)
    rig.depth_camera = rig.event_camera.Undistorted();
  else if (rig.depth_registered)
    rig.depth_camera = rig.event_camera;
  if (rig.depth_registered || rig.depth_from_lidar) rig.T_event_depth = Rigid3();
  return rig;
}

}  // namespace

Mapper::Mapper(const Rig& rig, const OdometryOptions& options)
    : rig_(DepthImageRig(rig)), options_(options), camera_(rig.event_camera.Undistorted()),
      registration_(camera_, rig_.depth_camera, options.mapping), lidar_(camera_, rig.T_event_depth, options.mapping),
      map_(camera_, options.mapping), depth_keyframes_(rig_, options.mapping) {}

void Mapper::Reset() {
  surfaces_.clear();
  depths_.clear();
  move_.reset();
  sweeps_.clear();
  lidar_.Clear();
  lidar_depth_ = DepthImage();
  poses_.Clear();
  velocity_.setZero();
  velocity_of_poses_ = false;
  lost_ = false;
  delays_ = SensorDelays();
  sure_ = trackable_ = begin_chapter_ = false;
  map_.Clear();
  depth_keyframes_.Clear();
  depth_repeats_.Clear();
  depth_of_rest_.Clear();
  first_depth_.reset();
  depth_poses_.clear();
  occluder_.reset();
  T_world_local_.reset();
  scene_depth_ = SceneDepth();
  last_match_ = Match();
  T_world_refined_ = T_world_observed_ = T_world_scene_ = Rigid3();
  way_m_ = read_share_ = 0;
  observed_ns_ = extended_ns_ = first_surface_ns_ = 0;
}

void Mapper::SetOptions(const OdometryOptions& options) {
  options_ = options;
  registration_.SetOptions(options.mapping);
  lidar_.SetOptions(options.mapping);
  map_.SetOptions(options.mapping);
  depth_keyframes_.SetOptions(options.mapping);
  options_changed_ = true;
}

void Mapper::AddSurface(SurfacePtr surface) {
  if (surface->epoch != epoch_) {
    Reset();
    epoch_ = surface->epoch;
  }
  if (first_surface_ns_ == 0) first_surface_ns_ = surface->t_ns;
  surfaces_.push_back(std::move(surface));
  if (surfaces_.size() > kMaxSurfaces) ForgetASurface();
}

void Mapper::ForgetASurface() {
  if (SecondsFromNs(surfaces_.back()->t_ns - surfaces_.front()->t_ns) > kMaxDepthLatency_s) {
    surfaces_.pop_front();
    return;
  }
  // All of them may be asked for yet.
  surfaces_.erase(surfaces_.begin() +
                  Dispensable(surfaces_.size(), [this](std::size_t i) { return surfaces_[i]->t_ns; }));
}

void Mapper::AddPose(const PoseEstimate& pose) {
  if (pose.epoch != epoch_) return;
  if (!pose.earlier.empty()) {
    poses_.Clear();
  } else if (!poses_.empty()) {
    way_m_ += (pose.T_world_event_edges.translation() - poses_.last().translation()).norm();
  }
  for (const PoseHistory::Stamped& earlier : pose.earlier) poses_.Add(earlier.t_ns, earlier.T_world_event);
  poses_.Add(pose.t_edges_ns, pose.T_world_event_edges);
  if (lost_ && !pose.earlier.empty()) ForgetDepthBeforeLoss();
  velocity_ = pose.velocity_event;
  velocity_of_poses_ = pose.velocity_of_poses;
  covariance_ = pose.covariance_in_chapter;
  delays_ = pose.delays;
  sure_ = pose.state == TrackingState::kTracking;
  trackable_ = pose.state == TrackingState::kTracking || pose.state == TrackingState::kDegraded ||
               pose.state == TrackingState::kRecovered;
  if (trackable_ && !map_.empty() && pose.chapter != map_.chapter()) map_.ReturnTo(pose.chapter);
  lost_ = pose.state == TrackingState::kLost;
  begin_chapter_ = pose.needs_map && pose.chapter == map_.chapter() && !map_.empty();
}

void Mapper::ForgetDepthBeforeLoss() {
  constexpr double kSameStart_s = 0.02;
  if (last_match_.surface && poses_.At(last_match_.surface->t_edges_ns, kSameStart_s)) return;
  last_match_ = Match();
  occluder_.reset();
  lidar_.Clear();
}

void Mapper::AddDepth(const DepthImage& depth) {
  ++counters_.depth_in;
  const std::int64_t t_ns = depth.t_ns + NsFromSeconds(delays_.EventsAfterDepth_s());
  // What is later than this one had a wrong stamp, and would hold it up.
  while (!depths_.empty() && depths_.back().t_ns > t_ns) depths_.pop_back();
  if (depths_.empty()) move_.reset();
  depths_.push_back(depth);
  depths_.back().t_ns = t_ns;
  // They carry the odometry through a gap of the events, all of it: the first ones as much as the last.
  if (depths_.size() <= kMaxDepths) return;
  depths_.erase(depths_.begin() + Dispensable(depths_.size(), [this](std::size_t i) { return depths_[i].t_ns; }));
}

void Mapper::AddSweep(LidarSweep sweep) {
  ++counters_.depth_in;
  const std::int64_t event_delay_ns = NsFromSeconds(delays_.event_s);
  sweep.end_ns += event_delay_ns;
  for (LidarPoint& point : sweep.points) point.t_ns += event_delay_ns;
  sweeps_.push_back(std::move(sweep));
  if (sweeps_.size() > kMaxSweeps) sweeps_.pop_front();
}

SurfacePtr Mapper::SurfaceFor(std::int64_t t_ns) const {
  SurfacePtr best;
  for (const SurfacePtr& surface : surfaces_) {
    if (!best || std::abs(surface->t_edges_ns - t_ns) < std::abs(best->t_edges_ns - t_ns)) best = surface;
  }
  return best;
}

bool Mapper::IsOfItsTime(const Surface& surface, std::int64_t depth_ns) {
  const double after_s = SecondsFromNs(surface.t_edges_ns - depth_ns);
  if (std::abs(after_s) <= options_.surface.max_window_s + 1.0 / options_.surface.rate_hz) return true;
  if (depth_ns > first_surface_ns_) ++counters_.depth_too_late;
  return false;
}

void Mapper::ForgetSurfacesBefore(const SurfacePtr& surface) {
  while (surfaces_.front() != surface) surfaces_.pop_front();
}

LocalMapPtr Mapper::Update() {
  bool changed = options_changed_ && !map_.empty();
  const Change by_depth = rig_.depth_from_lidar ? Change{UpdateFromSweeps(), false} : UpdateFromDepth();
  changed |= by_depth.any;
  changed |= map_.empty() && BeginFromRest();
  changed |= ObserveBetweenDepths();
  return changed || ViewMoved() ? MakeLocalMap(by_depth.found) : nullptr;
}

bool Mapper::IsDepthReady() const {
  if (depths_.empty() || surfaces_.empty() || surfaces_.back()->t_edges_ns < depths_.front().t_ns) return false;
  // With a map, wait for the pose of the surface.
  return map_.empty() || (!poses_.empty() && poses_.last_time_ns() >= surfaces_.back()->t_edges_ns);
}

void Mapper::AlignDepth() {
  if (!move_ && IsDepthReady()) move_ = MoveBy(depths_.front());
}

Mapper::Change Mapper::UpdateFromDepth() {
  Change change;
  while (IsDepthReady()) {
    AlignDepth();
    const DepthImage& depth = depths_.front();
    const Move move = *std::exchange(move_, std::nullopt);
    const SurfacePtr surface = SurfaceFor(depth.t_ns);
    bool added = false;
    if (IsOfItsTime(*surface, depth.t_ns) && !move.repeated) {
      if (map_.empty() && (surface->still || surface->maybe_noise)) depth_of_rest_.Keep(depth, *surface);
      const bool first = map_.empty();
      added = Process(depth, surface, move, &counters_);
      if (first && !map_.empty()) first_depth_ = {depth, false};
    }
    depths_.pop_front();
    ForgetSurfacesBefore(surface);
    change.any |= added;
    change.found = added && move.found;
    if (change.found) break;
  }
  return change;
}

double Mapper::DoubtfulFrom(std::int64_t t_ns) const {
  if (!velocity_of_poses_ || !options_.tracking.ideas.doubt_events) return kHardlyTheSame;
  if (!sure_) return 0;
  const bool soon = SecondsFromNs(t_ns - last_match_.depth.t_ns) < kInQuickSuccession_s;
  return soon ? kDoubtfulAlone : kHardlyTheSame;
}

DepthKeyframes::View Mapper::ViewAt(std::int64_t t_ns, const Rigid3& T_world_event) const {
  DepthKeyframes::View view;
  view.T_world_event = T_world_event;
  // Poses alone are too noisy to tell a velocity within hundredths of a second.
  view.velocity_event = velocity_of_poses_ ? velocity_ : poses_.VelocityAt(t_ns).value_or(velocity_);
  view.delay_s = delays_.EventsAfterDepth_s();
  view.delay_sigma_s = delays_.depth_sigma_s;
  view.chapter = map_.chapter();
  view.trusted = trackable_;
  view.lost = lost_;
  view.turn_known = !velocity_of_poses_;
  view.covariance = covariance_;
  view.doubtful_from = DoubtfulFrom(t_ns);
  return view;
}

void Mapper::KeepFirstDepth() {
  const auto first = std::exchange(first_depth_, std::nullopt);
  // By events alone, poses so soon after a start are worse than those of the next image.
  if (!first || velocity_of_poses_) return;
  const auto T_world_then = poses_.At(first->depth.t_ns, 0.05);
  if (!T_world_then) return;
  // In motion, the next image's pose is the better known one.
  depth_keyframes_.KeepFirst(first->depth, ViewAt(first->depth.t_ns, *T_world_then), !first->of_rest);
}

Mapper::Move Mapper::MoveBy(const DepthImage& depth) {
  if (!options_.mapping.align_depth || map_.empty()) return Move();
  KeepFirstDepth();
  const auto T_world_then = poses_.At(depth.t_ns, 0.05);
  if (!T_world_then) return Move();
  if (depth_repeats_.IsRepeat(depth.depth_m, *T_world_then)) {
    ++counters_.depth_repeated;
    return {Rigid3(), /*found=*/false, /*repeated=*/true};
  }
  auto pose = depth_keyframes_.Align(depth, ViewAt(depth.t_ns, *T_world_then));
  counters_.depth_jumps = depth_keyframes_.jumps();
  counters_.depth_without_thing = depth_keyframes_.without_things();
  if (!pose) return Move();
  ++counters_.depth_aligned;
  pose->t_ns = depth.t_ns;
  pose->epoch = epoch_;
  depth_poses_.push_back(*pose);
  const bool found = lost_ && pose->confirmed;
  const Rigid3 T_world_event = found ? pose->T_world_event : Corrected(*T_world_then, covariance_, *pose);
  depth_repeats_.Note(depth.depth_m, T_world_event, *pose);
  return {T_world_event * T_world_then->inverse(), found};
}

bool Mapper::BeginFromRest() {
  if (!options_.mapping.ideas.depth_of_rest) return false;
  for (const SurfacePtr& surface : surfaces_) {
    if (!depth_of_rest_.Fits(*surface)) continue;
    MappingCounters again;  // the image was counted when it came
    if (!Process(*depth_of_rest_.depth(), surface, Move(), &again)) continue;
    first_depth_ = {*depth_of_rest_.depth(), true};
    return true;
  }
  return false;
}

bool Mapper::UpdateFromSweeps() {
  bool changed = false;
  while (!sweeps_.empty() && !surfaces_.empty() && surfaces_.back()->t_edges_ns >= sweeps_.front().end_ns) {
    if (!map_.empty() && (poses_.empty() || poses_.last_time_ns() < surfaces_.back()->t_edges_ns)) break;
    const LidarSweep sweep = std::move(sweeps_.front());
    sweeps_.pop_front();
    // Without poses the surface of the time in which the sweep passed the view; with them the newest.
    const auto t_ns = map_.empty() || begin_chapter_ ? lidar_.TimeInView(sweep) : sweep.end_ns;
    const SurfacePtr surface = t_ns ? SurfaceFor(*t_ns) : nullptr;
    if (surface) ForgetSurfacesBefore(surface);
    // With a map, poses tell how the sweep lies to another time.
    const bool begins = map_.empty() || begin_chapter_;
    if (surface && begins && !IsOfItsTime(*surface, *t_ns)) continue;
    const auto depth = surface ? DepthOf(sweep, *surface) : std::nullopt;
    if (depth) {
      changed |= Process(*depth, surface, Move(), &counters_);
    } else {
      ++counters_.depth_without_valid_pixel;
    }
  }
  return changed;
}

std::optional<DepthImage> Mapper::DepthOf(const LidarSweep& sweep, const Surface& surface) {
  if (map_.empty()) {
    lidar_.Start(sweep, Rigid3());
    lidar_depth_ = lidar_.Render(surface.t_edges_ns, Rigid3());
    return lidar_depth_;
  }
  const auto T_world_surface = poses_.At(surface.t_edges_ns, 0.05);
  if (!T_world_surface) return std::nullopt;
  // Extrapolated poses would smear the accumulated points for as long as they are kept, and where a chapter begins they
  // say nothing of how the sweeps before lie to it.
  if (begin_chapter_) {
    lidar_.Start(sweep, *T_world_surface);
  } else if (trackable_) {
    lidar_.Add(sweep, poses_);
  }
  lidar_depth_ = lidar_.Render(surface.t_edges_ns, *T_world_surface);
  return lidar_depth_;
}

bool Mapper::Process(const DepthImage& depth, const SurfacePtr& surface, const Move& move, MappingCounters* of_depth) {
  Rigid3 T_world_event, T_surface_depthtime;
  if (!map_.empty()) {
    const auto T_world_surface = poses_.At(surface->t_edges_ns, 0.05), T_world_then = poses_.At(depth.t_ns, 0.05);
    if (!T_world_surface || !T_world_then) return false;
    T_world_event = move.T_moved_world * *T_world_surface;
    if (options_.mapping.ideas.move_depth) T_surface_depthtime = T_world_surface->inverse() * *T_world_then;
  }
  const int readings = registration_.Warp(depth, T_surface_depthtime * rig_.T_event_depth, surface->edges);
  if (readings == 0) {
    ++of_depth->depth_without_valid_pixel;
    return false;
  }
  ++of_depth->depth_used;
  read_share_ = static_cast<double>(readings) / static_cast<double>(depth.depth_m.total());
  scene_depth_ = MakeSceneDepth(depth.t_ns, registration_.nearest_depth());
  T_world_scene_ = T_world_event;
  // At a guessed pose it would hide points that are in view, and be measured where it is not, once the pose is found.
  if (!map_.empty() && !trackable_ && !move.found && !begin_chapter_) return false;
  last_match_ = {depth, surface, T_surface_depthtime * rig_.T_event_depth, velocity_};
  T_world_depth_ = T_world_event * last_match_.T_event_depth;
  if (options_.mapping.ideas.hide_points) {
    occluder_ = ReferenceMap::Occluder{T_world_event, registration_.nearest_depth().clone(), DepthRegistration::kCell};
  } else {
    occluder_.reset();
  }
  if (surface->still || (map_.empty() && surface->maybe_noise)) return false;
  if (move.found) return AddAll(*surface, T_world_event);
  if (begin_chapter_) return BeginChapter(*surface, T_world_event);

  if (!options_.mapping.reuse_references) {
    if (!map_.empty() && !MovedSinceReference(T_world_event)) return false;
    const auto previous = map_;
    map_.ForgetReferences();
    if (AddAll(*surface, T_world_event)) return true;
    map_ = previous;
    return false;
  }
  auto visible = Observe(*surface, T_world_event);
  extended_ns_ = surface->t_edges_ns;
  map_.LeaveGuessed([this](const auto& point) { return registration_.HasReadingAt(point.u, point.v); }, &visible);
  map_.DropUnproven();
  const bool added = AddReference(*surface, T_world_event, map_.ExplainedEdges(*surface, visible));
  DepthGuess guess(visible, camera_);
  return GuessBesideTheMap(*surface, T_world_event, EdgesBesideTheMap(*surface, guess), &guess) || added;
}

std::vector<ReferenceMap::Visible> Mapper::Observe(const Surface& surface, const Rigid3& T_world_event) {
  auto visible = map_.Project(T_world_event, occluder_ ? &*occluder_ : nullptr);
  const bool new_view = ViewsApart(T_world_refined_.inverse() * T_world_event, MedianDepth()) > kNewView;
  if (new_view) T_world_refined_ = T_world_event;
  map_.Observe(surface, visible, {T_world_event, velocity_, options_.surface.edge_lag_px, new_view});
  observed_ns_ = surface.t_edges_ns;
  T_world_observed_ = T_world_event;
  return visible;
}

bool Mapper::ObserveBetweenDepths() {
  if (!options_.mapping.reuse_references || map_.empty() || !trackable_ || surfaces_.empty()) return false;
  const Surface& surface = *surfaces_.back();
  if (surface.still || poses_.empty() || poses_.last_time_ns() != surface.t_edges_ns) return false;
  const Rigid3& T_world_event = poses_.last();
  if (!IsToObserve(surface.t_edges_ns, T_world_event)) return false;
  const auto visible = Observe(surface, T_world_event);
  if (SecondsFromNs(surface.t_edges_ns - extended_ns_) < kObserveEvery_s) return false;
  extended_ns_ = surface.t_edges_ns;
  return ExtendBetweenDepths(surface, T_world_event, visible);
}

bool Mapper::ExtendBetweenDepths(const Surface& surface, const Rigid3& T_world_event,
                                 const std::vector<ReferenceMap::Visible>& visible) {
  if (!last_match_.surface) return false;
  DepthGuess guess(visible, camera_);
  const auto beside = EdgesBesideTheMap(surface, guess);
  const bool scene_moved = SceneMoved(T_world_event);
  if (beside.empty() && !scene_moved) return false;
  ViewLastDepth(T_world_event, beside);
  if (scene_moved) {
    scene_depth_ = MakeSceneDepth(surface.t_edges_ns, registration_.nearest_depth(), visible, scene_depth_.median_m);
    T_world_scene_ = T_world_event;
  }
  if (beside.empty()) return false;
  const bool measured = MeasureBesideTheMap(surface, T_world_event, beside);
  return GuessBesideTheMap(surface, T_world_event, beside, &guess) || measured;
}

bool Mapper::IsToObserve(std::int64_t t_ns, const Rigid3& T_world_event) const {
  if (SecondsFromNs(t_ns - observed_ns_) >= kObserveEvery_s) return true;
  return SecondsFromNs(t_ns - last_match_.depth.t_ns) >= kObserveEvery_s &&
         ViewsApart(T_world_observed_.inverse() * T_world_event, MedianDepth()) > kNewView;
}

bool Mapper::SceneMoved(const Rigid3& T_world_event) const {
  if (!options_.mapping.ideas.follow_scene) return false;
  return ViewsApart(T_world_scene_.inverse() * T_world_event, MedianDepth()) >
         kSceneMoved * SceneDepth::kCell_px / camera_.fx();
}

void Mapper::ViewLastDepth(const Rigid3& T_world_event, const std::vector<const EdgePoint*>& wanted) {
  std::vector<EdgePoint> edges;
  edges.reserve(wanted.size());
  for (const EdgePoint* edge : wanted) edges.push_back(*edge);
  registration_.Warp(last_match_.depth, T_world_event.inverse() * T_world_depth_, edges);
}

bool Mapper::MeasureBesideTheMap(const Surface& surface, const Rigid3& T_world_event,
                                 const std::vector<const EdgePoint*>& beside) {
  std::vector<MapPoint> points;
  registration_.ForDepths(beside, [&](const EdgePoint& edge, const auto& depth) {
    if (depth) points.push_back(MakePoint(edge, depth->z_m, surface.window_s));
    return true;
  });
  if (points.size() < kMinPoints) return false;
  map_.Add(surface.t_edges_ns, T_world_event, std::move(points));
  ++counters_.references;
  return true;
}

bool Mapper::MayGuess() const {
  if (!options_.mapping.ideas.guess_depth || !sure_) return false;
  // Without an inertial sensor nothing else holds the turn.
  if (velocity_of_poses_ || rig_.depth_from_lidar || read_share_ > kReadsMost) return true;
  const double sigma_m = std::sqrt(covariance_.diagonal().head<3>().maxCoeff());
  return sigma_m < std::max(kWayKnown_m, kWayKnownShare * way_m_);
}

std::vector<const EdgePoint*> Mapper::EdgesBesideTheMap(const Surface& surface, const DepthGuess& guess) const {
  std::vector<const EdgePoint*> beside;
  if (!MayGuess()) return beside;
  for (const EdgePoint& edge : surface.edges) {
    if (camera_.Contains({edge.x, edge.y}, kMargin_px) && !guess.IsKnown(edge.x, edge.y)) beside.push_back(&edge);
  }
  if (beside.size() < kMinPoints) beside.clear();
  return beside;
}

bool Mapper::GuessBesideTheMap(const Surface& surface, const Rigid3& T_world_event,
                               const std::vector<const EdgePoint*>& beside, DepthGuess* guess) {
  std::vector<MapPoint> points;
  for (const EdgePoint* edge : beside) {
    if (registration_.IsReadAt(edge->x, edge->y)) continue;
    const float z_m = guess->At(edge->x, edge->y);
    if (z_m > 0) points.push_back(MakePoint(*edge, z_m, surface.window_s));
  }
  if (points.size() < kMinPoints) return false;
  map_.AddGuessed(surface.t_edges_ns, T_world_event, std::move(points));
  return true;
}

bool Mapper::BeginChapter(const Surface& surface, const Rigid3& T_world_event) {
  const int left = map_.chapter();
  map_.BeginChapter();
  if (!AddAll(surface, T_world_event)) {
    map_.ReturnTo(left);
    return false;
  }
  begin_chapter_ = false;  // more depth may wait
  return true;
}

bool Mapper::MovedSinceReference(const Rigid3& T_world_event) const {
  const Rigid3 T_ref_event = map_.references().back().T_world_ref.inverse() * T_world_event;
  return T_ref_event.translation().norm() > options_.mapping.new_reference_distance_m ||
         RotationAngle(T_ref_event) > options_.mapping.new_reference_angle_rad;
}

bool Mapper::AddAll(const Surface& surface, const Rigid3& T_world_event) {
  return AddReference(surface, T_world_event, std::vector<bool>(surface.edges.size(), false));
}

bool Mapper::AddReference(const Surface& surface, const Rigid3& T_world_event, const std::vector<bool>& explained) {
  // Of the explained edges a sample tells how many have depth.
  std::vector<const EdgePoint*> sample, unexplained;
  for (std::size_t i = 0; i < surface.edges.size(); ++i) {
    if (!explained[i]) {
      unexplained.push_back(&surface.edges[i]);
    } else if (i % kExplainedStep == 0) {
      sample.push_back(&surface.edges[i]);
    }
  }
  std::size_t explained_with_depth = 0;
  registration_.ForDepths(sample, [&](const EdgePoint&, const auto& depth) {
    explained_with_depth += depth ? kExplainedStep : 0;
    return true;
  });
  const std::size_t least = map_.chapter_empty() ? kMinPointsOfFirst : kMinPoints;
  const auto enough = [&](std::size_t new_points) {
    const auto with_depth = static_cast<double>(new_points + explained_with_depth);
    return new_points >= least && static_cast<double>(new_points) > (1 - options_.mapping.min_coverage) * with_depth;
  };
  std::vector<MapPoint> points;
  std::size_t left = unexplained.size();
  if (!enough(left)) return false;
  registration_.ForDepths(unexplained, [&](const EdgePoint& edge, const auto& depth) {
    if (depth) points.push_back(MakePoint(edge, depth->z_m, surface.window_s));
    // Most often the map explains nearly all: no need to know the depth of the rest.
    return enough(points.size() + --left);
  });
  if (!enough(points.size())) return false;
  map_.Add(surface.t_edges_ns, T_world_event, std::move(points));
  ++counters_.references;
  return true;
}

MapPoint Mapper::MakePoint(const EdgePoint& edge, float z_m, double window_s) const {
  const auto at = [&](float x_px, float y_px) -> Eigen::Vector3f {
    return z_m * Eigen::Vector3f((x_px - static_cast<float>(camera_.cx())) / static_cast<float>(camera_.fx()),
                                 (y_px - static_cast<float>(camera_.cy())) / static_cast<float>(camera_.fy()), 1);
  };
  const float across_px = Eigen::Vector2f(edge.nx, edge.ny).dot(ImageVelocity(velocity_, at(edge.x, edge.y), camera_)) *
                          static_cast<float>(window_s);
  const float lag_px =
      EdgeLagPx(LagStrength(across_px, 0, static_cast<float>(options_.surface.edge_lag_px)), edge.strength);
  MapPoint point;
  point.p_ref = at(edge.x + lag_px * edge.nx, edge.y + lag_px * edge.ny);
  point.normal_ref = Eigen::Vector3f(edge.nx, edge.ny, 0);
  // Where brightness grows along the normal, a pixel that the edge passes along the normal turns darker.
  if (std::abs(across_px) > kClearMotion_px && std::abs(edge.polarity) > kClearPolarity) {
    point.sign = std::copysign(1.0F, -edge.polarity * across_px);
  }
  return point;
}

double Mapper::MedianDepth() const { return scene_depth_.median_m > 0 ? scene_depth_.median_m : 1.0; }

bool Mapper::ViewMoved() const {
  if (!options_.mapping.reuse_references || map_.empty() || !T_world_local_ || poses_.empty() || !trackable_)
    return false;
  const Rigid3 T_local_event = T_world_local_->inverse() * poses_.last();
  return T_local_event.translation().norm() > kViewShare * MedianDepth() ||
         RotationAngle(T_local_event) > kViewAngle_rad;
}

LocalMapPtr Mapper::MakeLocalMap(bool found_by_depth) {
  auto local = std::make_shared<LocalMap>();
  local->found_by_depth = found_by_depth;
  const bool of_reference = poses_.empty() || found_by_depth;
  local->T_world_ref = of_reference ? map_.references().back().T_world_ref : poses_.last();
  local->t_ns = of_reference ? map_.references().back().t_ns : poses_.last_time_ns();
  local->epoch = epoch_;
  local->id = local_maps_++;
  local->chapter = map_.chapter();
  const auto visible = map_.Project(local->T_world_ref, occluder_ ? &*occluder_ : nullptr);
  local->points = map_.Select(visible, local->T_world_ref);
  T_world_local_ = local->T_world_ref;
  options_changed_ = false;
  return local;
}

}  // namespace devo
