// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/point_filter.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "devo/core/edge_motion.h"
#include "devo/core/rigid3.h"

namespace devo {
namespace {

Camera TestCamera() { return {640, 480, 500, 490, 320, 240, "", {}}; }

/// Of an upright edge 2 m away.
MapPoint PointAt(const Eigen::Vector3f& p) {
  MapPoint point;
  point.p_ref = p;
  point.normal_ref = Eigen::Vector3f::UnitX();
  return point;
}

/// How `point` meets the edge that `truth` makes in a view.
PointSighting Sight(const MapPoint& point, const Eigen::Vector3f& truth, const Rigid3& T_event_ref, float noise_px) {
  const Camera camera = TestCamera();
  const auto image = [&](const Eigen::Vector3f& p) { return *camera.Project(T_event_ref * p.cast<double>()); };
  PointSighting s;
  s.R_event_ref = T_event_ref.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f p_event = (T_event_ref * point.p_ref.cast<double>()).cast<float>();
  s.px_per_motion = ImageVelocityAlong(Eigen::Vector2f::UnitX(), p_event, camera);
  s.distance_px = static_cast<float>((image(point.p_ref) - image(truth)).x()) + noise_px;
  s.weight = 1;
  return s;
}

TEST(PointFilter, FindsPositionAndDepthOfAPointFromViewsOnBothSides) {
  const Eigen::Vector3f truth(0.1F, 0.2F, 2);
  MapPoint point = PointAt(1.008F * truth + Eigen::Vector3f(0.002F, 0, 0));  // 16 mm too far, half a pixel aside
  PointCovariance covariance = CovarianceOfNewPoint();
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.3F);
  for (int k = 0; k < 100; ++k) {
    const Rigid3 T_event_ref(Eigen::Quaterniond::Identity(), {k % 2 ? 0.3 : -0.3, 0, 0});
    RefinePoint(Sight(point, truth, T_event_ref, noise(random)), TestCamera(), &point, &covariance);
  }
  EXPECT_NEAR(point.p_ref.z(), 2, 0.005);
  EXPECT_NEAR(point.p_ref.x() / point.p_ref.z(), 0.05, 0.2 / 500);
  EXPECT_LT(SigmaAcross(covariance), 0.1F);
}

TEST(PointFilter, FindsADepthThatIsMerelyGuessed) {
  const Eigen::Vector3f truth(0.1F, 0.2F, 2);
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.3F);
  for (const float times : {0.4F, 0.8F, 1.6F, 3.0F}) {
    MapPoint point = PointAt(times * truth);
    PointCovariance covariance = CovarianceOfGuessedPoint();
    EXPECT_GE(SigmaDepthShare(covariance), 0.5F);
    for (int k = 1; k <= 60; ++k) {
      const Rigid3 T_event_ref(Eigen::Quaterniond::Identity(), {0.01 * k, 0, 0});
      RefinePoint(Sight(point, truth, T_event_ref, noise(random)), TestCamera(), &point, &covariance);
      ASSERT_GT(point.p_ref.z(), 0);
    }
    EXPECT_NEAR(point.p_ref.z(), 2, 0.02) << times;
    EXPECT_LT(SigmaDepthShare(covariance), 0.02F) << times;
  }
}

TEST(PointFilter, HasNoVarianceBelowZeroWhereOneSightingTellsAllOfADepth) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> px_per_m(-3e4F, 3e4F);
  for (int k = 0; k < 10'000; ++k) {
    MapPoint point = PointAt({0.1F, 0.2F, 2});
    PointCovariance covariance = CovarianceOfGuessedPoint();
    PointSighting s;
    s.R_event_ref.setIdentity();
    s.px_per_motion << px_per_m(random), px_per_m(random), px_per_m(random), 0, 0, 0;
    s.weight = 1;
    RefinePoint(s, TestCamera(), &point, &covariance);
    ASSERT_GE(covariance.depth, 0);
    ASSERT_GE(covariance.across, 0);
  }
}

TEST(PointFilter, LeavesTheDepthAloneWhereTheViewIsTheSame) {
  const Eigen::Vector3f truth(0, 0, 2);
  MapPoint point = PointAt({0.002F, 0, 2});
  PointCovariance covariance = CovarianceOfNewPoint();
  const float before = covariance.depth;
  for (int k = 0; k < 100; ++k) {
    RefinePoint(Sight(point, truth, Rigid3(), 0), TestCamera(), &point, &covariance);
  }
  EXPECT_NEAR(point.p_ref.x(), 0, 1e-4);
  EXPECT_NEAR(point.p_ref.z(), 2, 1e-6);
  EXPECT_FLOAT_EQ(covariance.depth, before);
}

TEST(PointFilter, TakesNothingFromASightingWithoutWeight) {
  MapPoint point = PointAt({0.002F, 0, 2});
  PointCovariance covariance = CovarianceOfNewPoint();
  PointSighting s = Sight(point, {0, 0, 2}, Rigid3(), 0);
  s.weight = 0;
  RefinePoint(s, TestCamera(), &point, &covariance);
  EXPECT_NEAR(point.p_ref.x(), 0.002, 1e-6);
  EXPECT_NEAR(SigmaAcross(covariance), SigmaAcross(CovarianceOfNewPoint()), 1e-4);
}

TEST(PointFilter, StatesTheErrorThatItsPointsHave) {
  std::mt19937 random(2);
  std::normal_distribution<float> normal;
  double square = 0;
  const int runs = 500;
  for (int run = 0; run < runs; ++run) {
    const Eigen::Vector3f truth(0.1F, 0, 2);
    PointCovariance covariance = CovarianceOfNewPoint();
    const float across_px = SigmaAcross(covariance) * normal(random);
    MapPoint point = PointAt((1 + std::sqrt(covariance.depth) * normal(random)) * truth);
    point.p_ref.x() += across_px / 500 * 2;
    for (int k = 0; k < 8; ++k) {
      const Rigid3 T_event_ref(Eigen::Quaterniond::Identity(), {0.05 * k, 0, 0});
      RefinePoint(Sight(point, truth, T_event_ref, 0.87F * normal(random)), TestCamera(), &point, &covariance);
    }
    const float error_px = 500 * (point.p_ref.x() / point.p_ref.z() - truth.x() / truth.z());
    square += error_px * error_px / covariance.across / runs;
  }
  EXPECT_NEAR(square, 1, 0.2);
}

}  // namespace
}  // namespace devo
