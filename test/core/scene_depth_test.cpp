// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/scene_depth.h"

#include <vector>

#include <gtest/gtest.h>

#include "devo/core/depth_registration.h"

namespace devo {
namespace {

/// Nearest depth of a view of 160x120 pixels, m: `z_m` everywhere.
cv::Mat1f NearestDepth(float z_m) {
  return cv::Mat1f(120 / DepthRegistration::kCell, 160 / DepthRegistration::kCell, z_m);
}

TEST(SceneDepthOfAView, HasTheMedianAndTheInverseDepthOfEachPlace) {
  cv::Mat1f nearest = NearestDepth(2);
  nearest.colRange(0, 16).setTo(1.0F);
  nearest.rowRange(24, 30).setTo(0);
  const SceneDepth scene = MakeSceneDepth(42, nearest);
  EXPECT_EQ(scene.t_ns, 42);
  EXPECT_EQ(scene.median_m, 2);
  EXPECT_FLOAT_EQ(scene.inverse_depth(2, 1), 1.0F);
  EXPECT_FLOAT_EQ(scene.inverse_depth(2, 7), 0.5F);
  EXPECT_FLOAT_EQ(scene.inverse_depth(7, 1), 0.5F);  // a hole: the median
}

/// Points of that depth at one place of the view.
std::vector<ReferenceMap::Visible> Points(int count, float u, float v, float z_m) {
  ReferenceMap::Visible point{};
  point.u = u;
  point.v = v;
  point.p_event = {0, 0, z_m};
  return std::vector<ReferenceMap::Visible>(static_cast<std::size_t>(count), point);
}

TEST(SceneDepthOfAView, HasTheMapsPointsWhereThereIsNoReading) {
  cv::Mat1f nearest = NearestDepth(2);
  nearest.rowRange(24, 30).setTo(0);
  std::vector<ReferenceMap::Visible> points = Points(3, 40, 118, 4);
  const std::vector<ReferenceMap::Visible> strays = Points(2, 60, 118, 4), read = Points(3, 40, 40, 4);
  points.insert(points.end(), strays.begin(), strays.end());
  points.insert(points.end(), read.begin(), read.end());
  const SceneDepth scene = MakeSceneDepth(42, nearest, points);
  EXPECT_FLOAT_EQ(scene.inverse_depth(7, 2), 0.25F);
  EXPECT_FLOAT_EQ(scene.inverse_depth(7, 3), 0.5F);  // two points may be strays
  EXPECT_FLOAT_EQ(scene.inverse_depth(2, 2), 0.5F);  // readings tell better
}

TEST(SceneDepthOfAView, KeepsTheMedianOfBeforeWithoutReadings) {
  const SceneDepth scene = MakeSceneDepth(42, NearestDepth(0), Points(3, 40, 118, 4), 1);
  EXPECT_EQ(scene.median_m, 1);
  EXPECT_FLOAT_EQ(scene.inverse_depth(7, 2), 0.25F);
  EXPECT_FLOAT_EQ(scene.inverse_depth(7, 3), 1);
}

TEST(SceneDepthOfAView, IsUnknownWithoutReadings) {
  const SceneDepth scene = MakeSceneDepth(42, NearestDepth(0));
  EXPECT_EQ(scene.median_m, 0);
  EXPECT_TRUE(scene.inverse_depth.empty());
}

}  // namespace
}  // namespace devo
