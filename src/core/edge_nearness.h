// SPDX-License-Identifier: BSD-3-Clause
//
// How near points come to a surface's edges: for searches, which try hundreds of poses and velocities.
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "devo/core/camera.h"
#include "devo/core/surface.h"

namespace devo {

class EdgeNearness {
 public:
  /// Of the undistorted event image.
  explicit EdgeNearness(const Camera& undistorted)
      : fx_(static_cast<float>(undistorted.fx())), fy_(static_cast<float>(undistorted.fy())),
        cx_(static_cast<float>(undistorted.cx())), cy_(static_cast<float>(undistorted.cy())),
        max_u_(static_cast<float>(undistorted.width() - 2)), max_v_(static_cast<float>(undistorted.height() - 2)) {}

  /// 1 where the point (m, event frame) is seen on its nearest edge, falling to 0 at `reach_px` from it; 0 outside the
  /// image, and where `normal_event`, unless it is zero, is not about that edge's.
  float Of(const Surface& surface, const Eigen::Vector3f& p_event, float reach_px,
           const Eigen::Vector3f& normal_event = Eigen::Vector3f::Zero()) const {
    const float u = fx_ * p_event.x() / p_event.z() + cx_, v = fy_ * p_event.y() / p_event.z() + cy_;
    if (!(p_event.z() > kMinDepth_m && u >= 1 && v >= 1 && u <= max_u_ && v <= max_v_)) return 0;
    const int id = surface.NearestEdge(static_cast<int>(u + 0.5F), static_cast<int>(v + 0.5F));
    if (id < 0) return 0;
    const EdgePoint& edge = surface.edges[id];
    const bool known = !normal_event.isZero();
    if (known && std::abs(normal_event.x() * edge.nx + normal_event.y() * edge.ny) < kSimilar) return 0;
    const float du = u - edge.x, dv = v - edge.y;
    return std::max(0.0F, 1 - std::sqrt(du * du + dv * dv) / reach_px);
  }

 private:
  static constexpr float kMinDepth_m = 0.05F;
  static constexpr float kSimilar = 0.8F;  // cosine

  float fx_, fy_, cx_, cy_, max_u_, max_v_;
};

}  // namespace devo
