// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/silhouettes.h"

#include <cmath>

#include "devo/core/edge_motion.h"

namespace devo {
namespace {

constexpr double kMatched_px = 3;
constexpr float kAside_px = 10;
constexpr float kCos45 = 0.7F;
// Across itself while the surface's events were gathered: an edge that moved less may not have made its events.
constexpr float kDueMotion_px = 1;

bool Continuous(float a_m, float b_m) { return a_m > 0 && b_m > 0 && std::abs(a_m - b_m) < 0.03F * a_m; }
bool Behind(float front_m, float back_m) { return front_m > 0 && back_m > 1.08F * front_m + 0.05F; }

}  // namespace

std::vector<Silhouette> ProjectSilhouettes(const cv::Mat1f& depth_m, const cv::Mat2f& rays, const Rigid3& T_event_depth,
                                           const Camera& event_camera) {
  std::vector<Silhouette> silhouettes;
  const auto consider = [&](int x, int y, int dx, int dy) {
    const float z = depth_m(y, x);
    if (!Continuous(z, depth_m(y - dy, x - dx)) || !Continuous(z, depth_m(y - 2 * dy, x - 2 * dx))) return;
    // The pixel beside the border may mix both sides.
    if (!Behind(z, depth_m(y + dy, x + dx)) && !Behind(z, depth_m(y + 2 * dy, x + 2 * dx))) return;
    if (Continuous(z, depth_m(y + dy, x + dx))) return;  // the border is one pixel further
    const cv::Vec2f ray = 0.5F * (rays(y, x) + rays(y + dy, x + dx));
    const Eigen::Vector3d p_event = T_event_depth * Eigen::Vector3d(z * ray[0], z * ray[1], z);
    const auto u = event_camera.Project(p_event);
    if (u && event_camera.Contains(*u, 3)) {
      const cv::Point2f place(static_cast<float>(u->x()), static_cast<float>(u->y()));
      silhouettes.push_back({place, dx, dy, p_event.cast<float>()});
    }
  };
  for (int y = 2; y < depth_m.rows - 2; ++y) {
    for (int x = 2; x < depth_m.cols - 2; ++x) {
      consider(x, y, 1, 0);
      consider(x, y, -1, 0);
      consider(x, y, 0, 1);
      consider(x, y, 0, -1);
    }
  }
  return silhouettes;
}

std::optional<double> DistanceToEdge(const Silhouette& silhouette, const Surface& surface) {
  const int index =
      surface.NearestEdge(static_cast<int>(silhouette.u.x + 0.5F), static_cast<int>(silhouette.u.y + 0.5F));
  if (index < 0) return std::nullopt;
  const EdgePoint& edge = surface.edges[static_cast<std::size_t>(index)];
  if (std::abs(edge.nx * static_cast<float>(silhouette.dx) + edge.ny * static_cast<float>(silhouette.dy)) < kCos45) {
    return std::nullopt;
  }
  return std::hypot(edge.x - silhouette.u.x, edge.y - silhouette.u.y);
}

SilhouetteFit& SilhouetteFit::operator+=(const SilhouetteFit& other) {
  silhouettes += other.silhouettes;
  matched += other.matched;
  by_chance += other.by_chance;
  distance_sum_px += other.distance_sum_px;
  return *this;
}

SilhouetteFit FitSilhouettes(const std::vector<Silhouette>& silhouettes, const Surface& surface,
                             const Vector6d& velocity_event, const Camera& event_camera) {
  SilhouetteFit fit;
  if (surface.nearest_edge.empty()) return fit;
  const auto matched_px = [&surface](const Silhouette& silhouette) {
    const auto distance_px = DistanceToEdge(silhouette, surface);
    return distance_px && *distance_px <= kMatched_px ? distance_px : std::nullopt;
  };
  for (const Silhouette& silhouette : silhouettes) {
    const Eigen::Vector2f across(static_cast<float>(silhouette.dx), static_cast<float>(silhouette.dy));
    const float moved_px = across.dot(ImageVelocity(velocity_event, silhouette.p_event, event_camera)) *
                           static_cast<float>(surface.window_s);
    Silhouette aside[2] = {silhouette, silhouette};
    aside[0].u += kAside_px * cv::Point2f(across.x(), across.y());
    aside[1].u -= kAside_px * cv::Point2f(across.x(), across.y());
    const auto inside = [&](const Silhouette& s) { return event_camera.Contains({s.u.x, s.u.y}, 1); };
    if (std::abs(moved_px) < kDueMotion_px || !inside(aside[0]) || !inside(aside[1])) continue;
    ++fit.silhouettes;
    fit.by_chance += 0.5 * (matched_px(aside[0]).has_value() + matched_px(aside[1]).has_value());
    const auto distance_px = matched_px(silhouette);
    if (!distance_px) continue;
    ++fit.matched;
    fit.distance_sum_px += *distance_px;
  }
  return fit;
}

}  // namespace devo
