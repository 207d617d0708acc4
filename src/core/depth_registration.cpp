// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_registration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include <Eigen/Cholesky>

namespace devo {
namespace {

// Two neighbouring readings farther apart than this lie on two surfaces: 2.5 % covers slanted surfaces and the
// noise of time-of-flight cameras, the constant covers millimetre quantisation at short range.
float SurfaceGap(float z_m) { return 0.025F * z_m + 0.008F; }

constexpr int kMinReadings = 3;
constexpr std::size_t kMaxReadings = 64;

struct Neighbour {
  float dx, dy, z;
};

/// Inverse depth is linear in the image on a plane: weighted least squares of a + b dx + c dy, value at 0. The
/// slope is regularised, so that one-sided readings are extrapolated only as far as they show a slope.
float InterpolateOnPlane(const Neighbour* begin, const Neighbour* end, float radius) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Neighbour* n = begin; n != end; ++n) {
    const Eigen::Vector3d basis(1, n->dx / radius, n->dy / radius);
    const double weight = std::exp(-2.0 * (n->dx * n->dx + n->dy * n->dy) / (radius * radius));
    A += weight * basis * basis.transpose();
    b += weight / n->z * basis;
  }
  A(1, 1) += 0.5;
  A(2, 2) += 0.5;
  return static_cast<float>(1.0 / A.ldlt().solve(b)[0]);
}

}  // namespace

DepthRegistration::DepthRegistration(const Camera& event_camera, const Camera& depth_camera,
                                     const MappingOptions& options)
    : event_camera_(event_camera), options_(options), depth_rays_(RayTable(depth_camera)),
      radius_px_(static_cast<float>(std::clamp(2.0 * event_camera.fx() / depth_camera.fx(), 1.5, 4.0))),
      wanted_(event_camera.height(), event_camera.width()), first_(event_camera.height(), event_camera.width()),
      cell_depth_((event_camera.height() + kCell - 1) / kCell, (event_camera.width() + kCell - 1) / kCell) {}

void DepthRegistration::MarkNeighbourhoods(const std::vector<EdgePoint>& edges) {
  wanted_.setTo(0);
  const int reach = static_cast<int>(std::ceil(radius_px_));
  for (const EdgePoint& edge : edges) {
    const int x = static_cast<int>(std::lround(edge.x)), y = static_cast<int>(std::lround(edge.y));
    const int x0 = std::max(x - reach, 0), x1 = std::min(x + reach, wanted_.cols - 1);
    const int y0 = std::max(y - reach, 0), y1 = std::min(y + reach, wanted_.rows - 1);
    for (int row = y0; row <= y1; ++row) std::fill(wanted_[row] + x0, wanted_[row] + x1 + 1, 255);
  }
}

int DepthRegistration::Warp(const DepthImage& depth, const Rigid3& T_event_depth, const std::vector<EdgePoint>& edges) {
  if (depth.depth_m.size() != depth_rays_.size()) {
    std::ostringstream message;
    message << "depth image of " << depth.depth_m.cols << "x" << depth.depth_m.rows << " pixels; expected "
            << depth_rays_.cols << "x" << depth_rays_.rows << " as in the depth camera's calibration";
    throw std::invalid_argument(message.str());
  }
  MarkNeighbourhoods(edges);
  first_.setTo(-1);
  cell_depth_.setTo(0);
  readings_.clear();
  const Eigen::Matrix3f R = T_event_depth.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_event_depth.translation().cast<float>();
  const auto fx = static_cast<float>(event_camera_.fx()), fy = static_cast<float>(event_camera_.fy());
  const auto cx = static_cast<float>(event_camera_.cx()) + 0.5F, cy = static_cast<float>(event_camera_.cy()) + 0.5F;
  const auto width = static_cast<float>(event_camera_.width()), height = static_cast<float>(event_camera_.height());
  const auto min_m = static_cast<float>(options_.min_depth_m), max_m = static_cast<float>(options_.max_depth_m);
  int valid = 0;
  for (int y = 0; y < depth.depth_m.rows; ++y) {
    const float* z_depth = depth.depth_m[y];
    const cv::Vec2f* ray = depth_rays_[y];
    for (int x = 0; x < depth.depth_m.cols; ++x) {
      const float z = ValidDepthOrZero(z_depth[x], min_m, max_m);
      if (!(z > 0)) continue;
      const float a = ray[x][0], b = ray[x][1];
      const float Z = z * (R(2, 0) * a + R(2, 1) * b + R(2, 2)) + t.z();
      if (!(Z > 0.01F)) continue;  // also drops pixels without a ray (NaN)
      ++valid;
      const float X = z * (R(0, 0) * a + R(0, 1) * b + R(0, 2)) + t.x();
      const float Y = z * (R(1, 0) * a + R(1, 1) * b + R(1, 2)) + t.y();
      const float inverse_depth = 1 / Z;
      const float u = fx * X * inverse_depth + cx,
                  v = fy * Y * inverse_depth + cy;  // half a pixel ahead: truncation rounds
      if (!(u >= 0 && v >= 0 && u < width && v < height)) continue;
      const int column = static_cast<int>(u), row = static_cast<int>(v);
      float& cell = cell_depth_(row / kCell, column / kCell);
      if (cell == 0 || Z < cell) cell = Z;
      if (!wanted_(row, column)) continue;
      readings_.push_back({u - 0.5F, v - 0.5F, Z, first_(row, column)});
      first_(row, column) = static_cast<int>(readings_.size()) - 1;
    }
  }
  return valid;
}

std::optional<DepthRegistration::EdgeDepth> DepthRegistration::DepthAt(float x, float y) const {
  std::array<Neighbour, kMaxReadings> around;
  std::size_t count = 0;
  const int reach = static_cast<int>(std::ceil(radius_px_));
  const int x_px = static_cast<int>(std::lround(x)), y_px = static_cast<int>(std::lround(y));
  for (int row = std::max(y_px - reach, 0); row <= std::min(y_px + reach, first_.rows - 1); ++row) {
    for (int column = std::max(x_px - reach, 0); column <= std::min(x_px + reach, first_.cols - 1); ++column) {
      for (int i = first_(row, column); i >= 0 && count < kMaxReadings; i = readings_[i].next) {
        const float dx = readings_[i].u - x, dy = readings_[i].v - y;
        if (dx * dx + dy * dy <= radius_px_ * radius_px_) around[count++] = {dx, dy, readings_[i].z};
      }
    }
  }
  if (count < kMinReadings) return std::nullopt;
  std::sort(around.begin(), around.begin() + count, [](const Neighbour& a, const Neighbour& b) { return a.z < b.z; });

  // The nearest cluster that is more than a few flying pixels is the foreground.
  const std::size_t enough = std::max<std::size_t>(kMinReadings, count / 6);
  std::size_t begin = 0, end = 1;
  for (; end <= count; ++end) {
    if (end < count && around[end].z - around[end - 1].z < SurfaceGap(around[end].z)) continue;
    if (end - begin >= enough) break;
    begin = end;
  }
  if (end > count || end - begin < enough) return std::nullopt;

  int quadrants = 0;
  float nearest2 = radius_px_ * radius_px_, mean = 0;
  for (std::size_t i = begin; i < end; ++i) {
    quadrants |= 1 << ((around[i].dx > 0) + 2 * (around[i].dy > 0));
    nearest2 = std::min(nearest2, around[i].dx * around[i].dx + around[i].dy * around[i].dy);
    mean += around[i].z / (end - begin);
  }
  const bool surrounded = (quadrants & (quadrants - 1)) != 0 && quadrants != 0b0011 && quadrants != 0b1100 &&
                          quadrants != 0b0101 && quadrants != 0b1010;
  const bool silhouette = end < count;
  // Not surrounded, the edge is a silhouette (readings of the background beyond) or beside a hole.
  if (!surrounded && nearest2 > 0.25F * radius_px_ * radius_px_ + 0.5F) return std::nullopt;
  float variance = 0;
  for (std::size_t i = begin; i < end; ++i) variance += (around[i].z - mean) * (around[i].z - mean) / (end - begin);
  const float z = InterpolateOnPlane(&around[begin], around.data() + end, radius_px_);
  const float slack = SurfaceGap(mean);
  if (!(z > around[begin].z - slack && z < around[end - 1].z + slack)) return std::nullopt;
  return EdgeDepth{z, std::sqrt(variance / static_cast<float>(end - begin)) + 1e-4F, silhouette};
}

SceneDepth DepthRegistration::MakeSceneDepth(std::int64_t t_ns) const {
  constexpr int kGrid = 4;  // cells of the grid per side of kCell cells: 16 pixels
  SceneDepth scene;
  scene.t_ns = t_ns;
  std::vector<float> all;
  for (const float z : cell_depth_) {
    if (z > 0) all.push_back(z);
  }
  if (all.size() < 16) return scene;
  std::nth_element(all.begin(), all.begin() + all.size() / 2, all.end());
  scene.median_m = all[all.size() / 2];
  scene.inverse_depth.create((cell_depth_.rows + kGrid - 1) / kGrid, (cell_depth_.cols + kGrid - 1) / kGrid);
  for (int gy = 0; gy < scene.inverse_depth.rows; ++gy) {
    for (int gx = 0; gx < scene.inverse_depth.cols; ++gx) {
      double sum = 0;
      int count = 0;
      for (int y = gy * kGrid; y < std::min((gy + 1) * kGrid, cell_depth_.rows); ++y) {
        for (int x = gx * kGrid; x < std::min((gx + 1) * kGrid, cell_depth_.cols); ++x) {
          if (cell_depth_(y, x) > 0) {
            sum += 1.0 / cell_depth_(y, x);
            ++count;
          }
        }
      }
      scene.inverse_depth(gy, gx) = static_cast<float>(count ? sum / count : 1.0 / scene.median_m);
    }
  }
  return scene;
}

}  // namespace devo
