// SPDX-License-Identifier: BSD-3-Clause
//
// Counts what the whole process allocates, Eigen and OpenCV included: glibc lets a program bring its own malloc.
#include <atomic>
#include <cstddef>
#include <vector>

#include <gtest/gtest.h>

#include "devo/core/alignment.h"
#include "devo/core/nearest_edge_field.h"

namespace {
std::atomic<long> allocations{0};
}

extern "C" {
void* __libc_malloc(std::size_t size);  // NOLINT(bugprone-reserved-identifier,readability-identifier-naming)
void* malloc(std::size_t size) noexcept {
  allocations.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}
}

namespace devo {
namespace {

/// A grid of crosses on the plane z = 2, and the surface that shows it.
std::vector<MapPoint> Points(const Camera& camera, Surface* surface) {
  std::vector<MapPoint> points;
  surface->image = cv::Mat1b(camera.height(), camera.width(), std::uint8_t{0});
  for (int y = 20; y < camera.height() - 20; y += 20) {
    for (int x = 20; x < camera.width() - 20; ++x) {
      const bool upright = x % 20 < 10;
      const float u = static_cast<float>(upright ? x - x % 20 : x);
      const float v = upright ? static_cast<float>(y + x % 20) : static_cast<float>(y);
      surface->edges.push_back({u, v, upright ? 1.0F : 0.0F, upright ? 0.0F : 1.0F, 5, 0});
      MapPoint point;
      point.p_ref = (2 * *camera.Unproject({u, v})).cast<float>();
      point.normal_ref = {upright ? 1.0F : 0.0F, upright ? 0.0F : 1.0F, 0};
      points.push_back(point);
    }
  }
  surface->nearest_edge = cv::Mat1i(camera.height(), camera.width());
  BuildNearestEdgeField(surface->edges, 4, &surface->nearest_edge);
  return points;
}

TEST(Allocation, AlignAllocatesNothingOnceItHasSeenAsManyPoints) {
  const Camera camera(320, 240, 250, 250, 159.5, 119.5, "", {});
  Surface surface;
  const auto points = Points(camera, &surface);
  ASSERT_GT(points.size(), 2000U);
  PosePrior prior;
  Vector6d off;
  off << 0.01, -0.01, 0.005, 0.002, 0.001, 0.003;
  prior.T_event_ref = Exp(off);
  const OdometryOptions options;
  const auto first = Align(points, surface, camera, prior, Vector6d::Zero(), options);
  const long before = allocations;
  const auto second = Align(points, surface, camera, prior, Vector6d::Zero(), options);
  EXPECT_EQ(allocations - before, 0);
  EXPECT_GT(second.iterations, 1);
  EXPECT_EQ(first.T_event_ref.matrix(), second.T_event_ref.matrix());
  const std::vector<int> counted(1000);
  EXPECT_GT(allocations - before, 0) << "the count itself does not work";
}

}  // namespace
}  // namespace devo
