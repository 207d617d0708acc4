// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/nearest_edge_field.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

namespace devo {
namespace {

/// Squared distance of a pixel to an edge, px^2.
double SquaredDistance(const EdgePoint& edge, int x, int y) {
  return (edge.x - x) * (edge.x - x) + (edge.y - y) * (edge.y - y);
}

void ExpectBruteForceField(const std::vector<EdgePoint>& edges, int radius, int width, int height) {
  Surface surface;
  surface.edges = edges;
  surface.nearest_edge.create(height, width);
  BuildNearestEdgeField(edges, radius, &surface.nearest_edge);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double nearest2 = 1e9;
      for (const EdgePoint& edge : edges) {
        const bool in_square =
            std::abs(std::floor(edge.x + 0.5) - x) <= radius && std::abs(std::floor(edge.y + 0.5) - y) <= radius;
        if (in_square) nearest2 = std::min(nearest2, SquaredDistance(edge, x, y));
      }
      const int id = surface.NearestEdge(x, y);
      ASSERT_EQ(id < 0, nearest2 == 1e9) << "at " << x << " " << y << " radius " << radius;
      // The field counts in sixteenths of a square pixel, for x and y each.
      if (id >= 0) {
        ASSERT_LE(SquaredDistance(edges[id], x, y), nearest2 + 2.0 / 16) << "at " << x << " " << y;
      }
    }
  }
}

TEST(NearestEdgeField, HoldsWhatBruteForceFindsForFewAndManyEdges) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> in_x(-0.4F, 95.4F), in_y(-0.4F, 63.4F);
  for (const int radius : {1, 4, 5, 6, 30}) {
    for (const int count : {1, 20, 300}) {
      std::vector<EdgePoint> edges(count);
      for (EdgePoint& edge : edges) edge = {std::abs(in_x(random)), std::abs(in_y(random))};
      ExpectBruteForceField(edges, radius, 96, 64);
    }
  }
}

/// As Surface::nearest_edge says, one edge after the other.
cv::Mat1i PackedField(const std::vector<EdgePoint>& edges, int radius, int width, int height) {
  cv::Mat1i nearest(height, width, std::int32_t{Surface::kNoEdge});
  const auto packed = [](float d) { return static_cast<std::int32_t>(16.0F * d * d) << 16; };
  for (int k = 0; k < static_cast<int>(edges.size()); ++k) {
    const int cx = static_cast<int>(edges[k].x + 0.5F), cy = static_cast<int>(edges[k].y + 0.5F);
    for (int y = std::max(cy - radius, 0); y <= std::min(cy + radius, height - 1); ++y) {
      for (int x = std::max(cx - radius, 0); x <= std::min(cx + radius, width - 1); ++x) {
        const std::int32_t here =
            packed(static_cast<float>(x) - edges[k].x) + packed(static_cast<float>(y) - edges[k].y) + k;
        nearest(y, x) = std::min(nearest(y, x), here);
      }
    }
  }
  return nearest;
}

TEST(NearestEdgeField, IsTheSameToTheBitWithAndWithoutWideRegisters) {
  std::mt19937 random(9);
  for (const int width : {15, 16, 17, 100}) {
    std::uniform_real_distribution<float> in_x(0, width - 0.6F), in_y(0, 39.4F);
    std::vector<EdgePoint> edges(150);
    for (EdgePoint& edge : edges) edge = {in_x(random), in_y(random)};
    for (const int radius : {1, 3, 4, 5}) {
      const cv::Mat1i expected = PackedField(edges, radius, width, 40);
      for (const bool optimised : {true, false}) {
        cv::setUseOptimized(optimised);
        cv::Mat1i nearest(40, width);
        BuildNearestEdgeField(edges, radius, &nearest);
        cv::setUseOptimized(true);
        EXPECT_EQ(cv::countNonZero(nearest != expected), 0)
            << "width " << width << ", radius " << radius << ", wide registers " << optimised;
      }
    }
  }
}

/// A processor's registers are looked up once in a process: narrower ones are tried in another.
TEST(NearestEdgeField, IsTheSameOnAProcessorWithoutTheWidestRegisters) {
  const std::string itself = std::filesystem::read_symlink("/proc/self/exe");
  for (const std::string narrower : {"AVX512-SKX", "AVX512-SKX,AVX2"}) {
    const std::string command = "OPENCV_CPU_DISABLE=" + narrower + " '" + itself +
                                "' --gtest_filter=NearestEdgeField.IsTheSameToTheBit* --gtest_output= > /dev/null";
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
  }
}

TEST(NearestEdgeField, StaysInsideTheImageAtItsBordersAndCorners) {
  for (const int radius : {4, 30}) {
    ExpectBruteForceField({{0, 0}, {39, 0}, {0, 29}, {39.4F, 29.4F}, {20, 0.2F}, {0.4F, 15}, {38.7F, 15}}, radius, 40,
                          30);
  }
}

TEST(NearestEdgeField, OfNoEdgesHoldsNone) {
  cv::Mat1i nearest(10, 10);
  BuildNearestEdgeField({}, 4, &nearest);
  EXPECT_EQ(cv::countNonZero(nearest != Surface::kNoEdge), 0);
}

}  // namespace
}  // namespace devo
