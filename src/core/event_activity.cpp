// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/event_activity.h"

#include <algorithm>
#include <cmath>

#include "devo/core/edge_motion.h"
#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kForgets_s = 0.5;
// Times the events of a standstill: fewer may be those of a slow motion that turns round, or what a motion is thought
// to make and does not.
constexpr double kLeastToEnd = 3, kLeastToShow = 6;
constexpr double kMostUnseen_px = 1.5;  // blurred edges are about as wide
// However hard a camera stops, before its events end they become fewer than this share of the most in kSpan_s. Their
// rate is measured over kWindow_s.
constexpr double kSuddenShare = 0.25, kSpan_s = 0.08, kWindow_s = 0.02;

constexpr std::size_t kPointsOfFlow = 100;

}  // namespace

double FlowAcrossEdges(const std::vector<MapPoint>& points, const Rigid3& T_event_ref, const Vector6d& velocity_event,
                       const Camera& camera) {
  const Eigen::Matrix3f R_event_ref = T_event_ref.rotation().toRotationMatrix().cast<float>();
  const std::size_t stride = std::max<std::size_t>(1, points.size() / kPointsOfFlow);
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Eigen::Vector3f p_event = (T_event_ref * points[i].p_ref.cast<double>()).cast<float>();
    if (!camera.Project(p_event.cast<double>())) continue;
    const Eigen::Vector2f normal = ProjectNormal(points[i].normal_ref, R_event_ref, p_event);
    sum += std::abs(normal.dot(ImageVelocity(velocity_event, p_event, camera)));
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

void EventActivity::Note(double activity_hz, bool still, double flow_px_s) {
  if (!still) unseen_px_ = 0;
  if (!still && flow_px_s > 0) {
    const double share = 1 / (kForgets_s * rate_hz_);
    known_hz_ += share * (activity_hz - known_hz_);
    known_px_s_ += share * (flow_px_s - known_px_s_);
  }
  past_hz_.push_back(activity_hz);
  while (past_hz_.size() > Surfaces(kSpan_s)) past_hz_.pop_front();
}

std::size_t EventActivity::Surfaces(double span_s) const {
  return static_cast<std::size_t>(std::max(2, CountIn(span_s, rate_hz_)));  // the last one and one before
}

bool EventActivity::EndedSuddenly() const {
  const std::size_t back = Surfaces(kWindow_s);
  if (past_hz_.size() < back) return false;
  const double last_hz = past_hz_[past_hz_.size() - back];
  return last_hz > kLeastToEnd * still_hz_ &&
         last_hz > kSuddenShare * *std::max_element(past_hz_.begin(), past_hz_.end());
}

bool EventActivity::WouldShow(double flow_px_s) const {
  return known_px_s_ > 0 && known_hz_ / known_px_s_ * flow_px_s > kLeastToShow * still_hz_;
}

void EventActivity::NoteUnseen(double flow_px_s, double since_s) {
  if (WouldShow(flow_px_s)) unseen_px_ += flow_px_s * since_s;
}

bool EventActivity::RulesOutMotion() const { return unseen_px_ > kMostUnseen_px; }

void EventActivity::Clear() { *this = EventActivity(rate_hz_, still_hz_); }

}  // namespace devo
