// SPDX-License-Identifier: BSD-3-Clause
//
// Where depth ends, events must be: silhouettes of a depth image in the event image, and how well they lie on edges.
// Judges extrinsics, intrinsics and the offset of the clocks together; beyond the paper.
#pragma once

#include <optional>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// A pixel's length of border between foreground and background.
struct Silhouette {
  cv::Point2f u;            ///< undistorted event image, px
  int dx, dy;               ///< side of the background, along a row or a column of the depth image
  Eigen::Vector3f p_event;  ///< of the foreground, m, event frame
};

/// The border of foreground that goes on inwards (which flying pixels do not) and has background beside it, at least
/// 3 px inside the image. `depth_m`: as DepthImage has it; `rays`: RayTable of its camera; `T_event_depth` maps points
/// from the depth camera at its time to the event camera at the events' time; `event_camera`: of the undistorted image.
std::vector<Silhouette> ProjectSilhouettes(const cv::Mat1f& depth_m, const cv::Mat2f& rays, const Rigid3& T_event_depth,
                                           const Camera& event_camera);

/// Distance in px to the nearest edge of the surface; empty where there is none within the surface's truncation, or
/// one of another direction (the background's side is known to 45 degrees).
std::optional<double> DistanceToEdge(const Silhouette& silhouette, const Surface& surface);

/// How well silhouettes lie on the edges of a surface. Sums over images add up.
struct SilhouetteFit {
  int silhouettes = 0;         ///< that moved across themselves, so that events were due
  int matched = 0;             ///< of these, with an edge of their direction within 3 px
  double by_chance = 0;        ///< matched when they are moved 10 px to either side, where they do not belong
  double distance_sum_px = 0;  ///< of the matched to their edges

  SilhouetteFit& operator+=(const SilhouetteFit& other);
  double MatchedShare() const { return silhouettes > 0 ? static_cast<double>(matched) / silhouettes : 0; }
  double ChanceShare() const { return silhouettes > 0 ? by_chance / silhouettes : 0; }
  double MeanDistancePx() const { return matched > 0 ? distance_sum_px / matched : 0; }
};

/// `velocity_event`: [v; omega], m/s and rad/s, at the surface's time. All zero for the paper's plain surface, whose
/// edges have no direction.
SilhouetteFit FitSilhouettes(const std::vector<Silhouette>& silhouettes, const Surface& surface,
                             const Vector6d& velocity_event, const Camera& event_camera);

}  // namespace devo
