// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_registration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <sstream>
#include <stdexcept>

#include "simd.h"

namespace devo {
namespace {

// Two neighbouring readings farther apart than this lie on two surfaces: 2.5 % covers slanted surfaces and the
// noise of time-of-flight cameras, the constant covers millimetre quantisation at short range.
float SurfaceGap(float z_m) { return 0.025F * z_m + 0.008F; }

constexpr int kCellBits = 2;
static_assert(1 << kCellBits == DepthRegistration::kCell);
constexpr int kMinReadings = 3;
constexpr std::size_t kMaxReadings = 64;
constexpr int kMaxReach = 4;  // px

struct Neighbour {
  float dx, dy, z;
};

/// About exp(-2 share) for 0 to 1, which is not worth a call for each reading.
double Weight(double share) {
  double weight = 1 - 0.25 * share;
  for (int k = 0; k < 3; ++k) weight *= weight;
  return weight;
}

/// Inverse depth is linear in the image on a plane: weighted least squares of a + b dx + c dy, value at 0. The
/// slope is regularised, so that one-sided readings are extrapolated only as far as they show a slope.
float InterpolateOnPlane(const Neighbour* begin, const Neighbour* end, float radius) {
  const double scale = 1.0 / radius;
  // Normal equations in scalars, which stay in registers: the sums over a handful of readings are all the cost.
  double a11 = 0, a12 = 0, a13 = 0, a22 = 0.5, a23 = 0, a33 = 0.5, b1 = 0, b2 = 0, b3 = 0;
  for (const Neighbour* n = begin; n != end; ++n) {
    const double x = n->dx * scale, y = n->dy * scale, weight = Weight(x * x + y * y);
    const double wx = weight * x, wy = weight * y, w_inverse = weight * (1.0F / n->z);
    a11 += weight;
    a12 += wx;
    a13 += wy;
    a22 += wx * x;
    a23 += wx * y;
    a33 += wy * y;
    b1 += w_inverse;
    b2 += w_inverse * x;
    b3 += w_inverse * y;
  }
  // Cramer's rule for the first unknown; the matrix is positive definite with half a unit on its diagonal.
  const double c1 = a22 * a33 - a23 * a23, c2 = a13 * a23 - a12 * a33, c3 = a12 * a23 - a13 * a22;
  return static_cast<float>((a11 * c1 + a12 * c2 + a13 * c3) / (b1 * c1 + b2 * c2 + b3 * c3));
}

/// Readings of one surface.
struct Cluster {
  const Neighbour *begin, *end;
  float nearest_m, farthest_m;
};

/// The nearest cluster that is more than a few flying pixels; empty where there is none. Sorts the readings, unless
/// they are all of one surface. `end` stays that of all where nothing is behind the cluster.
Cluster Foreground(Neighbour* first, Neighbour* last, bool without_flying) {
  const auto nearer = [](const Neighbour& a, const Neighbour& b) { return a.z < b.z; };
  const auto [nearest, farthest] = std::minmax_element(first, last, nearer);
  // Then no two are farther apart than readings of one surface.
  if (farthest->z - nearest->z < SurfaceGap(nearest->z)) return {first, last, nearest->z, farthest->z};
  std::sort(first, last, nearer);
  const std::ptrdiff_t enough = without_flying ? std::max<std::ptrdiff_t>(kMinReadings, (last - first) / 6) : 1;
  const Neighbour* begin = first;
  for (const Neighbour* end = first + 1; end <= last; ++end) {
    if (end < last && end->z - (end - 1)->z < SurfaceGap(end->z)) continue;
    if (end - begin >= enough) return {begin, end, begin->z, (end - 1)->z};
    begin = end;
  }
  return {last, last, 0, 0};
}

/// Sets a square of kWidth x kWidth pixels; the fixed width makes each row a few plain stores.
template <int kWidth>
void FillSquare(std::uint8_t* first, std::size_t step) {
  for (int row = 0; row < kWidth; ++row) std::memset(first + row * step, 255, kWidth);
}

}  // namespace

DepthRegistration::DepthRegistration(const Camera& event_camera, const Camera& depth_camera,
                                     const MappingOptions& options)
    : event_camera_(event_camera), options_(options), depth_rays_(2),
      radius_px_(static_cast<float>(std::clamp(2.0 * event_camera.fx() / depth_camera.fx(), 1.5, double{kMaxReach}))),
      wanted_(event_camera.height(), event_camera.width()), first_(event_camera.height(), event_camera.width()),
      readings_(static_cast<std::size_t>(depth_camera.width()) * depth_camera.height()),
      cell_depth_((event_camera.height() + kCell - 1) / kCell, (event_camera.width() + kCell - 1) / kCell),
      row_z_(depth_camera.width()), row_u_(depth_camera.width()), row_v_(depth_camera.width()),
      row_pixel_(depth_camera.width()), row_cell_(depth_camera.width()) {
  cv::split(RayTable(depth_camera), depth_rays_);
}

void DepthRegistration::MarkNeighbourhoods(const std::vector<EdgePoint>& edges) {
  wanted_.setTo(0);
  const int reach = static_cast<int>(std::ceil(radius_px_));  // 2 to 4
  const auto fill = reach == 2 ? FillSquare<5> : reach == 3 ? FillSquare<7> : FillSquare<9>;
  for (const EdgePoint& edge : edges) {
    const int x = static_cast<int>(edge.x + 0.5F), y = static_cast<int>(edge.y + 0.5F);
    const int x0 = std::max(x - reach, 0), x1 = std::min(x + reach, wanted_.cols - 1);
    const int y0 = std::max(y - reach, 0), y1 = std::min(y + reach, wanted_.rows - 1);
    if (x1 - x0 == 2 * reach && y1 - y0 == 2 * reach) {
      fill(wanted_[y0] + x0, wanted_.step);
    } else {
      for (int row = y0; row <= y1; ++row) std::fill(wanted_[row] + x0, wanted_[row] + x1 + 1, 255);
    }
  }
}

int DepthRegistration::WarpRow(const float* z_depth, int y, const Eigen::Matrix3f& R, const Eigen::Vector3f& t) {
  const auto fx = static_cast<float>(event_camera_.fx()), fy = static_cast<float>(event_camera_.fy());
  const auto cx = static_cast<float>(event_camera_.cx()) + 0.5F, cy = static_cast<float>(event_camera_.cy()) + 0.5F;
  const auto width = static_cast<float>(event_camera_.width()), height = static_cast<float>(event_camera_.height());
  const auto min_m = static_cast<float>(options_.min_depth_m), max_m = static_cast<float>(options_.max_depth_m);
  const auto *ray_x = depth_rays_[0].ptr<float>(y), *ray_y = depth_rays_[1].ptr<float>(y);
  const int columns = depth_rays_[0].cols;
  int valid = 0, x = 0;
  const auto warp = [&](float z, float a, float b) {
    z = ValidDepthOrZero(z, min_m, max_m);
    const float Z = z * (R(2, 0) * a + R(2, 1) * b + R(2, 2)) + t.z();
    const float X = z * (R(0, 0) * a + R(0, 1) * b + R(0, 2)) + t.x();
    const float Y = z * (R(1, 0) * a + R(1, 1) * b + R(1, 2)) + t.y();
    const bool good = z > 0 && Z > 0.01F;  // also drops pixels without a ray (NaN)
    const float inverse_depth = 1 / Z;
    // Half a pixel ahead: truncation rounds.
    const float u = fx * X * inverse_depth + cx, v = fy * Y * inverse_depth + cy;
    const bool inside = good && u >= 0 && v >= 0 && u < width && v < height;
    valid += good;
    row_z_[x] = Z;
    row_u_[x] = u;
    row_v_[x] = v;
    row_pixel_[x] = inside ? static_cast<int>(v) * wanted_.cols + static_cast<int>(u) : -1;
    row_cell_[x] = inside ? static_cast<int>(v) / kCell * cell_depth_.cols + static_cast<int>(u) / kCell : -1;
  };
#if CV_SIMD128
  // The same operations in the same order, four readings at a time.
  using cv::v_float32x4;
  using cv::v_int32x4;
  const auto all = [](float value) { return cv::v_setall_f32(value); };
  const auto line = [&](const v_float32x4& a, const v_float32x4& b, int row) {
    return all(R(row, 0)) * a + all(R(row, 1)) * b + all(R(row, 2));
  };
  // Of two numbers below 2^15 each, which are those of an image: multiplied and added at once.
  const auto index = [](const v_int32x4& rows, const v_int32x4& columns, int width) {
    return cv::v_dotprod(cv::v_reinterpret_as_s16((rows << 16) | columns),
                         cv::v_reinterpret_as_s16(cv::v_setall_s32(width << 16 | 1)));
  };
  v_int32x4 valid4 = cv::v_setzero_s32();
  for (; x + 4 <= columns; x += 4) {
    const v_float32x4 read = cv::v_load(z_depth + x), a = cv::v_load(ray_x + x), b = cv::v_load(ray_y + x);
    const v_float32x4 z = read & (read >= all(min_m)) & (read <= all(max_m));
    const v_float32x4 Z = z * line(a, b, 2) + all(t.z());
    const v_float32x4 X = z * line(a, b, 0) + all(t.x());
    const v_float32x4 Y = z * line(a, b, 1) + all(t.y());
    const v_float32x4 good = (z > all(0)) & (Z > all(0.01F)), inverse_depth = all(1) / Z;
    const v_float32x4 u = all(fx) * X * inverse_depth + all(cx), v = all(fy) * Y * inverse_depth + all(cy);
    const v_float32x4 inside = good & (u >= all(0)) & (v >= all(0)) & (u < all(width)) & (v < all(height));
    const v_int32x4 row = cv::v_trunc(v), column = cv::v_trunc(u), outside = ~cv::v_reinterpret_as_s32(inside);
    const v_int32x4 pixel = index(row, column, wanted_.cols);
    const v_int32x4 cell = index(row >> kCellBits, column >> kCellBits, cell_depth_.cols);
    valid4 = valid4 - cv::v_reinterpret_as_s32(good);  // a mask is -1
    cv::v_store(row_z_.data() + x, Z);
    cv::v_store(row_u_.data() + x, u);
    cv::v_store(row_v_.data() + x, v);
    cv::v_store(row_pixel_.data() + x, pixel | outside);
    cv::v_store(row_cell_.data() + x, cell | outside);
  }
  valid = cv::v_reduce_sum(valid4);
#endif
  for (; x < columns; ++x) warp(z_depth[x], ray_x[x], ray_y[x]);
  return valid;
}

int DepthRegistration::Warp(const DepthImage& depth, const Rigid3& T_event_depth, const std::vector<EdgePoint>& edges) {
  const cv::Size size = depth_rays_[0].size();
  if (depth.depth_m.size() != size) {
    std::ostringstream message;
    message << "depth image of " << depth.depth_m.cols << "x" << depth.depth_m.rows << " pixels; expected "
            << size.width << "x" << size.height << " as in the depth camera's calibration";
    throw std::invalid_argument(message.str());
  }
  MarkNeighbourhoods(edges);
  first_.setTo(-1);
  cell_depth_.setTo(0);
  const Eigen::Matrix3f R = T_event_depth.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_event_depth.translation().cast<float>();
  int valid = 0, count = 0, *first = first_.ptr<int>();
  const std::uint8_t* wanted = wanted_.ptr<std::uint8_t>();
  float* cells = cell_depth_.ptr<float>();
  for (int y = 0; y < size.height; ++y) {
    valid += WarpRow(depth.depth_m[y], y, R, t);
    // Neighbouring readings mostly fall into one cell: its nearest is kept at hand.
    float nearest = 0;
    int cell = -1;
    for (int x = 0; x < size.width; ++x) {
      const int pixel = row_pixel_[x];
      if (pixel < 0) continue;
      const float Z = row_z_[x];
      if (row_cell_[x] != cell) {
        if (cell >= 0) cells[cell] = nearest;
        cell = row_cell_[x];
        nearest = cells[cell] > 0 ? cells[cell] : Z;
      }
      nearest = std::min(nearest, Z);
      if (!wanted[pixel]) continue;
      readings_[count] = {row_u_[x] - 0.5F, row_v_[x] - 0.5F, Z, first[pixel]};
      first[pixel] = count++;
    }
    if (cell >= 0) cells[cell] = nearest;
  }
  return valid;
}

void DepthRegistration::FetchLists(const EdgePoint& edge) const {
  const int reach = static_cast<int>(std::ceil(radius_px_));
  const int x = static_cast<int>(edge.x + 0.5F), y = static_cast<int>(edge.y + 0.5F);
  const int x0 = std::max(x - reach, 0), x1 = std::min(x + reach, first_.cols - 1);
  for (int row = std::max(y - reach, 0); row <= std::min(y + reach, first_.rows - 1); ++row) {
    PrefetchToRead(first_[row] + x0);
    PrefetchToRead(first_[row] + x1);
  }
}

void DepthRegistration::FetchReadings(const EdgePoint& edge) const {
  const int reach = static_cast<int>(std::ceil(radius_px_));
  const int x = static_cast<int>(edge.x + 0.5F), y = static_cast<int>(edge.y + 0.5F);
  // Readings of pixels side by side mostly lie side by side, too.
  for (int row = std::max(y - reach, 0); row <= std::min(y + reach, first_.rows - 1); ++row) {
    const int reading = first_(row, x);
    if (reading >= 0) PrefetchToRead(readings_.data() + reading);
  }
}

std::optional<DepthRegistration::EdgeDepth> DepthRegistration::DepthAt(float x, float y) const {
  std::array<Neighbour, kMaxReadings> around;
  std::size_t count = 0;
  const int reach = static_cast<int>(std::ceil(radius_px_));
  const int x_px = static_cast<int>(x + 0.5F), y_px = static_cast<int>(y + 0.5F);
  const float radius2 = radius_px_ * radius_px_;
  // A reading lies within half a pixel of its pixel's centre: pixels farther than that from the circle are left out.
  const auto gap2 = [](float d) {
    const float gap = std::max(0.0F, std::abs(d) - 0.501F);
    return gap * gap;
  };
  const int x0 = std::max(x_px - reach, 0), x1 = std::min(x_px + reach, first_.cols - 1);
  std::array<float, 2 * kMaxReach + 1> column_gap2;
  for (int column = x0; column <= x1; ++column) column_gap2[column - x0] = gap2(column - x);
  for (int row = std::max(y_px - reach, 0); row <= std::min(y_px + reach, first_.rows - 1); ++row) {
    const float row_gap2 = gap2(row - y);
    const int* first = first_[row];
    for (int column = x0; column <= x1; ++column) {
      if (row_gap2 + column_gap2[column - x0] > radius2) continue;
      for (int i = first[column]; i >= 0 && count < kMaxReadings; i = readings_[i].next) {
        const float dx = readings_[i].u - x, dy = readings_[i].v - y;
        if (dx * dx + dy * dy <= radius2) around[count++] = {dx, dy, readings_[i].z};
      }
    }
  }
  if (count < kMinReadings) return std::nullopt;
  const auto [begin, end, nearest_m, farthest_m] =
      Foreground(around.data(), around.data() + count, options_.ideas.flying_pixels);
  if (begin == end) return std::nullopt;

  int quadrants = 0;
  float nearest2 = radius_px_ * radius_px_, sum = 0;
  for (const Neighbour* n = begin; n != end; ++n) {
    quadrants |= 1 << ((n->dx > 0) + 2 * (n->dy > 0));
    nearest2 = std::min(nearest2, n->dx * n->dx + n->dy * n->dy);
    sum += n->z;
  }
  const float one_of = 1.0F / static_cast<float>(end - begin), mean = sum * one_of;
  const bool surrounded = (quadrants & (quadrants - 1)) != 0 && quadrants != 0b0011 && quadrants != 0b1100 &&
                          quadrants != 0b0101 && quadrants != 0b1010;
  const bool silhouette = end < around.data() + count;
  // Not surrounded, the edge is a silhouette (readings of the background beyond) or beside a hole.
  if (options_.ideas.surrounded_depth && !surrounded && nearest2 > 0.25F * radius_px_ * radius_px_ + 0.5F)
    return std::nullopt;
  float squares = 0;
  for (const Neighbour* n = begin; n != end; ++n) squares += (n->z - mean) * (n->z - mean);
  const float z = InterpolateOnPlane(begin, end, radius_px_);
  const float slack = SurfaceGap(mean);
  if (!(z > nearest_m - slack && z < farthest_m + slack)) return std::nullopt;
  return EdgeDepth{z, std::sqrt(squares) * one_of + 1e-4F, silhouette};
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
