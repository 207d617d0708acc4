// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_registration.h"

#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Camera EventCamera() { return {160, 120, 120, 120, 79.5, 59.5, "", {}}; }

/// Half the resolution, a lens with distortion, beside the event camera and turned a little.
Camera DepthCamera() { return {100, 80, 62, 62, 50.2, 39.1, "plumb_bob", {-0.15, 0.03, 1e-3, -5e-4}}; }
Rigid3 EventFromDepth() { return {ExpSO3({0.01, -0.02, 0.015}), {0.05, -0.01, 0.02}}; }

/// The plane n . p = d in the event frame.
struct Plane {
  Eigen::Vector3d n;
  double d;
  double DepthAt(double x, double y) const { return d / n.dot(*EventCamera().Unproject({x, y})); }
};

DepthImage SeenBy(const Camera& camera, const Rigid3& T_event_depth, const Plane& plane) {
  DepthImage image;
  image.depth_m = cv::Mat1f(camera.height(), camera.width(), 0.0F);
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const auto ray = camera.Unproject(Eigen::Vector2d(x, y));
      if (!ray) continue;
      const double z =
          (plane.d - plane.n.dot(T_event_depth.translation())) / plane.n.dot(T_event_depth.rotation() * *ray);
      image.depth_m(y, x) = static_cast<float>(z);
    }
  }
  return image;
}

/// Sub-pixel positions that the depth camera sees with all their surroundings.
std::vector<EdgePoint> Edges() {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> x(25, 135), y(20, 100);
  std::vector<EdgePoint> edges(200);
  for (EdgePoint& edge : edges) edge = {x(random), y(random)};
  return edges;
}

void ExpectDepthOf(const Plane& plane, const Camera& depth_camera, const Rigid3& T_event_depth, double tolerance_m) {
  DepthRegistration registration(EventCamera(), depth_camera, MappingOptions());
  const auto edges = Edges();
  const int valid = registration.Warp(SeenBy(depth_camera, T_event_depth, plane), T_event_depth, edges);
  EXPECT_EQ(valid, depth_camera.width() * depth_camera.height());
  for (const EdgePoint& edge : edges) {
    const auto depth = registration.DepthAt(edge.x, edge.y);
    ASSERT_TRUE(depth) << edge.x << " " << edge.y;
    EXPECT_NEAR(depth->z_m, plane.DepthAt(edge.x, edge.y), tolerance_m) << edge.x << " " << edge.y;
    EXPECT_FALSE(depth->silhouette);
  }
}

const Plane kFrontal{{0, 0, 1}, 1.5}, kSlanted{Eigen::Vector3d(0.4, -0.2, 0.9).normalized(), 1.4};

TEST(DepthRegistration, GivesTheClosedFormDepthOfAFrontalPlaneSeenByAnOffsetDistortedCamera) {
  ExpectDepthOf(kFrontal, DepthCamera(), EventFromDepth(), 1e-4);
}

/// At most edges, where one pixel in twenty holds a reading and the others `none`.
void ExpectDepthOfSparse(float none) {
  DepthImage sparse = SeenBy(EventCamera(), Rigid3(), kSlanted);
  std::mt19937 random(4);
  for (float& z : sparse.depth_m) z = random() % 100 < 5 ? z : none;
  DepthRegistration registration(EventCamera(), EventCamera(), MappingOptions());
  const auto edges = Edges();
  registration.Warp(sparse, Rigid3(), edges);
  std::size_t found = 0;
  for (const EdgePoint& edge : edges) {
    const auto depth = registration.DepthAt(edge.x, edge.y);
    if (!depth) continue;
    ++found;
    EXPECT_NEAR(depth->z_m, kSlanted.DepthAt(edge.x, edge.y), 0.04) << edge.x << " " << edge.y;
  }
  EXPECT_GT(found, edges.size() / 2);
}

TEST(DepthRegistration, LooksFartherAroundAnEdgeWhereReadingsAreFarApart) {
  ExpectDepthOfSparse(0);
  ExpectDepthOfSparse(std::numeric_limits<float>::infinity());
  ExpectDepthOfSparse(std::numeric_limits<float>::quiet_NaN());
}

TEST(DepthRegistration, GivesTheClosedFormDepthOfASlantedPlaneToAMillimetre) {
  ExpectDepthOf(kSlanted, DepthCamera(), EventFromDepth(), 1e-3);
}

TEST(DepthRegistration, OfADepthImageRegisteredToTheDistortedEventImageOnlyUndistorts) {
  const Camera raw_event(160, 120, 120, 120, 79.5, 59.5, "plumb_bob", {-0.2, 0.05, 0, 0});
  ExpectDepthOf(kFrontal, raw_event, Rigid3(), 1e-4);
  ExpectDepthOf(kSlanted, raw_event, Rigid3(), 1e-3);
}

/// A registered depth image (no distortion): 1 m left of column 80, 2 m from there on.
cv::Mat1f Step() {
  cv::Mat1f depth(120, 160, 2.0F);
  depth.colRange(0, 80).setTo(1.0F);
  return depth;
}

std::optional<DepthRegistration::EdgeDepth> DepthIn(const cv::Mat1f& depth_m, float x, float y,
                                                    const MappingOptions& options = MappingOptions()) {
  DepthRegistration registration(EventCamera(), EventCamera(), options);
  registration.Warp({0, depth_m}, Rigid3(), {{x, y}});
  return registration.DepthAt(x, y);
}

TEST(DepthRegistration, GivesTheForegroundAtAStepAndCallsItASilhouette) {
  for (const float x : {78.6F, 79.4F, 79.5F, 80.0F}) {
    const auto depth = DepthIn(Step(), x, 60.3F);
    ASSERT_TRUE(depth) << x;
    EXPECT_NEAR(depth->z_m, 1, 1e-3) << x;
    EXPECT_TRUE(depth->silhouette) << x;
  }
}

TEST(DepthRegistration, GivesTheForegroundAtAStepOnEitherSideOfManyReadings) {
  // Five readings for each pixel of the event image, along both axes.
  for (const auto& [times, foreground_below] : {std::pair{5, true}, {5, false}, {12, true}, {12, false}}) {
    const Camera fine(160 * times, 120 * times, 120 * times, 120 * times, 80 * times - 0.5, 60 * times - 0.5, "", {});
    cv::Mat1f depth_m(fine.height(), fine.width(), 2.0F);
    const int step = 60 * times;
    depth_m.rowRange(foreground_below ? step : 0, foreground_below ? fine.height() : step).setTo(1.0F);
    DepthRegistration registration(EventCamera(), fine, MappingOptions());
    const float y = 59.4F + (foreground_below ? -0.5F : 0.5F);  // beside the step, over the background
    registration.Warp({0, depth_m}, Rigid3(), {{80, y}});
    const auto depth = registration.DepthAt(80, y);
    ASSERT_TRUE(depth) << times << foreground_below;
    EXPECT_NEAR(depth->z_m, 1, 1e-3) << times << foreground_below;
  }
}

TEST(DepthRegistration, GivesTheBackgroundAwayFromTheStep) {
  const auto depth = DepthIn(Step(), 84, 60.3F);
  ASSERT_TRUE(depth);
  EXPECT_NEAR(depth->z_m, 2, 1e-3);
  EXPECT_FALSE(depth->silhouette);
}

TEST(DepthRegistration, IgnoresFlyingPixels) {
  cv::Mat1f between = Step();
  between.col(80).setTo(1.5F);  // mixed from both sides, as time-of-flight cameras report
  const auto at_step = DepthIn(between, 79.6F, 60.3F);
  ASSERT_TRUE(at_step);
  EXPECT_NEAR(at_step->z_m, 1, 1e-3);

  cv::Mat1f in_front(120, 160, 2.0F);
  in_front(60, 50) = in_front(61, 50) = 0.6F;
  const auto on_plane = DepthIn(in_front, 50.2F, 60.3F);
  ASSERT_TRUE(on_plane);
  EXPECT_NEAR(on_plane->z_m, 2, 1e-3);
}

TEST(DepthRegistration, TakesTheNearestReadingForTheForegroundWhenFlyingPixelsAreNotSoughtFor) {
  cv::Mat1f in_front(120, 160, 2.0F);
  in_front(60, 50) = in_front(61, 50) = 0.6F;
  MappingOptions options;
  options.ideas.flying_pixels = false;
  const auto depth = DepthIn(in_front, 50.2F, 60.3F, options);
  ASSERT_TRUE(depth);
  EXPECT_NEAR(depth->z_m, 0.6, 1e-3);
}

TEST(DepthRegistration, RefusesReadingsThatAreFarAndOnOneSideUnlessThatIsSwitchedOff) {
  cv::Mat1f left_half(120, 160, 0.0F);
  left_half.colRange(0, 51).setTo(2);
  MappingOptions options;
  EXPECT_FALSE(DepthIn(left_half, 51.5F, 60.3F, options));
  options.ideas.surrounded_depth = false;
  const auto depth = DepthIn(left_half, 51.5F, 60.3F, options);
  ASSERT_TRUE(depth);
  EXPECT_NEAR(depth->z_m, 2, 1e-3);
}

TEST(DepthRegistration, NeverTakesInvalidReadings) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const float invalid : {0.0F, -1.0F, nan, infinity, -infinity, 0.05F, 1000.0F}) {
    EXPECT_FALSE(DepthIn(cv::Mat1f(120, 160, invalid), 50.2F, 60.3F)) << invalid;
    cv::Mat1f every_other(120, 160, 2.0F);
    for (int y = 0; y < 120; ++y) {
      for (int x = y % 2; x < 160; x += 2) every_other(y, x) = invalid;
    }
    const auto depth = DepthIn(every_other, 50.2F, 60.3F);
    ASSERT_TRUE(depth) << invalid;
    EXPECT_NEAR(depth->z_m, 2, 1e-3) << invalid;
    EXPECT_FALSE(depth->silhouette) << invalid;
  }
}

TEST(DepthRegistration, GivesNoDepthInsideAHole) {
  cv::Mat1f depth(120, 160, 2.0F);
  depth(cv::Rect(45, 55, 11, 11)).setTo(0);
  EXPECT_FALSE(DepthIn(depth, 50, 60));
}

TEST(DepthRegistration, CountsOnlyValidReadings) {
  DepthRegistration registration(EventCamera(), EventCamera(), MappingOptions());
  cv::Mat1f depth(120, 160, 0.0F);
  EXPECT_EQ(registration.Warp({0, depth}, Rigid3(), {}), 0);
  depth.row(7).setTo(1.0F);
  depth(7, 3) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(registration.Warp({0, depth}, Rigid3(), {}), 159);
}

TEST(DepthRegistration, ForgetsTheLastImage) {
  DepthRegistration registration(EventCamera(), EventCamera(), MappingOptions());
  const std::vector<EdgePoint> edges = {{50.2F, 60.3F}};
  registration.Warp({0, cv::Mat1f(120, 160, 1.0F)}, Rigid3(), edges);
  registration.Warp({0, cv::Mat1f(120, 160, 3.0F)}, Rigid3(), edges);
  EXPECT_NEAR(registration.DepthAt(50.2F, 60.3F)->z_m, 3, 1e-3);
  EXPECT_EQ(registration.nearest_depth()(15, 12), 3);
  registration.Warp({0, cv::Mat1f(120, 160, 0.0F)}, Rigid3(), edges);
  EXPECT_FALSE(registration.DepthAt(50.2F, 60.3F));
}

TEST(DepthRegistration, RefusesAnImageOfAnotherSizeAndNamesBoth) {
  DepthRegistration registration(EventCamera(), DepthCamera(), MappingOptions());
  EXPECT_THAT(
      [&] {
        registration.Warp({0, cv::Mat1f(60, 90, 1.0F)}, Rigid3(), {});
      },
      ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("90x60"), HasSubstr("100x80"))));
}

TEST(DepthRegistration, KeepsTheNearestDepthOfEachCellForOcclusion) {
  DepthRegistration registration(EventCamera(), EventCamera(), MappingOptions());
  cv::Mat1f depth(120, 160, 2.0F);
  depth(21, 42) = 0.7F;
  depth(cv::Rect(80, 80, 4, 4)).setTo(0);
  registration.Warp({0, depth}, Rigid3(), {});
  EXPECT_EQ(registration.nearest_depth()(5, 10), 0.7F);
  EXPECT_EQ(registration.nearest_depth()(5, 11), 2.0F);
  EXPECT_EQ(registration.nearest_depth()(20, 20), 0.0F);
}

}  // namespace
}  // namespace devo
