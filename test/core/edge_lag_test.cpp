// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/edge_lag.h"

#include <random>

#include <gtest/gtest.h>

#include "devo/core/alignment.h"
#include "devo/core/edge_motion.h"
#include "devo/core/nearest_edge_field.h"
#include "segment_scene.h"

namespace devo {
namespace {

constexpr float kScale_px = 0.06F;

TEST(EdgeLag, PointsAlongTheMotionAndIsSmallerForStrongerEdges) {
  for (const float across_px : {0.3F, 1.0F, 4.0F}) {
    const float forth = LagStrength(across_px, 0, kScale_px), back = LagStrength(-across_px, 0, kScale_px);
    EXPECT_GT(forth, 0);
    EXPECT_FLOAT_EQ(back, -forth);
    EXPECT_FLOAT_EQ(EdgeLagPx(forth, 2), 0.5F * EdgeLagPx(forth, 1));
  }
}

TEST(EdgeLag, DoesNotDependOnTheSpeedOfAnEdgeWhoseEventsGrowWithItsWay) {
  // Three events in each pixel passed: strength is in proportion to the way.
  EXPECT_NEAR(EdgeLagPx(LagStrength(2, 0, kScale_px), 3 * 2), EdgeLagPx(LagStrength(5, 0, kScale_px), 3 * 5), 1e-6);
}

TEST(EdgeLag, SaysLittleOfAMotionThatMayBeTheOpposite) {
  EXPECT_LT(LagStrength(0.5F, 5, kScale_px), 0.15F * LagStrength(0.5F, 0, kScale_px));
  EXPECT_EQ(LagStrength(0, 0, kScale_px), 0);
}

TEST(EdgeLag, IsNeverMoreThanHalfAPixelAndZeroWithoutStrength) {
  EXPECT_EQ(EdgeLagPx(LagStrength(100, 0, kScale_px), 0.1F), kMaxEdgeLag_px);
  EXPECT_EQ(EdgeLagPx(LagStrength(-100, 0, kScale_px), 0.1F), -kMaxEdgeLag_px);
  EXPECT_EQ(EdgeLagPx(LagStrength(1, 0, kScale_px), 0), 0);
}

TEST(EdgeMotion, AlongANormalIsTheLinearFormOfTheVelocity) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-1, 1);
  const Camera camera = SegmentCamera();
  for (int k = 0; k < 50; ++k) {
    const Vector6d velocity = Vector6d::NullaryExpr([&] { return uniform(random); });
    const Eigen::Vector3f p(uniform(random), uniform(random), 2 + uniform(random));
    const Eigen::Vector2f normal = Eigen::Vector2f(uniform(random), uniform(random)).normalized();
    EXPECT_NEAR(ImageVelocityAlong(normal, p, camera).dot(velocity.cast<float>()),
                normal.dot(ImageVelocity(velocity, p, camera)), 1e-3);
  }
}

TEST(EdgeLag, OfASurfaceDoesNotMoveThePose) {
  const auto points = SegmentScene(10, 1);
  OdometryOptions options;
  Vector6d velocity;
  velocity << 1.0, -0.4, 0.1, 0.05, 0.1, -0.2;
  Surface surface = SegmentsSeen(points, Rigid3());
  // Each edge trails as one with its strength does: away from where it goes to.
  for (EdgePoint& edge : surface.edges) {
    edge.strength = 1;
    float nearest2 = 4;
    Eigen::Vector3f p = points.front().p_ref;
    for (const MapPoint& point : points) {
      const auto u = SegmentCamera().Project(point.p_ref.cast<double>());
      const auto d2 = static_cast<float>((*u - Eigen::Vector2d(edge.x, edge.y)).squaredNorm());
      if (d2 < nearest2) {
        nearest2 = d2;
        p = point.p_ref;
      }
    }
    const float across_px = Eigen::Vector2f(edge.nx, edge.ny).dot(ImageVelocity(velocity, p, SegmentCamera())) *
                            static_cast<float>(surface.window_s);
    const float lag_px = EdgeLagPx(LagStrength(across_px, 0, static_cast<float>(options.surface.edge_lag_px)), 1);
    edge.x -= lag_px * edge.nx;
    edge.y -= lag_px * edge.ny;
  }
  BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
  PosePrior prior;
  prior.sqrt_information = 1e-3 * Matrix6d::Identity();
  const double corrected = Log(Align(points, surface, SegmentCamera(), prior, velocity, options).T_event_ref).norm();
  options.surface.edge_lag_px = 0;
  const double left = Log(Align(points, surface, SegmentCamera(), prior, velocity, options).T_event_ref).norm();
  EXPECT_GT(left, 5e-4);
  EXPECT_LT(corrected, 0.1 * left);
}

}  // namespace
}  // namespace devo
