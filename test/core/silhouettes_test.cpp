// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/silhouettes.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/core/nearest_edge_field.h"

namespace devo {
namespace {

// A board 1 m away, in columns 40 to 99 and rows 30 to 89, in front of a wall 3 m away.
constexpr int kLeft = 40, kRight = 99, kTop = 30, kBottom = 89;
Camera TestCamera() { return {160, 120, 120, 120, 79.5, 59.5, "", {}}; }

cv::Mat1f BoardInFrontOfAWall() {
  cv::Mat1f depth_m(120, 160, 3.0F);
  depth_m(cv::Range(kTop, kBottom + 1), cv::Range(kLeft, kRight + 1)) = 1.0F;
  return depth_m;
}

std::vector<Silhouette> Silhouettes(const cv::Mat1f& depth_m, const Rigid3& T_event_depth = Rigid3()) {
  return ProjectSilhouettes(depth_m, RayTable(TestCamera()), T_event_depth, TestCamera());
}

/// Upright edges at the board's left and right, moved by `shift_px`.
Surface Edges(float shift_px) {
  Surface surface;
  surface.window_s = 0.02;
  surface.image = cv::Mat1b(120, 160, std::uint8_t{0});
  for (int y = kTop; y <= kBottom; ++y) {
    for (const float x : {kLeft - 0.5F, kRight + 0.5F}) {
      surface.edges.push_back({x + shift_px, static_cast<float>(y), 1, 0, 5, 0});
    }
  }
  surface.nearest_edge = cv::Mat1i(120, 160);
  BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
  return surface;
}

/// Sideways: 1 m/s at 1 m moves the board by 120 px/s.
Vector6d Sideways() {
  Vector6d velocity = Vector6d::Zero();
  velocity[0] = 1;
  return velocity;
}

TEST(Silhouettes, LieOnTheBorderOfForegroundWithTheSideOfTheBackground) {
  const auto silhouettes = Silhouettes(BoardInFrontOfAWall());
  EXPECT_THAT(silhouettes, testing::SizeIs(240));  // 60 pixels on each of four sides
  for (const Silhouette& s : silhouettes) {
    EXPECT_NEAR(s.p_event.z(), 1, 1e-6);
    if (s.dx != 0) {
      EXPECT_NEAR(s.u.x, s.dx > 0 ? kRight + 0.5 : kLeft - 0.5, 1e-3);
    } else {
      EXPECT_NEAR(s.u.y, s.dy > 0 ? kBottom + 0.5 : kTop - 0.5, 1e-3);
    }
  }
}

TEST(Silhouettes, AreNotMadeOfSlantsHolesOrSingleFlyingPixels) {
  cv::Mat1f depth_m(120, 160);
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) depth_m(y, x) = 1.0F + 0.02F * static_cast<float>(x);
  }
  depth_m(cv::Range(50, 60), cv::Range(50, 60)) = 0.0F;
  depth_m(20, 20) = 0.5F;
  EXPECT_THAT(Silhouettes(depth_m), testing::IsEmpty());
}

TEST(Silhouettes, FollowTheExtrinsics) {
  const Rigid3 T_event_depth(Eigen::Quaterniond::Identity(), {0.1, 0, 0});  // 12 px at 1 m
  const auto still = Silhouettes(BoardInFrontOfAWall()), moved = Silhouettes(BoardInFrontOfAWall(), T_event_depth);
  ASSERT_EQ(still.size(), moved.size());
  EXPECT_NEAR(moved[0].u.x - still[0].u.x, 12, 1e-3);
}

TEST(Silhouettes, FitEdgesWhereTheyAreAndNotAside) {
  const auto silhouettes = Silhouettes(BoardInFrontOfAWall());
  const SilhouetteFit fit = FitSilhouettes(silhouettes, Edges(0), Sideways(), TestCamera());
  EXPECT_EQ(fit.silhouettes, 120);  // those above and below the board do not move across themselves
  EXPECT_EQ(fit.MatchedShare(), 1);
  EXPECT_EQ(fit.ChanceShare(), 0);
  EXPECT_LT(fit.MeanDistancePx(), 0.01);
}

TEST(Silhouettes, MeasureHowFarDepthLiesBesideTheEvents) {
  const auto silhouettes = Silhouettes(BoardInFrontOfAWall());
  SilhouetteFit fit = FitSilhouettes(silhouettes, Edges(2), Sideways(), TestCamera());
  EXPECT_EQ(fit.MatchedShare(), 1);
  EXPECT_NEAR(fit.MeanDistancePx(), 2, 0.01);
  fit += FitSilhouettes(silhouettes, Edges(6), Sideways(), TestCamera());
  EXPECT_EQ(fit.silhouettes, 240);
  EXPECT_EQ(fit.MatchedShare(), 0.5);
  // Six pixels off, the place 10 px aside is nearer than the right one: out of reach both.
  EXPECT_EQ(FitSilhouettes(silhouettes, Edges(10), Sideways(), TestCamera()).ChanceShare(), 0.5);
}

TEST(Silhouettes, AreNotJudgedWithoutMotion) {
  const auto silhouettes = Silhouettes(BoardInFrontOfAWall());
  EXPECT_EQ(FitSilhouettes(silhouettes, Edges(0), Vector6d::Zero(), TestCamera()).silhouettes, 0);
}

}  // namespace
}  // namespace devo
