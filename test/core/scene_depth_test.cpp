// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/scene_depth.h"

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

TEST(SceneDepthOfAView, IsUnknownWithoutReadings) {
  const SceneDepth scene = MakeSceneDepth(42, NearestDepth(0));
  EXPECT_EQ(scene.median_m, 0);
  EXPECT_TRUE(scene.inverse_depth.empty());
}

}  // namespace
}  // namespace devo
