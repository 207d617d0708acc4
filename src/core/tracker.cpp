// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

#include "devo/core/alignment.h"
#include "devo/core/depth_image.h"
#include "devo/core/start_from_rest.h"
#include "devo/core/start_velocity.h"
#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kEdgeSigma_px = 0.5;
constexpr double kInertialCoast_s = 2;  // lost, it still tells where the camera goes for so long
constexpr double kBetterBy = 0.1;       // of all points, that a better pose must match more
// Before it was noticed that a pose is false, it was stated to be certain. Also in radians, but a gyroscope that fits
// has followed the rotation.
constexpr double kUnknown_m = 0.15, kInertialUnknown_m = 0.015, kInertialUnknown_rad = 0.005;
// Where an inertial sensor led, what is known of the pose is worth more than a few matches: of such errors one in
// twenty is larger, and of the views that match farther off most are others that look alike.
constexpr double kInertialMostSquare = 12.6;
// Lost for this long while there are events, the view is most likely a new one.
constexpr double kGiveUp_s = 1;
// So soon after depth agreed the prediction is more than a motion that is thought to go on.
constexpr double kDepthLeads_s = 0.1;
// Within this time after depth agreed, a pose, or one that an inertial sensor leads, does not go so far astray that a
// search knows better.
constexpr double kRulesOutSearch_s = 0.1, kInertialRulesOutSearch_s = 0.25;
// So many depth images in a row that contradict a pose without events are right. At a gap's beginning there is no pose
// for tens of milliseconds, and what lies between two is a guess that depth contradicts where the motion changes fast:
// what an inertial sensor led to is not given up for that.
constexpr int kContradictions = 2, kInertialContradictions = 6;
constexpr double kMaxBefore = 0.25;  // of the time between two images, that lies before a standstill
constexpr double kHeld_m = 5e-3;     // a pose is held as if it were known so well: farther off, the camera has moved
// Two poses found within this time tell the velocity, if it is one.
constexpr double kStartsTogether_s = 0.1, kMaxStart_m_s = 3, kMaxStart_rad_s = 8;
// Two depth images tell one within this time: in a longer one, fast motions have turned round.
constexpr double kTellsVelocity_s = 0.12;
// Dark pixels answer later than bright ones: of the delay of events, which is their mean, so much is the standard
// deviation of what the edges in view have of it together.
constexpr double kDelaySpread = 0.5;
// An inertial sensor averages what each alignment errs by itself: errors of poses that it guides grow less than by how
// far points miss their edges.
constexpr double kGuidedExponent = 0.7;
// Where a motion begins slowly, or few edges show it, this long passes before events tell that a rest is over. An
// inertial sensor that was held to stand meanwhile would lead on without the velocity that it missed.
constexpr double kBeginsUnseen_s = 0.2;
// Of a start's velocity that surfaces show beside a gyroscope's turn, where few edges show one direction of it.
constexpr double kSeenSpeed_m_s = 1;

// A turn sought in the events leaves edges blurred, and surfaces that have most of their events in common blurred
// alike: beside an inertial sensor, which goes on from the velocity that they show, those of a start count for so much.
constexpr double kBlurredAlike = 0.2;
// What events get wrong beyond what is stated they get wrong alike in surface after surface, which count for less
// together than each.
constexpr double kMisfitPower = 2;
// Events of so long make a surface, about.
constexpr double kTurnSpan_s = 0.02;
// Of surfaces that come more often than this, not all wait for a map: it is to be met within a moment.
constexpr std::int64_t kWaitingStep_ns = 9'000'000;

/// An alignment counts in pixels per point: the root of the filter's information is brought to that scale, and back.
double ScaleOf(const ErrorsAlike& alike) { return kEdgeSigma_px * std::sqrt(alike.own); }

/// The velocity [v; omega] of a camera that turns as its events say.
Vector6d TurningWith(const Surface& surface) {
  Vector6d velocity = Vector6d::Zero();
  velocity.tail<3>() = surface.turn_event;
  return velocity;
}

}  // namespace

Tracker::Tracker(const Camera& event_camera, const OdometryOptions& options)
    : options_(options), camera_(event_camera.Undistorted()), motion_(options.tracking),
      standstill_(options.surface.rate_hz, options.surface.still_activity_hz), relocalizer_(camera_, options),
      status_(options.surface.rate_hz) {}

void Tracker::SetOptions(const OdometryOptions& options) {
  options_ = options;
  motion_.SetOptions(options.tracking);
  past_.SetOptions(options.tracking);
  standstill_.SetRates(options.surface.rate_hz, options.surface.still_activity_hz);
  relocalizer_.SetOptions(options);
  status_.SetRate(options.surface.rate_hz);
}

void Tracker::SetMap(LocalMapPtr map) {
  // One of the epoch before may have been on its way.
  if (map->epoch < epoch_) return;
  relocalizer_.Remember(map);
  const bool begins = map_ && map->epoch == map_->epoch && (map->chapter != map_->chapter || map->found_by_depth);
  if (begins && !status_.lost()) return;
  if (begins && !map->found_by_depth) NoteChapter(*map);
  map_ = std::move(map);
  if (begins) BeginAnew();
}

void Tracker::NoteChapter(const LocalMap& begun) {
  // Where it lies is as unsure as the pose that it begins at, and that as the chapter before.
  const Matrix6d before = CovarianceOfChapter(map_->chapter, begun.T_world_ref);
  chapters_.emplace(begun.chapter, Chapter{begun.T_world_ref, motion_.pose_covariance() + before});
}

Matrix6d Tracker::CovarianceOfChapter(int chapter, const Rigid3& T_world_event) const {
  if (chapter == 0) return Matrix6d::Zero();
  const auto known = chapters_.find(chapter);
  if (known == chapters_.end())
    return Matrix6d::Identity();  // begun while tracking was found: at a guess, nothing more
  const Matrix6d Ad_event_begin = Adjoint(T_world_event.inverse() * known->second.T_world_begin);
  return Ad_event_begin * known->second.covariance * Ad_event_begin.transpose();
}

void Tracker::BeginAnew() {
  NoteNewView();
  const auto first = std::find_if(waiting_.begin(), waiting_.end(),
                                  [this](const SurfacePtr& surface) { return surface->t_edges_ns > map_->t_ns; });
  if (first != waiting_.end()) {
    StartInMotion(**first);
  } else {
    StartAt(map_->t_ns, map_->T_world_ref, VelocitySinceStart(map_->t_ns, map_->T_world_ref));
  }
}

void Tracker::AddDepthPose(const DepthPose& depth) {
  if (!map_ || depth.epoch != epoch_ || depth.chapter != map_->chapter || !motion_.started()) return;
  auto then = past_.At(depth.t_ns, motion_, inertial_);
  if (!then) return;
  const Rigid3 T_world_then = then->pose();
  Matrix6d covariance = then->pose_covariance();
  if (held()) covariance *= std::min(1.0, kHeld_m * kHeld_m / covariance.diagonal().head<3>().maxCoeff());
  DepthFusion::Estimate estimate;
  estimate.T_world_event = T_world_then;
  estimate.covariance = covariance;
  estimate.variance_scale = residual_scale_.variance_scale();
  estimate.guided = inertial_prior_;
  estimate.event_delay_s = DelayAgainstInertial();
  estimate.doubtful = status_.doubtful();
  NoteMisfit(depth, T_world_then, covariance);
  const auto correction = depth_fusion_.Correct(depth, estimate);
  const bool was_false = correction && correction->widened > 1;
  if (was_false && !held() && GoesAstrayAgain()) {
    StartByDepth(depth, depth_fusion_.velocity_event());
  } else if (correction && !held()) {
    using Since = MotionPast::Since;
    // Along an inertial sensor's readings, a pose goes astray with its velocity and with what is taken for gravity.
    if (inertial_prior_) {
      then->Widen(correction->widened);
    } else {
      then->WidenPose(correction->widened);
    }
    then->Update(depth.t_ns, T_world_then * Exp(correction->moved), correction->information);
    motion_ = past_.Again(*then, inertial_, &history_, was_false ? Since::kMotion : Since::kPlaces);
  } else if ((!correction && depth.KnowsAllDirections()) || IsSeenMoving()) {
    Contradict(depth, depth.T_world_event * (T_world_then.inverse() * motion_.pose()));
  }
}

void Tracker::NoteMisfit(const DepthPose& depth, const Rigid3& T_world_then, const Matrix6d& covariance) {
  if (inertial_prior_ || !depth.KnowsAllDirections() || !options_.tracking.ideas.doubt_events) return;
  const double square = depth.SquareApart(T_world_then, covariance);
  events_misfit_.Note(depth.t_ns, square, depth.confirmed || status_.doubtful());
}

double Tracker::MisfitAt(std::int64_t t_ns) const { return inertial_prior_ ? 1 : events_misfit_.TimesAt(t_ns); }

bool Tracker::GoesAstrayAgain() const {
  const bool knows_velocity = depth_fusion_.KnowsVelocity(kTellsVelocity_s);
  return knows_velocity && !inertial_prior_ && depth_fusion_.replacements() > 1;
}

void Tracker::StartByDepth(const DepthPose& depth, const Vector6d& velocity_event) {
  const std::int64_t now_ns = motion_.time_ns();
  StartAt(now_ns, depth.T_world_event * Exp(velocity_event * SecondsFromNs(now_ns - depth.t_ns)), velocity_event);
  status_.NoteGuess();
}

bool Tracker::IsSeenMoving() const { return held() && depth_fusion_.SawMotionSince(standstill_.held_since_ns()); }

void Tracker::Contradict(const DepthPose& depth, const Rigid3& T_world_now) {
  const bool by_events = !held() && !standstill_.coasting() && !status_.lost();
  if (by_events) T_world_by_depth_ = T_world_now;
  const bool sure_of_events = by_events && !status_.MatchesNothing();
  const bool inertial = standstill_.coasting() && inertial_prior_ && !status_.lost();
  const int least = inertial ? kInertialContradictions : kContradictions;
  if (sure_of_events || (depth_fusion_.contradictions() < least && !IsSeenMoving())) return;
  // What two images span of the motion before a standstill says nothing of now.
  const std::int64_t since_ns = depth_fusion_.velocity_since_ns();
  const bool of_now = !held() || static_cast<double>(standstill_.last_events_ns() - since_ns) <=
                                     kMaxBefore * static_cast<double>(depth.t_ns - since_ns);
  StartByDepth(depth, of_now ? depth_fusion_.velocity_event() : Vector6d(Vector6d::Zero()));
  standstill_.MoveOn(motion_.time_ns());
}

void Tracker::NoteNewView() {
  status_.NoteNewView(map_->t_ns);
  follow_ = true;
}

Vector6d Tracker::VelocitySinceStart(std::int64_t t_ns, const Rigid3& T_world_event) const {
  const double since_s = SecondsFromNs(t_ns - started_ns_);
  if (!(since_s > 0 && since_s < kStartsTogether_s)) return Vector6d::Zero();
  const Vector6d velocity = Log(T_world_started_.inverse() * T_world_event) / since_s;
  const bool possible = velocity.head<3>().norm() <= kMaxStart_m_s && velocity.tail<3>().norm() <= kMaxStart_rad_s;
  return possible ? velocity : Vector6d(Vector6d::Zero());
}

void Tracker::StartAt(std::int64_t t_ns, const Rigid3& T_world_event, const Vector6d& velocity,
                      double speed_sigma_m_s) {
  motion_.Start(t_ns, T_world_event, velocity, speed_sigma_m_s);
  NoteStart();
}

void Tracker::NoteStart() {
  past_.Clear();
  history_.Clear();
  started_ns_ = motion_.time_ns();
  T_world_started_ = motion_.pose();
  rested_.clear();
  T_world_by_depth_.reset();
  anew_ = true;
}

void Tracker::BeginEpoch(std::uint64_t epoch) {
  if (epoch == epoch_) return;
  Reset();
  epoch_ = epoch;
}

void Tracker::Reset() {
  map_.reset();
  motion_.Reset();
  past_.Clear();
  history_.Clear();
  depth_fusion_.Reset();
  events_misfit_ = EventsMisfit();
  standstill_.Clear();
  T_world_by_depth_.reset();
  inertial_.Clear();
  trial_ = {};
  rest_.Clear();
  relocalizer_.Clear();
  status_.Reset();
  residual_scale_ = ResidualScale();
  inertial_prior_ = follow_ = anew_ = false;
  chapters_.clear();
  rested_.clear();
  started_ns_ = 0;
  T_world_started_ = T_world_before_ = Rigid3();
}

Vector6d Tracker::SurfaceVelocity() const {
  return history_.empty() ? Vector6d(Vector6d::Zero()) : motion_.velocity_event();
}

std::optional<Eigen::Vector3d> Tracker::TurnRead(std::int64_t t_ns) const {
  const auto read = inertial_.Mean(t_ns - NsFromSeconds(kTurnSpan_s), t_ns);
  return read ? std::make_optional(read->angular_velocity) : std::nullopt;
}

std::optional<PoseEstimate> Tracker::Track(const Surface& surface) {
  BeginEpoch(surface.epoch);
  if (!motion_.started()) {
    rest_.NoteUntil(surface.t_ns, surface.maybe_noise, inertial_);
  }
  if (!map_ || map_->epoch != surface.epoch) return std::nullopt;
  if (!motion_.started()) Begin(surface);

  PoseEstimate pose;
  pose.t_ns = surface.t_ns;
  pose.epoch = surface.epoch;
  pose.reference_id = map_->id;
  const bool still = surface.still || IsNoise(surface);
  const bool rested = held();
  const MotionPast::Kind kind = standstill_.Judge(surface, still, Known());
  if (rested && !still) LeaveRest();
  if (surface.t_edges_ns > motion_.time_ns()) Step(surface, kind, &pose);
  TryInertial();
  NoteActivity(surface, still, pose);
  status_.NoteSurface(surface.t_ns, still);
  pose.needs_map = !still && status_.UnseenFor_s(surface.t_ns) > kGiveUp_s;
  pose.chapter = map_->chapter;
  pose.state = status_.state();
  pose.inertial_fit = InertialFitNow();
  if (pose.inertial_fit.gyroscope > 0) pose.inertial_calibration = motion_.state().Calibration();
  if (std::exchange(anew_, false)) {
    pose.earlier = std::exchange(rested_, {});
    pose.earlier.push_back({started_ns_, T_world_started_});
  }
  ContinueToNow(&pose);
  return pose;
}

void Tracker::Step(const Surface& surface, MotionPast::Kind kind, PoseEstimate* pose) {
  const MotionFilter before = motion_;
  step_ = {surface.t_edges_ns, kind};
  if (kind == MotionPast::Kind::kMoving) {
    Register(surface, pose);
  } else if (kind == MotionPast::Kind::kCoasting) {
    Coast(surface.t_edges_ns);
  } else {
    HoldStill(surface.t_edges_ns, pose);
  }
  if (motion_.time_ns() > started_ns_) past_.Note(before, step_);
  history_.Add(motion_.time_ns(), motion_.pose());
}

void Tracker::Begin(const Surface& surface) {
  NoteNewView();
  if (BeginFromRest()) return;
  StartInMotion(surface);
  if (const auto push = inertial_.MeanPush(map_->t_ns)) motion_.LearnGravity(push->force, push->span_s);
}

void Tracker::StartInMotion(const Surface& surface) {
  if (const auto read = inertial_.Mean(map_->t_ns, surface.t_edges_ns)) {
    StartAt(map_->t_ns, map_->T_world_ref, VelocityBeside(read->angular_velocity, surface), kSeenSpeed_m_s);
  } else {
    StartAt(map_->t_ns, map_->T_world_ref, TurningWith(surface));
  }
}

Vector6d Tracker::VelocityBeside(const Eigen::Vector3d& turn_event, const Surface& surface) const {
  std::vector<StartView> views;
  const auto look_at = [&](const Surface& seen) {
    if (const auto view = ViewSince(*map_, seen, inertial_)) views.push_back(*view);
  };
  for (const SurfacePtr& waiting : waiting_) look_at(*waiting);
  if (views.empty()) look_at(surface);
  Vector6d velocity = Vector6d::Zero();
  velocity.head<3>() = FindStartVelocity(*map_, views, camera_);
  velocity.tail<3>() = turn_event;
  return velocity;
}

bool Tracker::BeginFromRest() {
  const auto rest = rest_.last_rest();
  if (!options_.tracking.ideas.start_from_rest || !rest) return false;
  const auto start = FollowFromRest(*rest, *map_, inertial_, options_.tracking);
  if (!start) return false;
  motion_ = start->motion;
  NoteStart();
  rested_ = start->rested;
  status_.NoteKnown();
  standstill_.FollowedUntil(map_->t_ns);
  return true;
}

bool Tracker::IsNoise(const Surface& surface) const {
  return surface.maybe_noise && !status_.lost() && status_.MatchesNothing();
}

void Tracker::NoteActivity(const Surface& surface, bool still, const PoseEstimate& pose) {
  const double since_s = SecondsFromNs(surface.t_ns - standstill_.last_active_ns());
  const bool known = !still && status_.trusted();
  const double flow_px_s = known ? Known().Flow(SurfaceVelocity()) : 0;
  standstill_.Note(surface, still, flow_px_s);
  if (known) residual_scale_.Note(since_s, pose.mean_residual_px, flow_px_s);
}

TrackedMotion Tracker::Known() const { return {motion_, inertial_, depth_fusion_, *map_, camera_, status_.lost()}; }

void Tracker::ContinueToNow(PoseEstimate* pose) const {
  pose->t_edges_ns = motion_.time_ns();
  pose->T_world_event_edges = motion_.pose();
  pose->delays = Delays();
  const std::int64_t t_shown_ns = pose->t_ns + NsFromSeconds(pose->delays.event_s);
  const auto now = held() ? motion_.AtRest() : PredictAt(motion_, t_shown_ns, inertial_);
  pose->T_world_event = now.T_world_event;
  pose->velocity_event = SurfaceVelocity();
  pose->velocity_of_poses = !inertial_prior_;
  if (inertial_prior_ && !held()) pose->acceleration_event = motion_.acceleration_event();
  pose->covariance_in_chapter = pose->covariance_event = StatedCovariance(now, pose->delays.event_s);
  pose->covariance_event += CovarianceOfChapter(map_->chapter, pose->T_world_event);
}

double Tracker::DelayAgainstInertial() const { return std::max(0.0, motion_.state().delay_s); }

SensorDelays Tracker::Delays() const {
  SensorDelays delays = DelaysOf(motion_.state().delay_s, depth_fusion_.delay().Get(DelayAgainstInertial()));
  delays.depth_sigma_s = std::sqrt(depth_fusion_.delay().variance_s2());
  return delays;
}

Matrix6d Tracker::StatedCovariance(const MotionFilter::Prediction& now, double event_delay_s) const {
  const double by_residuals = std::pow(residual_scale_.variance_scale(), inertial_prior_ ? kGuidedExponent : 1);
  const double by_depth = depth_fusion_.VarianceScale(motion_.time_ns(), inertial_prior_);
  Matrix6d covariance = by_depth * by_residuals * MisfitAt(motion_.time_ns()) * now.covariance;
  // Without an inertial sensor nothing says which of events and depth is late against the other.
  const double clock_variance_s2 = inertial_prior_
                                       ? motion_.delay_variance_s2() + std::pow(kDelaySpread * event_delay_s, 2)
                                       : std::pow(depth_fusion_.delay().Get(0), 2);
  covariance += clock_variance_s2 * now.velocity_event * now.velocity_event.transpose();
  return covariance;
}

void Tracker::LeaveRest() {
  const std::int64_t begun_ns = motion_.time_ns() - NsFromSeconds(kBeginsUnseen_s);
  if (const auto moving = past_.AgainInMotion(begun_ns, inertial_, &history_)) motion_ = *moving;
}

std::optional<PoseEstimate> Tracker::Track(const SurfacePtr& surface) {
  if (!waiting_.empty() && waiting_.back()->epoch != surface->epoch) waiting_.clear();
  std::vector<PoseHistory::Stamped> earlier;
  if (map_ && (follow_ || !motion_.started())) {
    for (const SurfacePtr& waited : waiting_) {
      if (waited->epoch != map_->epoch || waited->t_edges_ns <= map_->t_ns) continue;
      const auto pose = Track(*waited);
      if (!pose) continue;
      if (!pose->earlier.empty()) earlier = pose->earlier;
      earlier.push_back({pose->t_edges_ns, pose->T_world_event_edges});
    }
    follow_ = false;
    waiting_.clear();
  }
  auto pose = Track(*surface);
  if (pose && pose->earlier.empty()) pose->earlier = std::move(earlier);
  if (!pose || pose->state == TrackingState::kLost) {
    const bool often = !waiting_.empty() && surface->t_ns - waiting_.back()->t_ns < kWaitingStep_ns;
    if (!often) waiting_.push_back(surface);
    while (SecondsFromNs(surface->t_ns - waiting_.front()->t_ns) >= kMaxDepthLatency_s) waiting_.pop_front();
  } else {
    waiting_.clear();
  }
  return pose;
}

void Tracker::TryInertial() {
  const InertialFit fit = motion_.inertial_fit();
  const bool used =
      trial_.Judge({motion_.time_ns(), motion_.pose(), status_.trusted(), !held()}, fit.gyroscope, inertial_);
  const bool left_out = inertial_.used() && !used;
  inertial_.SetUsed(used);
  if (!left_out) return;
  unfit_ = fit;
  inertial_prior_ = false;
  motion_.ForgetInertial();
  auto then = past_.Oldest();
  if (!then) return;
  then->ForgetInertial();
  motion_ = past_.Again(*then, inertial_, &history_);
}

InertialFit Tracker::InertialFitNow() const {
  InertialFit fit = inertial_.used() ? motion_.inertial_fit() : unfit_;
  fit.gyroscope_noise = std::sqrt(inertial_.noise().turn_rad2_s);
  fit.accelerometer_noise = std::sqrt(inertial_.noise().push_m2_s3);
  fit.left_out = !inertial_.used() || IsTooNoisy(fit.gyroscope_noise);
  return fit;
}

bool Tracker::IsLed() const { return inertial_prior_ || depth_fusion_.AgreedWithin(kDepthLeads_s, motion_.time_ns()); }

void Tracker::HoldStill(std::int64_t t_ns, PoseEstimate* pose) {
  T_world_by_depth_.reset();
  motion_.HoldStill(t_ns, ReadSince(motion_, t_ns, inertial_));
  pose->inlier_share = 1;
  status_.NoteStandstill();
}

void Tracker::Coast(std::int64_t t_ns) {
  if (!status_.doubtful()) T_world_before_ = motion_.pose();
  step_.kind = MotionPast::Kind::kCoasting;
  T_world_by_depth_.reset();
  step_.inertial = AdvanceTo(t_ns, inertial_, &motion_);
  if (!step_.inertial) {
    motion_.Coast(t_ns);
    inertial_prior_ = false;
  }
  status_.NoteGuess();
  NoteMatch(0);
}

PosePrior Tracker::MakePrior(const MotionFilter::Prediction& predicted, double scale) const {
  PosePrior prior;
  prior.T_event_ref = predicted.T_world_aligned.inverse() * map_->T_world_ref;
  const Matrix6d information = predicted.aligned_covariance.ldlt().solve(Matrix6d::Identity());
  prior.position_covariance = predicted.aligned_covariance.topLeftCorner<3, 3>();
  prior.sqrt_velocity_covariance = predicted.velocity_covariance.llt().matrixL();
  // Beside an inertial sensor, whose errors go on growing, a direction that is held weakly and for a wrong reason is
  // better off than one that is not held.
  prior.doubt_normals = options_.tracking.ideas.noise_of_normals && !inertial_prior_;
  prior.sqrt_information = scale * information.llt().matrixU().toDenseMatrix();
  if (!options_.tracking.ideas.motion_prior) prior.sqrt_information = kNoPrior * Matrix6d::Identity();
  return prior;
}

ErrorsAlike Tracker::ErrorsAlikeIn(const Surface& surface) const {
  AlignedPoints of;
  of.points = map_->points.size();
  of.events = surface.events_used;
  of.rate_hz = options_.surface.rate_hz;
  of.inertial_trust = inertial_prior_ ? motion_.gyroscope_trust() : 0;
  of.weigh_events = options_.tracking.ideas.weigh_events;
  of.has_shared_errors = options_.tracking.ideas.shared_errors;
  return PointsThatErrAlike(of);
}

void Tracker::Register(const Surface& surface, PoseEstimate* pose) {
  // While lost, velocities are guesses: nothing is built on them. Those of an inertial sensor are not, for a while.
  const bool lost = status_.IsAstray();
  const bool goes_on = lost && status_.UnseenFor_s(surface.t_ns) < kInertialCoast_s;
  inertial_prior_ = (!lost || goes_on) && AdvanceTo(surface.t_edges_ns, inertial_, &motion_);
  step_.inertial = inertial_prior_;
  const auto predicted = motion_.Predict(surface.t_edges_ns);
  const ErrorsAlike alike = ErrorsAlikeIn(surface);
  const PosePrior prior = MakePrior(predicted, ScaleOf(alike));
  AlignmentResult result = Align(map_->points, surface, camera_, prior, predicted.velocity_event, options_);
  if (!result.T_event_ref.IsFinite() || !result.credible_information.allFinite()) {
    Coast(surface.t_edges_ns);  // never a pose that is not a number
    return;
  }
  const bool found = TryByDepth(surface, prior, predicted.velocity_event, &result);
  const bool suspicious = status_.quality().IsSuspicious(result.inlier_share);
  if (suspicious && !status_.doubtful()) T_world_before_ = motion_.pose();
  const bool bad = status_.quality().IsBad(result.inlier_share);
  const bool search = status_.WantsSearch(surface.t_ns, result.inlier_share, inertial_prior_);
  if (found || (search && Recover(surface, predicted.covariance, &result))) {
    StartWhereFound(surface, map_->WorldFromEvent(result.T_event_ref), predicted.velocity_event);
  } else if (inertial_prior_ && (bad || (lost && suspicious))) {
    status_.NoteGuess();  // what little matches is false: the inertial sensor knows better for a while
  } else if (lost && suspicious) {
    motion_.Coast(surface.t_edges_ns);
    step_.kind = MotionPast::Kind::kCoasting;
  } else {
    Measure(surface, predicted, result, alike);
  }
  pose->points_used = result.visible;
  pose->inlier_share = result.inlier_share;
  pose->mean_residual_px = result.mean_residual_px;
  pose->iterations = result.iterations;
  NoteMatch(result.inlier_share);
}

void Tracker::StartWhereFound(const Surface& surface, const Rigid3& T_world_found, const Vector6d& velocity_led) {
  Vector6d velocity = VelocitySinceStart(surface.t_edges_ns, T_world_found);
  // Of that, an inertial sensor knows more than a pose that went astray.
  if (velocity.isZero()) velocity = inertial_prior_ ? velocity_led : TurningWith(surface);
  StartAt(surface.t_edges_ns, T_world_found, velocity);
  status_.NoteFound();
}

void Tracker::Measure(const Surface& surface, const MotionFilter::Prediction& predicted, const AlignmentResult& result,
                      const ErrorsAlike& alike) {
  const double scale = ScaleOf(alike);
  // Where little matches, most of it is false, and so is what normals differ by.
  const bool suspicious = status_.quality().IsSuspicious(result.inlier_share);
  const Matrix6d& information = suspicious ? result.information : result.credible_information;
  // Right perturbation in `ref` to right perturbation of T_world_event: Exp(d_event) = Exp(-Ad(T_event_ref) d_ref).
  const Matrix6d A = Adjoint(result.T_event_ref.inverse());
  step_.measured = MotionFilter::LikelihoodOf(predicted, map_->WorldFromEvent(result.T_event_ref),
                                              A.transpose() * information * A / (scale * scale),
                                              alike.shared / alike.own, residual_scale_.variance_scale());
  const double weight = status_.quality().Weight(result.inlier_share);
  if (options_.tracking.ideas.weigh_matches && IsLed()) step_.measured->Weigh(weight);
  step_.measured->Weigh(std::pow(MisfitAt(surface.t_edges_ns), -kMisfitPower));
  if (inertial_prior_ && !surface.turn_event.isZero()) step_.measured->Weigh(kBlurredAlike);
  motion_.Update(surface.t_edges_ns, *step_.measured);
}

bool Tracker::TryByDepth(const Surface& surface, PosePrior prior, const Vector6d& velocity_event,
                         AlignmentResult* result) {
  const auto T_world_by_depth = std::exchange(T_world_by_depth_, std::nullopt);
  if (!T_world_by_depth) return false;
  prior.T_event_ref = T_world_by_depth->inverse() * map_->T_world_ref;
  AlignmentResult by_depth = Align(map_->points, surface, camera_, prior, velocity_event, options_);
  if (!by_depth.T_event_ref.IsFinite() || by_depth.inlier_share < result->inlier_share + kBetterBy) return false;
  *result = std::move(by_depth);
  return true;
}

bool Tracker::Recover(const Surface& surface, const Matrix6d& covariance, AlignmentResult* result) {
  if (!options_.tracking.ideas.search) return false;
  const double rules_out_s = inertial_prior_ ? kInertialRulesOutSearch_s : kRulesOutSearch_s;
  if (depth_fusion_.AgreedWithin(rules_out_s, surface.t_edges_ns)) return false;
  const Rigid3 T_world_now = map_->WorldFromEvent(result->T_event_ref);
  const double unknown_m = inertial_prior_ ? kInertialUnknown_m : kUnknown_m;
  const double unknown_rad = inertial_prior_ ? kInertialUnknown_rad : unknown_m;
  Matrix6d wide = covariance;
  wide.diagonal().head<3>().array() += unknown_m * unknown_m;
  wide.diagonal().tail<3>().array() += unknown_rad * unknown_rad;
  // Depth that agreed a moment ago is not wrong now, whatever else looks like the view.
  const Matrix6d bounded = (wide.inverse() + depth_fusion_.BoundAt(surface.t_edges_ns)).inverse();
  Relocalizer::Expectation where{{T_world_now, T_world_before_}, bounded, map_->chapter};
  if (inertial_prior_) where.most_square = kInertialMostSquare;
  const double least = std::max(0.5 * status_.quality().usual_share(), result->inlier_share + kBetterBy);
  const auto found = relocalizer_.Search(surface, map_, where, status_.lost(), least);
  // What an inertial sensor saw of the way is better than a view that matches less than usual.
  if (!found || (inertial_prior_ && status_.quality().IsSuspicious(found->alignment.inlier_share))) return false;
  *result = found->alignment;
  map_ = found->map;
  return true;
}

void Tracker::NoteMatch(double inlier_share) {
  const bool depth = depth_fusion_.AgreedWithin(TrackingStatus::kLostAfter_s, motion_.time_ns());
  const bool depth_alone = depth && depth_fusion_.replacements() == 0 && IsLed();
  status_.NoteMatch(inlier_share, {inertial_prior_, motion_.knows_acceleration(), depth, depth_alone});
}

}  // namespace devo
