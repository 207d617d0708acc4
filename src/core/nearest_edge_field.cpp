// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/nearest_edge_field.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simd.h"

#ifdef DEVO_AVX2
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // GCC 12 of its own header
#include <immintrin.h>
#pragma GCC diagnostic pop
#endif

namespace devo {
namespace {

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

/// Empties the rows of a field just before they are marked, while they are in a near cache anyway.
class RowsToFill {
 public:
  explicit RowsToFill(cv::Mat1i* field) : field_(field) {}
  void Until(int last_row) {
    for (; next_ <= last_row; ++next_) {
      std::int32_t* row = (*field_)[next_];
      std::fill(row, row + field_->cols, Surface::kNoEdge);
    }
  }

 private:
  cv::Mat1i* field_;
  int next_ = 0;
};

/// Lets edge `k` claim the pixels of its square to which it is the nearest so far.
void MarkSquare(const EdgePoint& edge, int k, int radius, RowsToFill* rows, cv::Mat1i* nearest) {
  const Square square(edge, radius, *nearest);
  rows->Until(square.y1);
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
void MarkSquaresFast(const EdgePoint* edges, int count, int radius, RowsToFill* rows, cv::Mat1i* nearest) {
  constexpr int kLanes = 4, kRegisters = kFastWidth / kLanes;
  const cv::v_int32x4 lanes(0, 1, 2, 3), none = cv::v_setall_s32(Surface::kNoEdge);
  for (int k = 0; k < count; ++k) {
    const Square square(edges[k], radius, *nearest);
    rows->Until(square.y1);
    const int x0 = square.AlignedX0(nearest->cols);
    cv::v_int32x4 dx2[kRegisters];
    for (int r = 0; r < kRegisters; ++r) {
      const cv::v_int32x4 x = lanes + cv::v_setall_s32(x0 + r * kLanes), cx = cv::v_setall_s32(square.cx);
      const cv::v_float32x4 dx = cv::v_cvt_f32(x) - cv::v_setall_f32(edges[k].x);
      const cv::v_int32x4 in_square = (x + cv::v_setall_s32(radius) >= cx) & (x <= cx + cv::v_setall_s32(radius));
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
DEVO_AVX2 void MarkSquaresAvx2(const EdgePoint* edges, int count, int radius, RowsToFill* rows, cv::Mat1i* nearest) {
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), none = _mm256_set1_epi32(Surface::kNoEdge);
  const __m256i radii = _mm256_set1_epi32(radius);
  const __m256 scale = _mm256_set1_ps(kFieldScale);
  const auto packed_squares = [&](__m256i pixels, float edge) DEVO_AVX2 {
    const __m256 d = _mm256_sub_ps(_mm256_cvtepi32_ps(pixels), _mm256_set1_ps(edge));
    return _mm256_slli_epi32(_mm256_cvttps_epi32(_mm256_mul_ps(_mm256_mul_ps(scale, d), d)), 16);
  };
  const std::size_t stride = nearest->step1();
  for (int k = 0; k < count; ++k) {
    const Square square(edges[k], radius, *nearest);
    rows->Until(square.y1);
    const int x0 = square.AlignedX0(nearest->cols);
    const auto columns = [&](int first) DEVO_AVX2 {
      const __m256i x = _mm256_add_epi32(lanes, _mm256_set1_epi32(first));
      const __m256i from_centre = _mm256_abs_epi32(_mm256_sub_epi32(x, _mm256_set1_epi32(square.cx)));
      return _mm256_blendv_epi8(packed_squares(x, edges[k].x), none, _mm256_cmpgt_epi32(from_centre, radii));
    };
    const __m256i left = columns(x0), right = columns(x0 + 8);
    alignas(32) std::array<std::int32_t, 16> dy2;
    static_assert(dy2.size() > 2 * kFastRadius, "one for each row");
    for (int row = 0; row < 16; row += 8) {
      const __m256i y = _mm256_add_epi32(lanes, _mm256_set1_epi32(square.y0 + row));
      _mm256_store_si256(reinterpret_cast<__m256i*>(dy2.data() + row),
                         _mm256_add_epi32(packed_squares(y, edges[k].y), _mm256_set1_epi32(k)));
    }
    std::int32_t* p = (*nearest)[square.y0] + x0;
    for (int row = 0; row <= square.y1 - square.y0; ++row, p += stride) {
      const __m256i this_dy2 = _mm256_set1_epi32(dy2[row]);
      auto *l = reinterpret_cast<__m256i*>(p), *r = reinterpret_cast<__m256i*>(p + 8);
      _mm256_storeu_si256(l, _mm256_min_epi32(_mm256_loadu_si256(l), _mm256_add_epi32(left, this_dy2)));
      _mm256_storeu_si256(r, _mm256_min_epi32(_mm256_loadu_si256(r), _mm256_add_epi32(right, this_dy2)));
    }
  }
}

/// The same, a row of a square at once.
DEVO_AVX512 void MarkSquaresAvx512(const EdgePoint* edges, int count, int radius, RowsToFill* rows,
                                   cv::Mat1i* nearest) {
  const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  const __m512i none = _mm512_set1_epi32(Surface::kNoEdge), radii = _mm512_set1_epi32(radius);
  const __m512 scale = _mm512_set1_ps(kFieldScale);
  const auto packed_squares = [&](__m512i pixels, float edge) DEVO_AVX512 {
    const __m512 d = _mm512_sub_ps(_mm512_cvtepi32_ps(pixels), _mm512_set1_ps(edge));
    return _mm512_slli_epi32(_mm512_cvttps_epi32(_mm512_mul_ps(_mm512_mul_ps(scale, d), d)), 16);
  };
  const std::size_t stride = nearest->step1();
  for (int k = 0; k < count; ++k) {
    const Square square(edges[k], radius, *nearest);
    rows->Until(square.y1);
    const int x0 = square.AlignedX0(nearest->cols);
    const __m512i x = _mm512_add_epi32(lanes, _mm512_set1_epi32(x0));
    const __m512i from_centre = _mm512_abs_epi32(_mm512_sub_epi32(x, _mm512_set1_epi32(square.cx)));
    const __m512i dx2 =
        _mm512_mask_mov_epi32(packed_squares(x, edges[k].x), _mm512_cmpgt_epi32_mask(from_centre, radii), none);
    const __m512i y = _mm512_add_epi32(lanes, _mm512_set1_epi32(square.y0));
    alignas(64) std::array<std::int32_t, 16> dy2;
    _mm512_store_si512(dy2.data(), _mm512_add_epi32(packed_squares(y, edges[k].y), _mm512_set1_epi32(k)));
    std::int32_t* p = (*nearest)[square.y0] + x0;
    for (int row = 0; row <= square.y1 - square.y0; ++row, p += stride) {
      const __m512i here = _mm512_add_epi32(dx2, _mm512_set1_epi32(dy2[row]));
      _mm512_storeu_si512(p, _mm512_min_epi32(_mm512_loadu_si512(p), here));
    }
  }
}
#endif

}  // namespace

void BuildNearestEdgeField(const std::vector<EdgePoint>& edges, double radius_px, cv::Mat1i* nearest) {
  const int radius = std::min(static_cast<int>(std::lround(radius_px)), kMaxFieldRadius);
  const int count = static_cast<int>(std::min(edges.size(), Surface::kMaxEdges));
  RowsToFill rows(nearest);
  if (radius > kFastRadius || nearest->cols < kFastWidth) {
    for (int k = 0; k < count; ++k) MarkSquare(edges[k], k, radius, &rows, nearest);
#ifdef DEVO_AVX2
  } else if (HasAvx512()) {
    MarkSquaresAvx512(edges.data(), count, radius, &rows, nearest);
  } else if (HasAvx2()) {
    MarkSquaresAvx2(edges.data(), count, radius, &rows, nearest);
#endif
  } else {
    MarkSquaresFast(edges.data(), count, radius, &rows, nearest);
  }
  rows.Until(nearest->rows - 1);
}

}  // namespace devo
