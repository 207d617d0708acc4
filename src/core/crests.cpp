// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/crests.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <opencv2/core/hal/intrin.hpp>

namespace devo {
namespace {

constexpr float kMaxOffset_px = 0.6F;
constexpr float kSide_px = 2.5F;
constexpr float kMaxSideShare = 0.6F;

/// Integer 5-tap kernel (c, b, a, b, c) that sums to 16: its variance is (2 b + 8 c) / 16.
std::array<int, 3> KernelFor(double sigma_px) {
  std::array<int, 3> best = {16, 0, 0};
  double best_error = 1e9;
  for (int b = 0; b <= 5; ++b) {
    for (int c = 0; c <= std::min(b, 2); ++c) {
      const int a = 16 - 2 * (b + c);
      const double error = std::abs((2.0 * b + 8.0 * c) / 16.0 - sigma_px * sigma_px);
      if (a >= b && error < best_error) {
        best_error = error;
        best = {a, b, c};
      }
    }
  }
  return best;
}

/// Whether a crest rises above both its sides. In texture finer than the sensor resolves, ridges lie side by side
/// with no valley between them: something is always near, so they say nothing of the pose.
inline bool StandsOut(const cv::Mat1w& blurred, int x, int y, float nx, float ny, int v) {
  const int dx = static_cast<int>(std::lround(kSide_px * nx)), dy = static_cast<int>(std::lround(kSide_px * ny));
  const int sides = std::max(blurred(y + dy, x + dx), blurred(y - dy, x - dx));
  return static_cast<float>(sides) < kMaxSideShare * static_cast<float>(v);
}

/// Whether eight values in a row are all below `floor`.
inline bool NoneAbove(const std::uint16_t* p, std::uint16_t floor) {
  std::uint16_t above = 0;
  for (int i = 0; i < 8; ++i) above |= static_cast<std::uint16_t>(p[i] >= floor);
  return above == 0;
}

constexpr int kMaxFieldRadius = 30;
constexpr int kFastWidth = 12;  // three SSE registers: holds the nine columns of the usual radius

/// Lets edge `k` claim the pixels of a square of columns [x0, x0 + width) to which it is the nearest so far. With a
/// fixed width, which may exceed the square, the compiler unrolls and vectorises the inner loop.
template <int kWidth>
inline void MarkSquare(const EdgePoint& edge, int k, int cy, int radius, int x0, int width, cv::Mat1i* nearest) {
  constexpr float kScale = 16.0F;  // squared distances in 1/16 px^2: 16 * 2 * 30.5^2 stays below kNoEdge
  std::array<std::int32_t, kWidth ? kWidth : 2 * kMaxFieldRadius + 1> packed_dx2;
  const int columns = kWidth ? kWidth : width;
  for (int i = 0; i < columns; ++i) {
    const float dx = static_cast<float>(x0 + i) - edge.x;
    packed_dx2[i] = static_cast<std::int32_t>(kScale * dx * dx) << 16;
  }
  if (kWidth) std::fill(packed_dx2.begin() + 2 * radius + 1, packed_dx2.end(), Surface::kNoEdge);
  for (int y = std::max(cy - radius, 0); y <= std::min(cy + radius, nearest->rows - 1); ++y) {
    const float dy = static_cast<float>(y) - edge.y;
    const std::int32_t packed_dy2 = (static_cast<std::int32_t>(kScale * dy * dy) << 16) + k;
    std::int32_t* row = (*nearest)[y] + x0;
    if constexpr (kWidth > 0) {
      // Universal intrinsics: left to itself, GCC unrolls this into scalar code.
      const cv::v_int32x4 dy2 = cv::v_setall_s32(packed_dy2);
      for (int i = 0; i < kWidth; i += 4) {
        cv::v_store(row + i, cv::v_min(cv::v_load(row + i), cv::v_load(packed_dx2.data() + i) + dy2));
      }
    } else {
      for (int i = 0; i < columns; ++i) row[i] = std::min(row[i], packed_dx2[i] + packed_dy2);
    }
  }
}

}  // namespace

void Blur(const cv::Mat1w& in, double sigma_px, cv::Mat1w* scratch, cv::Mat1w* out) {
  const auto [a, b, c] = KernelFor(sigma_px);
  const std::uint16_t ka = a, kb = b, kc = c;
  scratch->create(in.size());
  out->create(in.size());
  const int w = in.cols, h = in.rows;
  // 16-bit arithmetic vectorises eight wide on any x86-64: values stay below 4096, so sums below 65536.
  for (int y = 0; y < h; ++y) {
    const std::uint16_t* p = in[y];
    std::uint16_t* q = (*scratch)[y];
    q[0] = q[1] = q[w - 2] = q[w - 1] = 0;
    for (int x = 2; x < w - 2; ++x) {
      const std::uint16_t inner = p[x - 1] + p[x + 1], outer = p[x - 2] + p[x + 2];
      q[x] = static_cast<std::uint16_t>(ka * p[x] + kb * inner + kc * outer) >> 4;
    }
  }
  for (int y = 0; y < h; ++y) {
    std::uint16_t* q = (*out)[y];
    if (y < 2 || y >= h - 2) {
      std::fill(q, q + w, 0);
      continue;
    }
    const std::uint16_t *p0 = (*scratch)[y - 2], *p1 = (*scratch)[y - 1], *p2 = (*scratch)[y], *p3 = (*scratch)[y + 1],
                        *p4 = (*scratch)[y + 2];
    for (int x = 0; x < w; ++x) {
      const std::uint16_t inner = p1[x] + p3[x], outer = p0[x] + p4[x];
      q[x] = static_cast<std::uint16_t>(ka * p2[x] + kb * inner + kc * outer) >> 4;
    }
  }
}

int OccupiedQuantile(const cv::Mat1w& image, double quantile) {
  constexpr int kBins = 512, kShift = 3;
  std::array<int, kBins> histogram{};
  for (int y = 2; y < image.rows; y += 4) {
    const std::uint16_t* p = image[y];
    for (int x = 0; x < image.cols; ++x) ++histogram[std::min<int>(p[x] >> kShift, kBins - 1)];
  }
  int occupied = 0;
  for (int bin = 1; bin < kBins; ++bin) occupied += histogram[bin];
  int below = 0;
  for (int bin = 1; bin < kBins; ++bin) {
    below += histogram[bin];
    if (below >= quantile * occupied) return bin << kShift;
  }
  return (kBins - 1) << kShift;
}

void FindCrests(const cv::Mat1w& blurred, const cv::Mat1s& signed_events, int threshold,
                std::vector<EdgePoint>* crests) {
  crests->clear();
  const int w = blurred.cols, h = blurred.rows;
  const auto floor = static_cast<std::uint16_t>(std::max(threshold, kEventWeight / 8));
  for (int y = 3; y < h - 3; ++y) {
    const std::uint16_t *up = blurred[y - 1], *mid = blurred[y], *down = blurred[y + 1];
    for (int x = 3; x < w - 3; ++x) {
      // Most of the image is empty: step over eight pixels at a time.
      while (x + 8 <= w - 3 && NoneAbove(mid + x, floor)) x += 8;
      if (x >= w - 3) break;
      const int v = mid[x];
      if (v < floor) continue;
      const bool peak = (v >= mid[x - 1] && v >= mid[x + 1]) || (v >= up[x] && v >= down[x]) ||
                        (v >= up[x - 1] && v >= down[x + 1]) || (v >= up[x + 1] && v >= down[x - 1]);
      if (!peak) continue;
      const float gx = 0.5F * (mid[x + 1] - mid[x - 1]), gy = 0.5F * (down[x] - up[x]);
      const float gxx = mid[x + 1] - 2 * v + mid[x - 1], gyy = down[x] - 2 * v + up[x];
      const float gxy = 0.25F * (down[x + 1] - down[x - 1] - up[x + 1] + up[x - 1]);
      const float mean = 0.5F * (gxx + gyy), half = 0.5F * (gxx - gyy);
      const float root = std::sqrt(half * half + gxy * gxy);
      const float lambda = mean - root;  // the more negative eigenvalue: curvature across the ridge
      if (lambda > -0.05F * v) continue;
      // Eigenvector of lambda, from the better conditioned of the two rows of H - lambda I.
      float nx = half > 0 ? gxy : lambda - gyy, ny = half > 0 ? lambda - gxx : gxy;
      const float norm = std::sqrt(nx * nx + ny * ny);
      if (norm < 1e-6F) {
        nx = 1;  // a round peak has no direction; any will do
        ny = 0;
      } else {
        nx /= norm;
        ny /= norm;
      }
      const float t = -(gx * nx + gy * ny) / lambda;
      const float ox = t * nx, oy = t * ny;
      if (std::abs(ox) > kMaxOffset_px || std::abs(oy) > kMaxOffset_px) continue;
      if (!StandsOut(blurred, x, y, nx, ny, v)) continue;
      EdgePoint edge;
      edge.x = x + ox;
      edge.y = y + oy;
      edge.nx = nx;
      edge.ny = ny;
      edge.strength = static_cast<float>(v) / kEventWeight;
      if (!signed_events.empty()) {
        int sum = 0;
        for (int dy = -1; dy <= 1; ++dy) {
          const std::int16_t* s = signed_events[y + dy] + x;
          sum += s[-1] + s[0] + s[1];
        }
        // Nine raw pixels hold about nine times the blurred value on a ridge; the ratio is clamped, not exact.
        edge.polarity = std::clamp(static_cast<float>(sum) / (6.0F * v), -1.0F, 1.0F);
      }
      crests->push_back(edge);
      if (crests->size() == Surface::kMaxEdges) return;
    }
  }
}

void BuildNearestEdgeField(const std::vector<EdgePoint>& edges, double radius_px, cv::Mat1i* nearest) {
  const int radius = std::min(static_cast<int>(std::lround(radius_px)), kMaxFieldRadius);
  nearest->setTo(Surface::kNoEdge);
  const int count = static_cast<int>(std::min(edges.size(), Surface::kMaxEdges));
  for (int k = 0; k < count; ++k) {
    const int cx = static_cast<int>(edges[k].x + 0.5F), cy = static_cast<int>(edges[k].y + 0.5F);
    const bool inside = cx >= radius && cx - radius + kFastWidth <= nearest->cols;
    if (inside && 2 * radius < kFastWidth) {
      MarkSquare<kFastWidth>(edges[k], k, cy, radius, cx - radius, kFastWidth, nearest);
    } else {
      const int x0 = std::max(cx - radius, 0);
      MarkSquare<0>(edges[k], k, cy, radius, x0, std::min(cx + radius, nearest->cols - 1) + 1 - x0, nearest);
    }
  }
}

}  // namespace devo
