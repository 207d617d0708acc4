// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/rendering.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

const cv::Vec3b kBlack(0, 0, 0), kWhite(255, 255, 255);

Camera Pinhole() { return {40, 30, 20, 20, 20, 15, "none", {}}; }

DepthImage OneReading(cv::Point u, float depth_m) {
  DepthImage depth;
  depth.depth_m = cv::Mat1f(30, 40, 0.F);
  depth.depth_m(u) = depth_m;
  return depth;
}

TEST(DepthOverlay, ShowsAReadingWhereTheRayOfItsPixelMeetsTheEventImage) {
  const Camera camera = Pinhole();
  cv::Mat2f rays = RayTable(camera);
  // As if the lens bent this pixel's ray to the image's centre: what the table says counts, nothing is undistorted
  // anew.
  rays(5, 8) = cv::Vec2f(0, 0);
  const cv::Mat3b picture = RenderDepthOverlay(Surface(), OneReading({8, 5}, 2), rays, Rigid3(), camera);
  EXPECT_NE(picture(15, 20), kBlack);
  EXPECT_EQ(picture(5, 8), kBlack);
}

TEST(DepthOverlay, MovesDepthIntoTheEventImageAndDrawsEdgesWhiteOnIt) {
  const Camera camera = Pinhole();
  Surface surface;
  surface.edges.resize(1);
  surface.edges[0].x = 3;
  surface.edges[0].y = 4;
  const Rigid3 T_event_depth = Rigid3::Translation({1, 0, 0});  // at 2 m a shift of 10 px
  const cv::Mat3b picture =
      RenderDepthOverlay(surface, OneReading({20, 15}, 2), RayTable(camera), T_event_depth, camera);
  EXPECT_NE(picture(15, 30), kBlack);
  EXPECT_EQ(picture(15, 20), kBlack);
  EXPECT_EQ(picture(4, 3), kWhite);
}

}  // namespace
}  // namespace devo
