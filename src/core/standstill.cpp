// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/standstill.h"

#include <algorithm>

#include <Eigen/Cholesky>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kMaxCoast_s = 1;
// Where a motion turns round slowly, events become too few to see it, for a moment. Longer than that no velocity is
// trusted that may be an error of a camera at rest.
constexpr double kMaxUnseen_s = 0.15, kSlow_m_s = 0.1;  // also in rad/s
// Slower than this, a camera whose events end stands. Also in rad/s.
constexpr double kStopping_m_s = 0.05, kInertialStopping_m_s = 0.01;
// Square of the velocity over its standard deviation. Less is asked where edges would hardly show it: that there are no
// events says little against it then. Where an accelerometer knows it, it is as small as noise once the camera stands.
constexpr double kClearlyMoving = 50, kInertialClearlyMoving = 15, kKnownMoving = 2, kHiddenMoving = 4;

bool IsBelow(const Vector6d& velocity, double limit) {
  return velocity.head<3>().norm() < limit && velocity.tail<3>().norm() < limit;
}

bool MovesClearly(const MotionFilter::Prediction& now, double least_square) {
  return NormalisedSquare(now.velocity_event, now.velocity_covariance) > least_square;
}

/// By more than a gyroscope errs.
bool TurnsClearly(const MotionFilter::Prediction& now) {
  const Eigen::Vector3d turn = now.velocity_event.tail<3>();
  const Eigen::Matrix3d covariance = now.velocity_covariance.bottomRightCorner<3, 3>();
  return turn.dot(covariance.ldlt().solve(turn)) > kInertialClearlyMoving;
}

/// Not about to stand, as far as is known.
bool MayMove(const MotionFilter::Prediction& now) {
  return !IsBelow(now.velocity_event, kStopping_m_s) || MovesClearly(now, kClearlyMoving);
}

/// However long events are missing: a gyroscope sees a clear turn, and depth has agreed a moment ago.
bool TurnsUnseen(std::int64_t t_ns, const TrackedMotion& known) {
  // Of where it is meanwhile, depth says enough.
  if (!known.depth.AgreedInPartWithin(kMaxCoast_s, t_ns)) return false;
  if (t_ns <= known.filter.time_ns() || !ReadSince(known.filter, t_ns, known.inertial)) return false;
  return TurnsClearly(PredictAt(known.filter, t_ns, known.inertial));
}

}  // namespace

double TrackedMotion::Flow(const Vector6d& velocity_event) const {
  return FlowAcrossEdges(map.points, filter.pose().inverse() * map.T_world_ref, velocity_event, camera);
}

Standstill::Kind Standstill::Judge(const Surface& surface, bool still, const TrackedMotion& known) {
  const double unseen_s = SecondsFromNs(surface.t_ns - last_active_ns_);
  // Once it is held, only events end it, or depth that says otherwise: noise of an inertial sensor would not.
  const bool free = still && !held();
  const bool may_move = free && (unseen_s < kMaxCoast_s || TurnsUnseen(surface.t_edges_ns, known));
  // Depth that agrees measures the motion on, however long events are missing.
  const bool by_depth = free && missing_ && known.depth.AgreedWithin(kMaxCoast_s, surface.t_ns);
  missing_ = (may_move || by_depth) && (missing_ || activity_.EndedSuddenly()) && MayMoveUnseen(surface, known);
  const bool moves_on = missing_ || (may_move && IsMoving(surface, unseen_s, known));
  if (!held()) held_since_ns_ = surface.t_edges_ns;
  kind_ = !still ? Kind::kMoving : moves_on ? Kind::kCoasting : Kind::kStill;
  return kind_;
}

void Standstill::Note(const Surface& surface, bool still, double flow_px_s) {
  if (!still) last_active_ns_ = last_events_ns_ = surface.t_ns;
  activity_.Note(surface.activity_hz, still, flow_px_s);
}

void Standstill::MoveOn(std::int64_t t_ns) {
  last_active_ns_ = t_ns;
  missing_ = true;
  if (held()) kind_ = Kind::kMoving;
}

void Standstill::Clear() {
  kind_ = Kind::kMoving;
  missing_ = false;
  held_since_ns_ = last_active_ns_ = last_events_ns_ = 0;
  activity_.Clear();
}

bool Standstill::MayMoveUnseen(const Surface& surface, const TrackedMotion& known) const {
  const auto now = PredictAt(known.filter, std::max(surface.t_edges_ns, known.filter.time_ns()), known.inertial);
  // Where noise shows, so does what moves fast.
  return MayMove(now) && !(surface.noise_goes_on && activity_.WouldShow(known.Flow(now.velocity_event)));
}

bool Standstill::IsMoving(const Surface& surface, double unseen_s, const TrackedMotion& known) {
  const std::int64_t t_ns = surface.t_edges_ns;
  const MotionFilter& filter = known.filter;
  if (known.lost || t_ns <= filter.time_ns()) return false;
  const auto now = PredictAt(filter, t_ns, known.inertial);
  const double flow_px_s = known.Flow(now.velocity_event);
  activity_.NoteUnseen(flow_px_s, SecondsFromNs(t_ns - filter.time_ns()));
  const bool led = ReadSince(filter, t_ns, known.inertial).has_value();
  // Of a wall without edges that fills the view, the map's guessed ones say that it should show.
  if (activity_.RulesOutMotion() && !(led && (filter.knows_acceleration() || TurnsClearly(now)))) return false;
  const bool unseen_long = unseen_s > kMaxUnseen_s;
  // With a translation that a turn makes up for in the image, hardly a pixel sees a camera move; when it stops, an
  // inertial sensor has seen it slow down. Where noise shows that no events are missing, it must be sure of that.
  if (led) {
    return MovesClearly(now, filter.knows_acceleration() ? kKnownMoving : kInertialClearlyMoving) ||
           (!unseen_long && !surface.noise_goes_on && !IsBelow(now.velocity_event, kInertialStopping_m_s));
  }
  return MovesClearly(now, activity_.WouldShow(flow_px_s) ? kClearlyMoving : kHiddenMoving) &&
         !(unseen_long && IsBelow(now.velocity_event, kSlow_m_s));
}

}  // namespace devo
