// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/point_filter.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

// Of a new point: half a pixel, and what a depth camera gets wrong at edges.
constexpr float kNewAcross_px = 0.5F, kNewDepthShare = 0.01F, kGuessedDepthShare = 1;
// By one sighting a depth changes at most by this factor: what it says of a larger change is far from linear.
constexpr float kMostNearer = 2;
// Of an edge in another view, the error of that view's pose included.
constexpr float kSighting_px = 0.87F;

}  // namespace

PointCovariance CovarianceOfNewPoint() { return {kNewAcross_px * kNewAcross_px, 0, kNewDepthShare * kNewDepthShare}; }

PointCovariance CovarianceOfGuessedPoint() {
  return {kNewAcross_px * kNewAcross_px, 0, kGuessedDepthShare * kGuessedDepthShare};
}

float SigmaAcross(const PointCovariance& covariance) { return std::sqrt(covariance.across); }

float SigmaDepthShare(const PointCovariance& covariance) { return std::sqrt(covariance.depth); }

void RefinePoint(const PointSighting& s, const Camera& camera, MapPoint* point, PointCovariance* covariance) {
  // What a pixel across the edge is there, and all of the depth.
  const Eigen::Vector3f across_ref = point->normal_ref * (point->p_ref.z() / static_cast<float>(camera.fx()));
  const Eigen::Vector3f depth_ref = point->p_ref;
  // A point moves through the image as it does when the camera moves the other way.
  const Eigen::Vector3f px_per_m_ref = -s.R_event_ref.transpose() * s.px_per_motion.head<3>();
  const float h_across = px_per_m_ref.dot(across_ref), h_depth = px_per_m_ref.dot(depth_ref);
  PointCovariance& P = *covariance;
  const float across_image = P.across * h_across + P.across_depth * h_depth;
  const float depth_image = P.across_depth * h_across + P.depth * h_depth;
  const float variance =
      h_across * across_image + h_depth * depth_image + kSighting_px * kSighting_px / std::max(s.weight, 1e-6F);
  const float gain_across = across_image / variance, gain_depth = depth_image / variance;
  const float nearer = std::clamp(1 + s.distance_px * gain_depth, 1 / kMostNearer, kMostNearer);
  point->p_ref = (point->p_ref - s.distance_px * gain_across * across_ref) / nearer;
  // Rounding must not take them below zero.
  P.across = std::max(P.across - gain_across * across_image, 0.0F);
  P.across_depth = (P.across_depth - gain_across * depth_image) / nearer;
  P.depth = std::max(P.depth - gain_depth * depth_image, 0.0F) / (nearer * nearer);
}

}  // namespace devo
