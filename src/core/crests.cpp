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

constexpr int kScratchRows = 8;
constexpr int kMargin = 3;  // pixels at the border that have no crests
constexpr float kMaxOffset_px = 0.6F;
constexpr float kSide_px = 2.5F;
constexpr float kMaxSideShare = 0.6F;
constexpr float kAnySide = 1e9F;  // no side is higher

/// Sums of five places, weighted by the kernel. 16-bit arithmetic, as many at once as registers hold: values stay below
/// 4096, so sums below 65536.
DEVO_ALWAYS_INLINE void WeightFive(const std::array<const std::uint16_t*, 5>& p, const std::array<int, 3>& kernel,
                                   int count, std::uint16_t* q) {
  const auto [a, b, c] = kernel;
  const std::uint16_t ka = a, kb = b, kc = c;
  for (int x = 0; x < count; ++x) {
    const std::uint16_t inner = p[1][x] + p[3][x], outer = p[0][x] + p[4][x];
    q[x] = static_cast<std::uint16_t>(ka * p[2][x] + kb * inner + kc * outer) >> 4;
  }
}

DEVO_ALWAYS_INLINE void BlurRows(const cv::Mat1w& in, const std::array<int, 3>& kernel, cv::Mat1w* scratch,
                                 cv::Mat1w* out) {
  const int w = in.cols, h = in.rows;
  // Blurred along themselves, the last few rows stay in the first cache until they are blurred across.
  const auto along = [scratch](int y) { return (*scratch)[y % kScratchRows]; };
  for (int y = 0; y < h; ++y) {
    const std::uint16_t* p = in[y];
    std::uint16_t* q = along(y);
    q[0] = q[1] = q[w - 2] = q[w - 1] = 0;
    WeightFive({p, p + 1, p + 2, p + 3, p + 4}, kernel, w - 4, q + 2);
    if (y < 4) continue;
    WeightFive({along(y - 4), along(y - 3), along(y - 2), along(y - 1), q}, kernel, w, (*out)[y - 2]);
  }
  for (const int y : {0, 1, h - 2, h - 1}) std::fill((*out)[y], (*out)[y] + w, std::uint16_t{0});
}

void BlurPortable(const cv::Mat1w& in, const std::array<int, 3>& kernel, cv::Mat1w* scratch, cv::Mat1w* out) {
  BlurRows(in, kernel, scratch, out);
}
#ifdef DEVO_AVX2
DEVO_AVX2 void BlurAvx2(const cv::Mat1w& in, const std::array<int, 3>& kernel, cv::Mat1w* scratch, cv::Mat1w* out) {
  BlurRows(in, kernel, scratch, out);
}
#endif

/// Which of the sixteen values from `p` on, in an image whose rows are `stride` long, reach `floor` and are no less
/// than both neighbours in one of the four directions: one bit each. Values below 32768.
struct Peaks {
  DEVO_ALWAYS_INLINE static int Of(const std::uint16_t* p, std::size_t stride, std::uint16_t floor) {
    return OfEight(p, stride, floor) | OfEight(p + 8, stride, floor) << 8;
  }

  DEVO_ALWAYS_INLINE static int OfEight(const std::uint16_t* p, std::size_t stride, std::uint16_t floor) {
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
};

#ifdef DEVO_AVX2
/// The same, all at once.
struct PeaksAvx2 {
  DEVO_AVX2 static inline int Of(const std::uint16_t* p, std::size_t stride, std::uint16_t floor) {
    const std::uint16_t *up = p - stride, *down = p + stride;
    const __m256i v = Load(p), too_low = _mm256_cmpgt_epi16(_mm256_set1_epi16(static_cast<std::int16_t>(floor)), v);
    if (_mm256_movemask_epi8(too_low) == -1) return 0;
    const __m256i across = _mm256_max_epi16(Load(p - 1), Load(p + 1)), along = _mm256_max_epi16(Load(up), Load(down)),
                  falling = _mm256_max_epi16(Load(up - 1), Load(down + 1)),
                  rising = _mm256_max_epi16(Load(up + 1), Load(down - 1));
    const __m256i least = _mm256_min_epi16(_mm256_min_epi16(across, along), _mm256_min_epi16(falling, rising));
    const __m256i none = _mm256_or_si256(too_low, _mm256_cmpgt_epi16(least, v));
    const __m128i bytes = _mm_packs_epi16(_mm256_castsi256_si128(none), _mm256_extracti128_si256(none, 1));
    return ~_mm_movemask_epi8(bytes) & 0xFFFF;
  }

  DEVO_AVX2 static inline __m256i Load(const std::uint16_t* p) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
  }
};
#endif

/// The values left of, at and right of each of the eight pixels from `columns` on of one row. Values below 32768.
DEVO_ALWAYS_INLINE void LoadThree(const std::uint16_t* row, const std::uint16_t* columns, cv::v_int16x8 three[3]) {
  const std::uint16_t* p = row - 1;
  cv::v_uint16x8 left_mid[2], right[2], unused;
  for (int half = 0; half < 2; ++half, columns += 4) {
    cv::v_uint16x8 ac, bd;
    cv::v_zip(cv::v_load_low(p + columns[0]), cv::v_load_low(p + columns[2]), ac, unused);
    cv::v_zip(cv::v_load_low(p + columns[1]), cv::v_load_low(p + columns[3]), bd, unused);
    cv::v_zip(ac, bd, left_mid[half], right[half]);
  }
  three[0] = cv::v_reinterpret_as_s16(cv::v_combine_low(left_mid[0], left_mid[1]));
  three[1] = cv::v_reinterpret_as_s16(cv::v_combine_high(left_mid[0], left_mid[1]));
  three[2] = cv::v_reinterpret_as_s16(cv::v_combine_low(right[0], right[1]));
}

/// One number for each pixel of a list.
template <typename T>
struct alignas(32) PerPeak : std::array<T, PixelList::kMost> {};

/// Heights of an image at chosen pixels and their derivatives by central differences, without the fractions, so that
/// they fit 16 bits: values are below 4096.
struct Derivatives {
  PerPeak<std::int16_t> v, twice_gx, twice_gy, gxx, gyy, four_gxy;

  DEVO_ALWAYS_INLINE void Load(const cv::Mat1w& blurred, int y, const PixelList& peaks) {
    for (int i = 0; i < peaks.size(); i += 8) {
      cv::v_int16x8 up[3], mid[3], down[3];
      LoadThree(blurred[y - 1], peaks.data() + i, up);
      LoadThree(blurred[y], peaks.data() + i, mid);
      LoadThree(blurred[y + 1], peaks.data() + i, down);
      cv::v_store(v.data() + i, mid[1]);
      cv::v_store(twice_gx.data() + i, mid[2] - mid[0]);
      cv::v_store(twice_gy.data() + i, down[1] - up[1]);
      cv::v_store(gxx.data() + i, mid[2] - (mid[1] + mid[1]) + mid[0]);
      cv::v_store(gyy.data() + i, down[1] - (mid[1] + mid[1]) + up[1]);
      cv::v_store(four_gxy.data() + i, down[2] - down[0] - up[2] + up[0]);
    }
  }
};

/// Nearest integer, halves away from zero, of a small number.
DEVO_ALWAYS_INLINE int Rounded(float value) {
  const int whole = static_cast<int>(value);
  const float rest = value - static_cast<float>(whole);
  return whole + (rest >= 0.5F ? 1 : 0) - (rest <= -0.5F ? 1 : 0);
}

/// Ridges through chosen pixels, by the second derivatives (Steger's equations).
struct Ridges {
  PerPeak<float> nx, ny, ox, oy;  // normal; offset of the ridge from the pixel
  PerPeak<int> side;              // how much farther in memory a pixel beside the ridge is
  PerPeak<int> missing;           // 1 where there is none

  /// A loop without branches, so that the compiler takes as many at once as registers hold.
  DEVO_ALWAYS_INLINE void Find(const Derivatives& of, int count, int stride) {
    for (int i = 0; i < count; ++i) {
      const auto v = static_cast<float>(of.v[i]);
      const float gx = 0.5F * static_cast<float>(of.twice_gx[i]), gy = 0.5F * static_cast<float>(of.twice_gy[i]);
      const auto gxx = static_cast<float>(of.gxx[i]), gyy = static_cast<float>(of.gyy[i]);
      const float gxy = 0.25F * static_cast<float>(of.four_gxy[i]);
      const float mean = 0.5F * (gxx + gyy), half = 0.5F * (gxx - gyy);
      const float lambda = mean - std::sqrt(half * half + gxy * gxy);  // across: the more negative eigenvalue
      // Eigenvector of lambda, from the better conditioned of the two rows of H - lambda I.
      const bool first = half > 0;
      const float x = first ? gxy : lambda - gyy, y = first ? lambda - gxx : gxy;
      const float norm = std::sqrt(x * x + y * y);
      const bool round = norm < 1e-6F;  // a round peak has no direction; any will do
      const float unit_x = x / norm, unit_y = y / norm;
      nx[i] = round ? 1.0F : unit_x;
      ny[i] = round ? 0.0F : unit_y;
      const float t = (0.0F - (gx * nx[i] + gy * ny[i])) / lambda;
      ox[i] = t * nx[i];
      oy[i] = t * ny[i];
      side[i] = Rounded(kSide_px * ny[i]) * stride + Rounded(kSide_px * nx[i]);
      missing[i] = (lambda > -0.05F * v ? 1 : 0) | (std::abs(ox[i]) > kMaxOffset_px ? 1 : 0) |
                   (std::abs(oy[i]) > kMaxOffset_px ? 1 : 0);
    }
  }
};

/// Which of the pixels lie on a ridge that stands out from the higher of its two sides; returns how many. In texture
/// finer than the sensor resolves, ridges lie side by side with no valley between them: something is always near, so
/// they say nothing of the pose.
DEVO_ALWAYS_INLINE int ChooseCrests(const std::uint16_t* row, const PixelList& peaks, const Derivatives& of,
                                    const Ridges& ridges, float max_side_share, PerPeak<std::uint16_t>* chosen) {
  int count = 0;
  for (int i = 0; i < peaks.size(); ++i) {
    const std::uint16_t* p = row + peaks[i];
    const std::uint16_t higher = std::max(p[ridges.side[i]], p[-ridges.side[i]]);
    const bool hidden = static_cast<float>(higher) >= max_side_share * static_cast<float>(of.v[i]);
    // Each is written, and overwritten by the next unless it is a crest: cheaper than a branch.
    (*chosen)[count] = static_cast<std::uint16_t>(i);
    count += (ridges.missing[i] | static_cast<int>(hidden)) ^ 1;
  }
  return count;
}

/// Sum of the nine values around column x.
DEVO_ALWAYS_INLINE int SumOfNine(const std::int8_t* up, const std::int8_t* mid, const std::int8_t* down, int x) {
  int sum = 0;
  for (int i = x - 1; i <= x + 1; ++i) sum += up[i] + mid[i] + down[i];
  return sum;
}

/// Mean polarity of the events around a crest of height `v`.
DEVO_ALWAYS_INLINE float Polarity(int sum_of_nine, float v) {
  // Nine raw pixels hold about nine times the blurred value on a ridge; the ratio is clamped, not exact.
  return std::min(std::max(static_cast<float>(kEventWeight * sum_of_nine) / (6.0F * v), -1.0F), 1.0F);
}

/// Appends the crests among the peaks of row y and empties the list.
DEVO_ALWAYS_INLINE void AppendCrests(const cv::Mat1w& blurred, const SignedCounts& signed_events, int y,
                                     float max_side_share, PixelList* peaks, std::vector<EdgePoint>* crests) {
  Derivatives derivatives;
  Ridges ridges;
  PerPeak<std::uint16_t> chosen;
  peaks->PadToEight();
  derivatives.Load(blurred, y, *peaks);
  ridges.Find(derivatives, (peaks->size() + 7) / 8 * 8, static_cast<int>(blurred.step1()));
  const int count = ChooseCrests(blurred[y], *peaks, derivatives, ridges, max_side_share, &chosen);
  const std::size_t before = crests->size();
  crests->resize(before + static_cast<std::size_t>(count));
  EdgePoint* edge = crests->data() + before;
  for (int k = 0; k < count; ++k, ++edge) {
    const int i = chosen[k], x = (*peaks)[i];
    const auto v = static_cast<float>(derivatives.v[i]);
    edge->x = static_cast<float>(x) + ridges.ox[i];
    edge->y = static_cast<float>(y) + ridges.oy[i];
    edge->nx = ridges.nx[i];
    edge->ny = ridges.ny[i];
    edge->strength = v * (1.0F / kEventWeight);
    edge->polarity = 0;
    if (signed_events.empty()) continue;
    edge->polarity = Polarity(SumOfNine(signed_events[y - 1], signed_events[y], signed_events[y + 1], x), v);
  }
  peaks->Clear();
}

template <typename Peaks>
DEVO_ALWAYS_INLINE void FindCrestsWith(const cv::Mat1w& blurred, const SignedCounts& signed_events, std::uint16_t floor,
                                       float max_side_share, std::vector<EdgePoint>* crests) {
  const int right = blurred.cols - kMargin, bottom = blurred.rows - kMargin;
  const std::size_t stride = blurred.step1();
  for (int y = kMargin; y < bottom && crests->size() < Surface::kMaxEdges; ++y) {
    const std::uint16_t* row = blurred[y];
    PixelList peaks;
    for (int x = kMargin; x < right; x += 16) {
      const int bits = Peaks::Of(row + x, stride, floor) & (0xFFFF >> std::max(x + 16 - right, 0));
      if (bits != 0) {
        peaks.Append(x, bits & 0xFF);
        peaks.Append(x + 8, bits >> 8);
      }
      const bool last = x + 16 >= right;
      if (peaks.size() >= PixelList::kFull || (last && peaks.size() > 0)) {
        AppendCrests(blurred, signed_events, y, max_side_share, &peaks, crests);
      }
    }
  }
}

#ifdef DEVO_AVX2
DEVO_AVX2 void FindCrestsAvx2(const cv::Mat1w& blurred, const SignedCounts& signed_events, std::uint16_t floor,
                              float max_side_share, std::vector<EdgePoint>* crests) {
  FindCrestsWith<PeaksAvx2>(blurred, signed_events, floor, max_side_share, crests);
}
#endif
void FindCrestsPortable(const cv::Mat1w& blurred, const SignedCounts& signed_events, std::uint16_t floor,
                        float max_side_share, std::vector<EdgePoint>* crests) {
  FindCrestsWith<Peaks>(blurred, signed_events, floor, max_side_share, crests);
}

}  // namespace

std::array<int, 3> BlurKernel(double sigma_px) {
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

void Blur(const cv::Mat1w& in, double sigma_px, cv::Mat1w* scratch, cv::Mat1w* out) {
  const auto kernel = BlurKernel(sigma_px);
  scratch->create(kScratchRows, in.cols);
  out->create(in.size());
#ifdef DEVO_AVX2
  if (HasAvx2()) return BlurAvx2(in, kernel, scratch, out);
#endif
  BlurPortable(in, kernel, scratch, out);
}

void FindCrests(const cv::Mat1w& blurred, const SignedCounts& signed_events, int threshold,
                std::vector<EdgePoint>* crests, bool clear_only) {
  crests->clear();
  const float max_side_share = clear_only ? kMaxSideShare : kAnySide;
  const auto floor = static_cast<std::uint16_t>(std::max(threshold, kEventWeight / 8));
  auto find = FindCrestsPortable;
#ifdef DEVO_AVX2
  if (HasAvx2()) find = FindCrestsAvx2;
#endif
  find(blurred, signed_events, floor, max_side_share, crests);
  if (crests->size() > Surface::kMaxEdges) crests->resize(Surface::kMaxEdges);
}

}  // namespace devo
