// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/scene_depth.h"

#include <utility>
#include <vector>

#include "devo/core/depth_registration.h"
#include "devo/core/median.h"

namespace devo {
namespace {

constexpr std::size_t kMinReadings = 16;  // cells
constexpr int kMinPoints = 3;             // of a hole: fewer may be strays

/// 0 with too few readings.
double MedianDepth(const cv::Mat1f& nearest_depth_m) {
  std::vector<float> readings;
  for (const float z_m : nearest_depth_m) {
    if (z_m > 0) readings.push_back(z_m);
  }
  return readings.size() < kMinReadings ? 0 : Median(std::move(readings));
}

/// Of values of one square of the grid.
struct Mean {
  double sum = 0;
  int count = 0;

  void Add(double value) {
    sum += value;
    ++count;
  }
};

/// Of the readings' inverse depth, 1/m.
Mean InverseDepthIn(const cv::Mat1f& square_m) {
  Mean mean;
  for (const float z_m : square_m) {
    if (z_m > 0) mean.Add(1.0 / z_m);
  }
  return mean;
}

/// Of the points' inverse depth in each square of the grid, row by row.
std::vector<Mean> InverseDepthOf(const std::vector<ReferenceMap::Visible>& points, const cv::Size& grid) {
  std::vector<Mean> means(grid.area());
  for (const ReferenceMap::Visible& point : points) {
    const int row = static_cast<int>(point.v) / SceneDepth::kCell_px;
    const int column = static_cast<int>(point.u) / SceneDepth::kCell_px;
    means[row * grid.width + column].Add(1.0 / point.p_event.z());
  }
  return means;
}

}  // namespace

SceneDepth MakeSceneDepth(std::int64_t t_ns, const cv::Mat1f& nearest_depth_m,
                          const std::vector<ReferenceMap::Visible>& points, double median_before_m) {
  constexpr int kSide = SceneDepth::kCell_px / DepthRegistration::kCell;
  SceneDepth scene;
  scene.t_ns = t_ns;
  const double median_m = MedianDepth(nearest_depth_m);
  scene.median_m = median_m > 0 ? median_m : median_before_m;
  if (scene.median_m == 0) return scene;
  scene.inverse_depth.create((nearest_depth_m.rows + kSide - 1) / kSide, (nearest_depth_m.cols + kSide - 1) / kSide);
  const std::vector<Mean> of_points = InverseDepthOf(points, scene.inverse_depth.size());
  auto points_there = of_points.begin();
  const cv::Rect all({}, nearest_depth_m.size());
  for (int row = 0; row < scene.inverse_depth.rows; ++row) {
    for (int column = 0; column < scene.inverse_depth.cols; ++column, ++points_there) {
      const cv::Rect square(column * kSide, row * kSide, kSide, kSide);
      Mean mean = InverseDepthIn(nearest_depth_m(square & all));
      if (mean.count == 0 && points_there->count >= kMinPoints) mean = *points_there;
      scene.inverse_depth(row, column) = static_cast<float>(mean.count ? mean.sum / mean.count : 1 / scene.median_m);
    }
  }
  return scene;
}

}  // namespace devo
