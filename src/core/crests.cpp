// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/crests.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simd.h"

#ifdef DEVO_AVX2
#include <immintrin.h>
#endif

namespace devo {
namespace {

constexpr int kMargin = 3;  // pixels at the border that have no crests
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

/// Which of the eight values from `p` on, in an image whose rows are `stride` long, reach `floor` and are no less than
/// both neighbours in one of the four directions: one bit each. Values below 32768.
inline int Peaks(const std::uint16_t* p, std::size_t stride, std::uint16_t floor) {
  const auto load = [](const std::uint16_t* q) { return cv::v_reinterpret_as_s16(cv::v_load(q)); };
  const std::uint16_t *up = p - stride, *down = p + stride;
  const cv::v_int16x8 v = load(p), too_low = cv::v_setall_s16(static_cast<std::int16_t>(floor)) > v;
  if (cv::v_check_all(too_low)) return 0;  // most of the image is empty
  const cv::v_int16x8 across = cv::v_max(load(p - 1), load(p + 1)), along = cv::v_max(load(up), load(down)),
                      falling = cv::v_max(load(up - 1), load(down + 1)),
                      rising = cv::v_max(load(up + 1), load(down - 1));
  const cv::v_int16x8 least = cv::v_min(cv::v_min(across, along), cv::v_min(falling, rising));
  return ~cv::v_signmask(too_low | (least > v)) & 0xFF;
}

/// The 3x3 values around each of four pixels, as one register per place.
struct Neighbourhoods {
  cv::v_float32x4 at[3][3];

  Neighbourhoods(const cv::Mat1w& image, int y, const std::array<int, 4>& x) {
    for (int row = 0; row < 3; ++row) {
      const std::uint16_t* p = image[y + row - 1] - 1;
      const cv::v_uint16x8 a = cv::v_load_low(p + x[0]), b = cv::v_load_low(p + x[1]), c = cv::v_load_low(p + x[2]),
                           d = cv::v_load_low(p + x[3]);
      cv::v_uint16x8 ac, bd, left_mid, right, unused;
      cv::v_zip(a, c, ac, unused);
      cv::v_zip(b, d, bd, unused);
      cv::v_zip(ac, bd, left_mid, right);
      cv::v_uint32x4 left_32, mid_32, right_32, unused_32;
      cv::v_expand(left_mid, left_32, mid_32);
      cv::v_expand(right, right_32, unused_32);
      at[row][0] = cv::v_cvt_f32(cv::v_reinterpret_as_s32(left_32));
      at[row][1] = cv::v_cvt_f32(cv::v_reinterpret_as_s32(mid_32));
      at[row][2] = cv::v_cvt_f32(cv::v_reinterpret_as_s32(right_32));
    }
  }
};

/// Ridge through each of four pixels, by the second derivatives (Steger's equations).
struct Ridges {
  std::array<float, 4> nx, ny, ox, oy;  // normal; offset of the ridge from the pixel
  int found;                            // one bit each

  explicit Ridges(const Neighbourhoods& n) {
    const auto all = [](float value) { return cv::v_setall_f32(value); };
    const auto &v = n.at[1][1], &left = n.at[1][0], &right = n.at[1][2], &up = n.at[0][1], &down = n.at[2][1];
    const auto gx = all(0.5F) * (right - left), gy = all(0.5F) * (down - up);
    const auto gxx = right - (v + v) + left, gyy = down - (v + v) + up;
    const auto gxy = all(0.25F) * (n.at[2][2] - n.at[2][0] - n.at[0][2] + n.at[0][0]);
    const auto mean = all(0.5F) * (gxx + gyy), half = all(0.5F) * (gxx - gyy);
    const auto root = cv::v_sqrt(half * half + gxy * gxy);
    const auto lambda = mean - root;  // the more negative eigenvalue: curvature across the ridge
    // Eigenvector of lambda, from the better conditioned of the two rows of H - lambda I.
    const auto first = half > all(0);
    auto x = cv::v_select(first, gxy, lambda - gyy), y = cv::v_select(first, lambda - gxx, gxy);
    const auto norm = cv::v_sqrt(x * x + y * y);
    const auto round = norm < all(1e-6F);  // a round peak has no direction; any will do
    x = cv::v_select(round, all(1), x / norm);
    y = cv::v_select(round, all(0), y / norm);
    const auto t = (all(0) - (gx * x + gy * y)) / lambda;
    const auto offset_x = t * x, offset_y = t * y;
    found = ~cv::v_signmask((lambda > all(-0.05F) * v) | (cv::v_abs(offset_x) > all(kMaxOffset_px)) |
                            (cv::v_abs(offset_y) > all(kMaxOffset_px))) &
            0xF;
    cv::v_store(nx.data(), x);
    cv::v_store(ny.data(), y);
    cv::v_store(ox.data(), offset_x);
    cv::v_store(oy.data(), offset_y);
  }
};

/// Nearest integer, halves away from zero, of a small number.
inline int Rounded(float value) {
  const int whole = static_cast<int>(value);
  const float rest = value - static_cast<float>(whole);
  return whole + (rest >= 0.5F) - (rest <= -0.5F);
}

/// Whether a crest rises above both its sides. In texture finer than the sensor resolves, ridges lie side by side
/// with no valley between them: something is always near, so they say nothing of the pose.
inline bool StandsOut(const cv::Mat1w& blurred, int x, int y, float nx, float ny, int v) {
  const int dx = Rounded(kSide_px * nx), dy = Rounded(kSide_px * ny);
  const int sides = std::max(blurred(y + dy, x + dx), blurred(y - dy, x - dx));
  return static_cast<float>(sides) < kMaxSideShare * static_cast<float>(v);
}

/// Mean polarity of the events around a crest of height `v`.
inline float Polarity(const cv::Mat1s& signed_events, int x, int y, int v) {
  int sum = 0;
  for (int dy = -1; dy <= 1; ++dy) {
    const std::int16_t* s = signed_events[y + dy] + x;
    sum += s[-1] + s[0] + s[1];
  }
  // Nine raw pixels hold about nine times the blurred value on a ridge; the ratio is clamped, not exact.
  return std::clamp(static_cast<float>(sum) / (6.0F * v), -1.0F, 1.0F);
}

/// Appends the crests among the peaks of row y and empties the list.
inline void AppendCrests(const cv::Mat1w& blurred, const cv::Mat1s& signed_events, int y, PixelList* peaks,
                         std::vector<EdgePoint>* crests) {
  for (int first = 0; first < peaks->size(); first += 4) {
    const int count = std::min(4, peaks->size() - first), last = peaks->size() - 1;
    const std::array<int, 4> x = {(*peaks)[first], (*peaks)[std::min(first + 1, last)],
                                  (*peaks)[std::min(first + 2, last)], (*peaks)[std::min(first + 3, last)]};
    const Ridges ridges(Neighbourhoods(blurred, y, x));
    for (int k = 0; k < count; ++k) {
      if (!(ridges.found >> k & 1)) continue;
      const int v = blurred(y, x[k]);
      if (!StandsOut(blurred, x[k], y, ridges.nx[k], ridges.ny[k], v)) continue;
      EdgePoint edge;
      edge.x = x[k] + ridges.ox[k];
      edge.y = y + ridges.oy[k];
      edge.nx = ridges.nx[k];
      edge.ny = ridges.ny[k];
      edge.strength = static_cast<float>(v) / kEventWeight;
      if (!signed_events.empty()) edge.polarity = Polarity(signed_events, x[k], y, v);
      crests->push_back(edge);
    }
  }
  peaks->Clear();
}

constexpr int kMaxFieldRadius = 30;
constexpr float kFieldScale = 16.0F;  // squared distances in 1/16 px^2: 16 * 2 * 30.5^2 stays below kNoEdge
constexpr int kFastRadius = 4;        // the usual one
constexpr int kFastWidth = 16;        // aligned columns that hold a square of that radius wherever it begins

/// The square of pixels around an edge in which it may be the nearest.
struct Square {
  int cx, x0, y0, y1;  // pixel of the edge; first column; first and last row

  Square(const EdgePoint& edge, int radius, const cv::Mat1i& image)
      : cx(static_cast<int>(edge.x + 0.5F)), x0(std::max(cx - radius, 0)) {
    const int cy = static_cast<int>(edge.y + 0.5F);
    y0 = std::max(cy - radius, 0);
    y1 = std::min(cy + radius, image.rows - 1);
  }
  /// Where to begin with kFastWidth columns, of which some are left or right of the square: at a multiple of eight, so
  /// that what was just written for another edge is read as it was written, not in parts.
  int AlignedX0(int columns) const { return std::min(x0 & ~7, columns - kFastWidth); }
};

std::int32_t PackedSquare(float d) { return static_cast<std::int32_t>(kFieldScale * d * d) << 16; }

/// Lets edge `k` claim the pixels of its square to which it is the nearest so far.
void MarkSquare(const EdgePoint& edge, int k, int radius, cv::Mat1i* nearest) {
  const Square square(edge, radius, *nearest);
  std::array<std::int32_t, 2 * kMaxFieldRadius + 1> dx2;
  const int columns = std::min(square.cx + radius, nearest->cols - 1) + 1 - square.x0;
  for (int i = 0; i < columns; ++i) dx2[i] = PackedSquare(static_cast<float>(square.x0 + i) - edge.x);
  for (int y = square.y0; y <= square.y1; ++y) {
    const std::int32_t dy2 = PackedSquare(static_cast<float>(y) - edge.y) + k;
    std::int32_t* row = (*nearest)[y] + square.x0;
    for (int i = 0; i < columns; ++i) row[i] = std::min(row[i], dx2[i] + dy2);
  }
}

/// The same for all edges, up to kFastRadius and in images at least kFastWidth wide.
void MarkSquaresFast(const EdgePoint* edges, int count, int radius, cv::Mat1i* nearest) {
  constexpr int kLanes = 4, kRegisters = kFastWidth / kLanes;
  const cv::v_int32x4 lanes(0, 1, 2, 3), none = cv::v_setall_s32(Surface::kNoEdge);
  for (int k = 0; k < count; ++k) {
    const Square square(edges[k], radius, *nearest);
    const int x0 = square.AlignedX0(nearest->cols);
    cv::v_int32x4 dx2[kRegisters];
    for (int r = 0; r < kRegisters; ++r) {
      const cv::v_int32x4 x = lanes + cv::v_setall_s32(x0 + r * kLanes), cx = cv::v_setall_s32(square.cx);
      const cv::v_float32x4 dx = cv::v_cvt_f32(x) - cv::v_setall_f32(edges[k].x);
      const cv::v_int32x4 in_square =
          (x + cv::v_setall_s32(radius) >= cx) & (x <= cx + cv::v_setall_s32(radius));
      const cv::v_int32x4 packed = cv::v_trunc(cv::v_setall_f32(kFieldScale) * dx * dx) << 16;
      dx2[r] = cv::v_select(in_square, packed, none);
    }
    for (int y = square.y0; y <= square.y1; ++y) {
      const cv::v_int32x4 dy2 = cv::v_setall_s32(PackedSquare(static_cast<float>(y) - edges[k].y) + k);
      std::int32_t* row = (*nearest)[y] + x0;
      for (int r = 0; r < kRegisters; ++r) {
        std::int32_t* p = row + r * kLanes;
        cv::v_store(p, cv::v_min(cv::v_load(p), dx2[r] + dy2));
      }
    }
  }
}

#ifdef DEVO_AVX2
/// The same, eight at once.
DEVO_AVX2 void MarkSquaresAvx2(const EdgePoint* edges, int count, int radius,
                                                     cv::Mat1i* nearest) {
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), none = _mm256_set1_epi32(Surface::kNoEdge);
  const __m256i radii = _mm256_set1_epi32(radius);
  const __m256 scale = _mm256_set1_ps(kFieldScale);
  const auto square_of = [&](__m256 d) DEVO_AVX2 {
    return _mm256_slli_epi32(_mm256_cvttps_epi32(_mm256_mul_ps(_mm256_mul_ps(scale, d), d)), 16);
  };
  for (int k = 0; k < count; ++k) {
    const Square square(edges[k], radius, *nearest);
    const int x0 = square.AlignedX0(nearest->cols);
    const auto columns = [&](int first) DEVO_AVX2 {
      const __m256i x = _mm256_add_epi32(lanes, _mm256_set1_epi32(first));
      const __m256 dx = _mm256_sub_ps(_mm256_cvtepi32_ps(x), _mm256_set1_ps(edges[k].x));
      const __m256i from_centre = _mm256_abs_epi32(_mm256_sub_epi32(x, _mm256_set1_epi32(square.cx)));
      return _mm256_blendv_epi8(square_of(dx), none, _mm256_cmpgt_epi32(from_centre, radii));
    };
    const __m256i left = columns(x0), right = columns(x0 + 8);
    std::int32_t* p = (*nearest)[square.y0] + x0;
    const std::size_t stride = nearest->step1();
    for (int y = square.y0; y <= square.y1; ++y, p += stride) {
      const __m256i dy2 = _mm256_set1_epi32(PackedSquare(static_cast<float>(y) - edges[k].y) + k);
      auto *l = reinterpret_cast<__m256i*>(p), *r = reinterpret_cast<__m256i*>(p + 8);
      _mm256_storeu_si256(l, _mm256_min_epi32(_mm256_loadu_si256(l), _mm256_add_epi32(left, dy2)));
      _mm256_storeu_si256(r, _mm256_min_epi32(_mm256_loadu_si256(r), _mm256_add_epi32(right, dy2)));
    }
  }
}
#endif

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
  const int right = blurred.cols - kMargin, bottom = blurred.rows - kMargin;
  const auto floor = static_cast<std::uint16_t>(std::max(threshold, kEventWeight / 8));
  for (int y = kMargin; y < bottom && crests->size() < Surface::kMaxEdges; ++y) {
    PixelList peaks;
    for (int x = kMargin; x < right; x += 8) {
      peaks.Append(x, Peaks(&blurred(y, x), blurred.step1(), floor) & (0xFF >> std::max(x + 8 - right, 0)));
      if (peaks.size() >= PixelList::kFull) AppendCrests(blurred, signed_events, y, &peaks, crests);
    }
    AppendCrests(blurred, signed_events, y, &peaks, crests);
  }
  if (crests->size() > Surface::kMaxEdges) crests->resize(Surface::kMaxEdges);
}

void BuildNearestEdgeField(const std::vector<EdgePoint>& edges, double radius_px, cv::Mat1i* nearest) {
  const int radius = std::min(static_cast<int>(std::lround(radius_px)), kMaxFieldRadius);
  nearest->setTo(Surface::kNoEdge);
  const int count = static_cast<int>(std::min(edges.size(), Surface::kMaxEdges));
  if (radius > kFastRadius || nearest->cols < kFastWidth) {
    for (int k = 0; k < count; ++k) MarkSquare(edges[k], k, radius, nearest);
    return;
  }
#ifdef DEVO_AVX2
  if (HasAvx2()) return MarkSquaresAvx2(edges.data(), count, radius, nearest);
#endif
  MarkSquaresFast(edges.data(), count, radius, nearest);
}

}  // namespace devo
