// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/start_velocity.h"

#include <algorithm>
#include <cstddef>

#include "devo/core/time.h"
#include "edge_nearness.h"

namespace devo {
namespace {

// A motion is taken to be even for so long; a first look shows too little.
constexpr double kLeastLook_s = 1e-3, kLongestLook_s = 0.05;
constexpr std::size_t kPoints = 400;  // of the map, spread over it
constexpr std::size_t kLeastPoints = 100;
constexpr double kFastest_m_s = 1.5;
constexpr int kMostSteps = 12;  // of the grid, to each side
// By how much a point may miss an edge, and how far it moves from one try to the next, in the last view.
constexpr float kReach_px = 2;
constexpr double kStep_px = 1, kLeastStep_px = 0.25;
// Where edges are noise or lie close together, chance lets a fast camera see more of them. One of 1 m/s must see so
// much more than one that stands, and a faster one more as the square of that: few cameras are.
constexpr double kUnlikelyShare = 0.05;
// Chance alone makes the best of many tries better than none by some hundredths.
constexpr double kClearlyBetter = 1.05;

class Tries {
 public:
  Tries(const LocalMap& map, const std::vector<StartView>& views, const Camera& undistorted)
      : views_(views), nearness_(undistorted), fx_(undistorted.fx()) {
    const std::size_t stride = std::max<std::size_t>(1, map.points.size() / kPoints);
    for (std::size_t i = 0; i < map.points.size(); i += stride)
      points_.push_back({map.points[i].p_ref, map.points[i].normal_ref});
    for (const Point& point : points_) inverse_depth_ += 1 / point.p_ref.z();
    inverse_depth_ /= static_cast<double>(std::max<std::size_t>(1, points_.size()));
  }

  bool enough() const { return points_.size() >= kLeastPoints && inverse_depth_ > 0; }
  /// m/s that move most points by a pixel in the last view.
  double PerPixel() const { return 1 / (inverse_depth_ * fx_ * views_.back().since_s); }

  /// Points and views together, of `reach_px`; 1 for each that lies on an edge, less for a velocity that is unlikely.
  double Score(const Eigen::Vector3d& velocity_ref, float reach_px) const {
    float score = 0;
    for (const StartView& view : views_) {
      const Eigen::Matrix3f R_event_ref = view.R_ref_event.transpose().cast<float>();
      const Eigen::Vector3f moved = (view.since_s * velocity_ref).cast<float>();
      for (const Point& point : points_) {
        score +=
            nearness_.Of(*view.surface, R_event_ref * (point.p_ref - moved), reach_px, R_event_ref * point.normal_ref);
      }
    }
    return score * std::max(0.0, 1 - kUnlikelyShare * velocity_ref.squaredNorm());
  }

 private:
  struct Point {
    Eigen::Vector3f p_ref, normal_ref;
  };

  const std::vector<StartView>& views_;
  EdgeNearness nearness_;
  double fx_;
  std::vector<Point> points_;
  double inverse_depth_ = 0;
};

/// Of all velocities along the image.
Eigen::Vector3d BestOfGrid(const Tries& tries, double step) {
  const auto reach_px = static_cast<float>(kReach_px * step / (kStep_px * tries.PerPixel()));
  const int steps = static_cast<int>(kFastest_m_s / step);
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double most = tries.Score(best, reach_px);
  for (int i = -steps; i <= steps; ++i) {
    for (int j = -steps; j <= steps; ++j) {
      const Eigen::Vector3d velocity(i * step, j * step, 0);
      const double score = tries.Score(velocity, reach_px);
      if (score <= most) continue;
      most = score;
      best = velocity;
    }
  }
  return best;
}

Eigen::Vector3d Climb(const Tries& tries, Eigen::Vector3d velocity, double step) {
  double most = tries.Score(velocity, kReach_px);
  while (step > kLeastStep_px * tries.PerPixel()) {
    const Eigen::Vector3d from = velocity;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double way : {-step, step}) {
        // What moves towards the image's middle moves its points by less.
        const Eigen::Vector3d there = from + (axis == 2 ? 2 * way : way) * Eigen::Vector3d::Unit(axis);
        const double score = tries.Score(there, kReach_px);
        if (score <= most) continue;
        most = score;
        velocity = there;
      }
    }
    if (velocity == from) step /= 2;
  }
  return velocity;
}

}  // namespace

std::optional<StartView> ViewSince(const LocalMap& map, const Surface& surface, const InertialBuffer& inertial) {
  const double since_s = SecondsFromNs(surface.t_edges_ns - map.t_ns);
  if (surface.epoch != map.epoch || since_s < kLeastLook_s || since_s > kLongestLook_s) return std::nullopt;
  const auto read = inertial.Mean(map.t_ns, surface.t_edges_ns);
  if (!read) return std::nullopt;
  return StartView{&surface, since_s, ExpSO3(since_s * read->angular_velocity).toRotationMatrix()};
}

Eigen::Vector3d FindStartVelocity(const LocalMap& map, const std::vector<StartView>& views, const Camera& undistorted) {
  if (views.empty() || views.front().surface->nearest_edge.empty()) return Eigen::Vector3d::Zero();
  const Tries tries(map, views, undistorted);
  if (!tries.enough()) return Eigen::Vector3d::Zero();
  const double step = std::max(kStep_px * tries.PerPixel(), kFastest_m_s / kMostSteps);
  Eigen::Vector3d best = Climb(tries, BestOfGrid(tries, step), step);
  const double standing = tries.Score(Eigen::Vector3d::Zero(), kReach_px);
  if (tries.Score(best, kReach_px) <= kClearlyBetter * standing) best.setZero();
  return best;
}

}  // namespace devo
