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
// A depth image four times as fine as the event image has about 110 within the least radius; with fewer the upper rows
// of an edge's surroundings would speak for all of them.
constexpr std::size_t kMaxReadings = 256;
// Pixels of the event image per pixel of a depth image of which so many lie within the least radius. Of a finer one
// not every row and column is listed.
constexpr double kFinest = 0.17;
constexpr double kMinRadius_px = 1.5, kMaxRadius_px = DepthRegistration::kUsualReach;
// An image that holds few readings, far apart (a LiDAR's, projected), is looked at farther around an edge: so that this
// many are expected there.
constexpr double kExpectedReadings = 6;
constexpr int kMaxReach = 8;          // px, for which room is kept
constexpr int kDensityRowsApart = 4;  // of the rows that its density is told by

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

/// Whether readings in these quadrants (a bit each: 1 left above, 2 right above, 4 left below, 8 right below) lie on
/// opposite sides: more than one quadrant, and not two beside each other.
bool LieAround(int quadrants) {
  return (quadrants & (quadrants - 1)) != 0 && quadrants != 0b0011 && quadrants != 0b1100 && quadrants != 0b0101 &&
         quadrants != 0b1010;
}

/// A row of a depth image and the rays of its pixels.
struct DepthRow {
  const float *z, *ray_x, *ray_y;
  int columns;
};

/// Where its readings fall: u and v half a pixel ahead, so that truncation rounds; index of the pixel in the event
/// image and of its cell, -1 outside.
struct WarpedRow {
  float *z, *u, *v;
  int *pixel, *cell;
};

/// From the depth camera to the event image.
struct ReadingWarp {
  Eigen::Matrix3f R;
  Eigen::Vector3f t;
  float min_m, max_m, fx, fy, cx, cy;
  int width, height, cells_per_row;
};

DEVO_ALWAYS_INLINE float IsTrue(bool condition) { return condition ? 1.0F : 0.0F; }

/// Of a place in an image of less than 2^24 pixels, which a float counts exactly: unlike whole numbers, floats are
/// multiplied many at once by any processor.
DEVO_ALWAYS_INLINE int Index(int row, int column, float width) {
  return static_cast<int>(static_cast<float>(row) * width + static_cast<float>(column));
}

/// Returns the number of valid readings. A loop without branches, so that the compiler takes as many at once as
/// registers hold.
DEVO_ALWAYS_INLINE int WarpReadings(const ReadingWarp& by, const DepthRow& in, const WarpedRow& out) {
  const float r00 = by.R(0, 0), r01 = by.R(0, 1), r02 = by.R(0, 2), r10 = by.R(1, 0), r11 = by.R(1, 1),
              r12 = by.R(1, 2), r20 = by.R(2, 0), r21 = by.R(2, 1), r22 = by.R(2, 2);
  const float tx = by.t.x(), ty = by.t.y(), tz = by.t.z(), cx = by.cx + 0.5F, cy = by.cy + 0.5F;
  const auto width = static_cast<float>(by.width), height = static_cast<float>(by.height);
  const float min_m = by.min_m, max_m = by.max_m, fx = by.fx, fy = by.fy;
  const auto cells_per_row = static_cast<float>(by.cells_per_row);
  const int readings = in.columns;
  const float* __restrict read = in.z, * __restrict ray_x = in.ray_x, * __restrict ray_y = in.ray_y;
  float* __restrict out_z = out.z, * __restrict out_u = out.u, * __restrict out_v = out.v;
  int* __restrict out_pixel = out.pixel, * __restrict out_cell = out.cell;
  int valid = 0;
#pragma GCC ivdep
  for (int x = 0; x < readings; ++x) {
    const float z = ValidDepthOrZero(read[x], min_m, max_m), a = ray_x[x], b = ray_y[x];
    const float Z = z * (r20 * a + r21 * b + r22) + tz;
    const float X = z * (r00 * a + r01 * b + r02) + tx;
    const float Y = z * (r10 * a + r11 * b + r12) + ty;
    // Conditions as numbers, which are multiplied in place of branches. The second also drops pixels without a ray
    // (NaN).
    const float good = IsTrue(z > 0) * IsTrue(Z > 0.01F);
    const float inverse_depth = 1 / Z;
    const float u = fx * X * inverse_depth + cx, v = fy * Y * inverse_depth + cy;
    const float inside = good * IsTrue(u >= 0) * IsTrue(v >= 0) * IsTrue(u < width) * IsTrue(v < height);
    // Before the conversion: of values beyond an int, or that are none, it is undefined.
    const int column = static_cast<int>(std::min(std::max(0.0F, u), width));
    const int row = static_cast<int>(std::min(std::max(0.0F, v), height));
    const int outside = static_cast<int>(inside) - 1;  // all bits or none
    valid += static_cast<int>(good);
    out_z[x] = Z;
    out_u[x] = u;
    out_v[x] = v;
    out_pixel[x] = Index(row, column, width) | outside;
    out_cell[x] = Index(row >> kCellBits, column >> kCellBits, cells_per_row) | outside;
  }
  return valid;
}

#ifdef DEVO_AVX2
DEVO_AVX2 int WarpReadingsAvx2(const ReadingWarp& by, const DepthRow& in, const WarpedRow& out) {
  return WarpReadings(by, in, out);
}
#endif

int WarpRow(const ReadingWarp& by, const DepthRow& in, const WarpedRow& out) {
#ifdef DEVO_AVX2
  if (HasAvx2()) return WarpReadingsAvx2(by, in, out);
#endif
  return WarpReadings(by, in, out);
}

ReadingWarp WarpTo(const Camera& event_camera, int cells_per_row, const Rigid3& T_event_depth,
                   const MappingOptions& options) {
  return {T_event_depth.rotation().toRotationMatrix().cast<float>(),
          T_event_depth.translation().cast<float>(),
          static_cast<float>(options.min_depth_m),
          static_cast<float>(options.max_depth_m),
          static_cast<float>(event_camera.fx()),
          static_cast<float>(event_camera.fy()),
          static_cast<float>(event_camera.cx()),
          static_cast<float>(event_camera.cy()),
          event_camera.width(),
          event_camera.height(),
          cells_per_row};
}

/// Share of the readings' neighbours, to the right and below, that are readings: of an image with large holes about
/// one, of lines a half, of single readings far apart about their density. One where there is none.
double DensityOf(const cv::Mat1f& depth_m, const MappingOptions& options) {
  const auto is_reading = [min_m = static_cast<float>(options.min_depth_m),
                           max_m = static_cast<float>(options.max_depth_m)](float z_m) {
    return ValidDepthOrZero(z_m, min_m, max_m) > 0;
  };
  int readings = 0, neighbours = 0;
  for (int y = 0; y + 1 < depth_m.rows; y += kDensityRowsApart) {
    const float *row = depth_m[y], *next = depth_m[y + 1];
    for (int x = 0; x + 1 < depth_m.cols; ++x) {
      const int reading = is_reading(row[x]);
      readings += reading;
      neighbours += reading * (is_reading(row[x + 1]) + is_reading(next[x]));
    }
  }
  return readings == 0 ? 1 : 0.5 * neighbours / readings;
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
      focal_ratio_(event_camera.fx() / depth_camera.fx()),
      list_every_(std::max(1, static_cast<int>(std::ceil(kFinest / focal_ratio_)))),
      wanted_(event_camera.height(), event_camera.width()), first_(event_camera.height(), event_camera.width()),
      readings_(static_cast<std::size_t>(depth_camera.width()) * depth_camera.height()),
      cell_depth_((event_camera.height() + kCell - 1) / kCell, (event_camera.width() + kCell - 1) / kCell),
      row_z_(depth_camera.width()), row_u_(depth_camera.width()), row_v_(depth_camera.width()),
      row_pixel_(depth_camera.width()), row_cell_(depth_camera.width()) {
  cv::split(RayTable(depth_camera), depth_rays_);
}

void DepthRegistration::MarkNeighbourhoods(const std::vector<EdgePoint>& edges) {
  wanted_.setTo(0);
  const int reach = static_cast<int>(std::ceil(radius_px_));
  const auto fill = reach == 2 ? FillSquare<5> : reach == 3 ? FillSquare<7> : reach == 4 ? FillSquare<9> : nullptr;
  for (const EdgePoint& edge : edges) {
    const int x = static_cast<int>(edge.x + 0.5F), y = static_cast<int>(edge.y + 0.5F);
    const int x0 = std::max(x - reach, 0), x1 = std::min(x + reach, wanted_.cols - 1);
    const int y0 = std::max(y - reach, 0), y1 = std::min(y + reach, wanted_.rows - 1);
    if (fill && x1 - x0 == 2 * reach && y1 - y0 == 2 * reach) {
      fill(wanted_[y0] + x0, wanted_.step);
    } else {
      for (int row = y0; row <= y1; ++row) std::fill(wanted_[row] + x0, wanted_[row] + x1 + 1, 255);
    }
  }
}

float DepthRegistration::RadiusFor(const cv::Mat1f& depth_m) const {
  const double usual_px = std::clamp(2 * focal_ratio_, kMinRadius_px, kMaxRadius_px);
  const double sparse_px =
      focal_ratio_ * std::sqrt(kExpectedReadings / (M_PI * std::max(DensityOf(depth_m, options_), 1e-3)));
  return static_cast<float>(std::min(std::max(usual_px, sparse_px), double{kMaxReach}));
}

int DepthRegistration::Warp(const DepthImage& depth, const Rigid3& T_event_depth, const std::vector<EdgePoint>& edges) {
  const cv::Size size = depth_rays_[0].size();
  if (depth.depth_m.size() != size) {
    std::ostringstream message;
    message << "depth image of " << depth.depth_m.cols << "x" << depth.depth_m.rows << " pixels; expected "
            << size.width << "x" << size.height << " as in the depth camera's calibration";
    throw std::invalid_argument(message.str());
  }
  radius_px_ = RadiusFor(depth.depth_m);
  MarkNeighbourhoods(edges);
  first_.setTo(-1);
  cell_depth_.setTo(0);
  const ReadingWarp by = WarpTo(event_camera_, cell_depth_.cols, T_event_depth, options_);
  int valid = 0, count = 0, *first = first_.ptr<int>();
  const std::uint8_t* wanted = wanted_.ptr<std::uint8_t>();
  float* cells = cell_depth_.ptr<float>();
  for (int y = 0; y < size.height; ++y) {
    valid += WarpRow(by, {depth.depth_m[y], depth_rays_[0].ptr<float>(y), depth_rays_[1].ptr<float>(y), size.width},
                     {row_z_.data(), row_u_.data(), row_v_.data(), row_pixel_.data(), row_cell_.data()});
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
      if (!wanted[pixel] || y % list_every_ != 0 || x % list_every_ != 0) continue;
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

template <typename Visit>
void DepthRegistration::ForReadingsAround(float x, float y, const Visit& visit) const {
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
      for (int i = first[column]; i >= 0; i = readings_[i].next) {
        const float dx = readings_[i].u - x, dy = readings_[i].v - y;
        if (dx * dx + dy * dy <= radius2 && !visit(dx, dy, readings_[i].z)) return;
      }
    }
  }
}

std::optional<DepthRegistration::EdgeDepth> DepthRegistration::DepthAt(float x, float y) const {
  std::array<Neighbour, kMaxReadings> around;
  std::size_t count = 0;
  ForReadingsAround(x, y, [&around, &count](float dx, float dy, float z) {
    around[count++] = {dx, dy, z};
    return count < kMaxReadings;
  });
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
  const bool silhouette = end < around.data() + count;
  // Not surrounded, the edge is a silhouette (readings of the background beyond) or beside a hole.
  if (options_.ideas.surrounded_depth && !LieAround(quadrants) && nearest2 > 0.25F * radius_px_ * radius_px_ + 0.5F)
    return std::nullopt;
  float squares = 0;
  for (const Neighbour* n = begin; n != end; ++n) squares += (n->z - mean) * (n->z - mean);
  const float z = InterpolateOnPlane(begin, end, radius_px_);
  const float slack = SurfaceGap(mean);
  if (!(z > nearest_m - slack && z < farthest_m + slack)) return std::nullopt;
  return EdgeDepth{z, std::sqrt(squares) * one_of + 1e-4F, silhouette};
}

}  // namespace devo
