// SPDX-License-Identifier: BSD-3-Clause
//
// Scenes of straight segments, and what a camera sees of them: for tests of alignment, tracking and search.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/local_map.h"
#include "devo/core/nearest_edge_field.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

inline Camera SegmentCamera() { return {240, 180, 200, 200, 119.5, 89.5, "", {}}; }

/// Points along a segment in the view that made them: from one pixel to another, at a depth.
inline void AddSegment(const Eigen::Vector2d& from_px, const Eigen::Vector2d& to_px, double z_m,
                       std::vector<MapPoint>* points) {
  const Eigen::Vector2d along = (to_px - from_px).normalized();
  for (double s = 0; s < (to_px - from_px).norm(); s += 0.7) {
    MapPoint point;
    point.p_ref = (z_m * *SegmentCamera().Unproject(from_px + s * along)).cast<float>();
    point.normal_ref = Eigen::Vector3f(static_cast<float>(-along.y()), static_cast<float>(along.x()), 0);
    points->push_back(point);
  }
}

/// Thirty segments of all directions, up to 3 m away, on a grid (each up to `jitter_px` off it), so that none crosses
/// another.
inline std::vector<MapPoint> SegmentScene(unsigned seed, double nearest_m, double jitter_px = 0) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> angle(0, M_PI), z(nearest_m, 3), jitter(-jitter_px, jitter_px);
  std::vector<MapPoint> points;
  for (int k = 0; k < 30; ++k) {
    Eigen::Vector2d center(40 + k % 6 * 32, 33 + k / 6 * 28);
    if (jitter_px > 0) center.x() += jitter(random);
    if (jitter_px > 0) center.y() += jitter(random);
    const double a = angle(random);
    const Eigen::Vector2d half = 9 * Eigen::Vector2d(std::cos(a), std::sin(a));
    AddSegment(center - half, center + half, z(random), &points);
  }
  return points;
}

/// What a camera at the pose sees of the points: their projections as crests, normals from projected neighbours.
inline Surface SegmentsSeen(const std::vector<MapPoint>& points, const Rigid3& T_event_ref, double radius_px = 4) {
  const Camera camera = SegmentCamera();
  Surface surface;
  surface.image = cv::Mat1b(camera.height(), camera.width(), std::uint8_t{0});
  surface.window_s = 0.02;
  for (const MapPoint& point : points) {
    const Eigen::Vector3d p = point.p_ref.cast<double>(), tangent(-point.normal_ref.y(), point.normal_ref.x(), 0);
    const auto u = camera.Project(T_event_ref * p),
               v = camera.Project(T_event_ref * Eigen::Vector3d(p + 1e-4 * tangent));
    if (!u || !v || !camera.Contains(*u, 3)) continue;
    const Eigen::Vector2f along = (*v - *u).normalized().cast<float>();
    surface.edges.push_back({static_cast<float>(u->x()), static_cast<float>(u->y()), along.y(), -along.x(), 5, 0});
  }
  surface.events_used = static_cast<std::uint32_t>(20 * points.size());
  surface.nearest_edge = cv::Mat1i(camera.height(), camera.width());
  BuildNearestEdgeField(surface.edges, radius_px, &surface.nearest_edge);
  return surface;
}

/// The edges' normals turned, each by an angle that is drawn.
inline Surface WithTurnedNormals(Surface surface, double mean_rad, double sigma_rad) {
  std::mt19937 random(5);
  std::normal_distribution<float> angle(static_cast<float>(mean_rad), static_cast<float>(sigma_rad));
  for (EdgePoint& edge : surface.edges) {
    const Eigen::Vector2f normal = Eigen::Rotation2Df(angle(random)) * Eigen::Vector2f(edge.nx, edge.ny);
    edge.nx = normal.x();
    edge.ny = normal.y();
  }
  return surface;
}

}  // namespace devo
