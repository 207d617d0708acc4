// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/start_velocity.h"

#include <algorithm>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "devo/core/rigid3.h"
#include "segment_scene.h"

namespace devo {
namespace {

/// Surfaces of a camera that moves evenly from where a map was made, each some hundredths of a second later.
struct Start {
  LocalMap map;
  std::vector<Surface> surfaces;
  std::vector<StartView> views;

  explicit Start(const Vector6d& velocity_event, int count = 3) {
    map.points = SegmentScene(14, 1.5);
    surfaces.reserve(static_cast<std::size_t>(count));
    for (int k = 1; k <= count; ++k) {
      const double since_s = 0.01 * k;
      const Rigid3 T_ref_event = Exp(velocity_event * since_s);
      surfaces.push_back(SegmentsSeen(map.points, T_ref_event.inverse()));
      views.push_back({&surfaces.back(), since_s, T_ref_event.rotation().toRotationMatrix()});
    }
  }

  /// Edges as in the dark: each this far off, in any direction.
  void Blur(double sigma_px, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> off(0, static_cast<float>(sigma_px));
    for (Surface& surface : surfaces) {
      for (EdgePoint& edge : surface.edges) {
        edge.x = std::clamp(edge.x + off(random), 0.0F, static_cast<float>(surface.width() - 1));
        edge.y = std::clamp(edge.y + off(random), 0.0F, static_cast<float>(surface.height() - 1));
      }
      BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
    }
  }

  Eigen::Vector3d Find() const { return FindStartVelocity(map, views, SegmentCamera()); }
};

Vector6d Twist(double vx, double vy, double vz, double wx, double wy, double wz) {
  return (Vector6d() << vx, vy, vz, wx, wy, wz).finished();
}

TEST(StartVelocity, IsFoundInViewsOfACameraThatMovesInAnyDirectionWhateverItsTurn) {
  for (const Vector6d& velocity : {Twist(1.1, 0, 0, 0, 0, 0), Twist(-0.4, -0.9, 0, 1.4, 0.4, 0.6),
                                   Twist(0.3, 0.5, 0.4, 0, -2, 1), Twist(0, 1.3, -0.3, -1, 0, 0)}) {
    const Eigen::Vector3d found = Start(velocity).Find();
    EXPECT_LT((found - velocity.head<3>()).norm(), 0.15)
        << found.transpose() << ", not " << velocity.head<3>().transpose();
  }
}

TEST(StartVelocity, IsFoundRoughlyInOneView) {
  const Eigen::Vector3d found = Start(Twist(1.1, -0.5, 0, 0, 1, 0), 1).Find();
  EXPECT_LT((found - Eigen::Vector3d(1.1, -0.5, 0)).head<2>().norm(), 0.4) << found.transpose();
}

TEST(StartVelocity, IsZeroOfACameraThatOnlyTurns) { EXPECT_TRUE(Start(Twist(0, 0, 0, 1, -2, 0.5)).Find().isZero()); }

TEST(StartVelocity, IsNotFoundInTheNoiseOfEdgesOfACameraThatHardlyMoves) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Start noisy(Twist(0.2, 0, 0.1, 0, 0.2, 0), 2);
    noisy.Blur(4, seed);
    EXPECT_LT(noisy.Find().norm(), 0.5) << seed << ": " << noisy.Find().transpose();
  }
}

TEST(StartVelocity, IsZeroWhereNothingTellsIt) {
  Start unseen(Twist(1.1, 0, 0, 0, 0, 0));
  unseen.views.clear();
  EXPECT_TRUE(unseen.Find().isZero());
  Start few(Twist(1.1, 0, 0, 0, 0, 0));
  few.map.points.resize(50);
  EXPECT_TRUE(few.Find().isZero()) << "a handful of points meet edges anywhere";
  Start dark(Twist(1.1, 0, 0, 0, 0, 0));
  for (Surface& surface : dark.surfaces) surface.nearest_edge.setTo(Surface::kNoEdge);
  EXPECT_TRUE(dark.Find().isZero());
}

}  // namespace
}  // namespace devo
