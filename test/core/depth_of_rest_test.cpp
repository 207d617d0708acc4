// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_of_rest.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr double kStill_hz = 0.15;

DepthImage ImageAt(std::int64_t t_ns) { return {t_ns, cv::Mat1f(10, 10, 2.0F)}; }

/// Of 100 x 100 pixels, with 1000 edges: at 10 Hz per pixel each edge has one event in 10 ms.
Surface SurfaceAt(std::int64_t t_ns, double activity_hz) {
  Surface surface;
  surface.t_ns = surface.t_edges_ns = t_ns;
  surface.image = cv::Mat1b(100, 100, std::uint8_t{0});
  surface.edges.resize(1000);
  surface.activity_hz = activity_hz;
  surface.still = surface.maybe_noise = activity_hz < kStill_hz;
  return surface;
}

/// With the image of 100 ms, which is the first.
DepthOfRest AtRest() {
  DepthOfRest rest;
  rest.Keep(ImageAt(100 * kMs), SurfaceAt(100 * kMs, 0));
  return rest;
}

TEST(DepthOfRest, FitsOnceTheCameraHasMovedByAPixelOrTwoAndNoLongerWhenItHasMovedFar) {
  DepthOfRest rest = AtRest();
  EXPECT_FALSE(rest.Fits(SurfaceAt(110 * kMs, 10)));
  EXPECT_TRUE(rest.Fits(SurfaceAt(130 * kMs, 10)));
  EXPECT_TRUE(rest.Fits(SurfaceAt(140 * kMs, 10)));
  ASSERT_TRUE(rest.depth());
  EXPECT_EQ(rest.depth()->t_ns, 100 * kMs);
  EXPECT_FALSE(rest.Fits(SurfaceAt(160 * kMs, 10)));
  EXPECT_FALSE(rest.depth());
}

TEST(DepthOfRest, FitsHoweverLongTheRestLasted) {
  DepthOfRest rest = AtRest();
  for (int k = 11; k < 200; ++k) EXPECT_FALSE(rest.Fits(SurfaceAt(10 * k * kMs, 0.1)));
  EXPECT_TRUE(rest.Fits(SurfaceAt(2010 * kMs, 10)));
}

TEST(DepthOfRest, FitsNoSurfaceTwiceAndNoneOfBeforeTheImage) {
  DepthOfRest rest = AtRest();
  EXPECT_FALSE(rest.Fits(SurfaceAt(90 * kMs, 30)));
  EXPECT_TRUE(rest.Fits(SurfaceAt(110 * kMs, 30)));
  EXPECT_FALSE(rest.Fits(SurfaceAt(110 * kMs, 30)));
}

TEST(DepthOfRest, FitsNoneWhoseNoiseIsNotKnownYet) {
  DepthOfRest rest = AtRest();
  Surface surface = SurfaceAt(130 * kMs, 10);
  surface.still = true;
  EXPECT_FALSE(rest.Fits(surface));
  EXPECT_TRUE(rest.Fits(SurfaceAt(140 * kMs, 10)));
}

TEST(DepthOfRest, DoesNotCountWhatMayBeNoiseForMotion) {
  DepthOfRest rest = AtRest();
  for (int k = 11; k < 200; ++k) {
    Surface surface = SurfaceAt(10 * k * kMs, 10);
    surface.maybe_noise = true;
    EXPECT_FALSE(rest.Fits(surface));
  }
  EXPECT_FALSE(rest.Fits(SurfaceAt(2000 * kMs, 10)));
  EXPECT_TRUE(rest.Fits(SurfaceAt(2010 * kMs, 10)));
}

TEST(DepthOfRest, WaitsForAnImageOfTheMotionWhereImagesComeOften) {
  DepthOfRest rest = AtRest();
  rest.Keep(ImageAt(300 * kMs), SurfaceAt(300 * kMs, 0));
  EXPECT_FALSE(rest.depth());
  EXPECT_FALSE(rest.Fits(SurfaceAt(330 * kMs, 10)));
  rest.Keep(ImageAt(1300 * kMs), SurfaceAt(1300 * kMs, 0));
  EXPECT_TRUE(rest.Fits(SurfaceAt(1330 * kMs, 10)));
  rest.Clear();
  EXPECT_FALSE(rest.Fits(SurfaceAt(1340 * kMs, 10)));
}

}  // namespace
}  // namespace devo
