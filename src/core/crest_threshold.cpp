// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/crest_threshold.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include <opencv2/core/hal/intrin.hpp>

#include "devo/core/crests.h"

namespace devo {
namespace {

constexpr int kBins = 512, kShift = 3;  // of heights
constexpr double kMostOfNoise = 0.05;
// Where noise is all there is, the highest are kept still.
constexpr double kMostLeftOut = 0.95;
constexpr int kMostAtOnePlace = 4, kHeights = kMostAtOnePlace * kEventWeight;  // of scattered events, without blur

/// Whether sixteen values in a row are all below `floor`. Values below 32768.
inline bool NoneReaches(const std::uint16_t* p, std::int16_t floor) {
  const auto reaches = [&](const std::uint16_t* q) {
    return cv::v_reinterpret_as_s16(cv::v_load(q)) >= cv::v_setall_s16(floor);
  };
  return !cv::v_check_any(reaches(p) | reaches(p + 8));
}

/// How many pixels of every fourth row are of each height but the lowest.
struct Heights {
  std::array<int, kBins> count{};
  int occupied = 0;
  double looked_at = 0;  // pixels
};

Heights HeightsOf(const cv::Mat1w& image) {
  Heights heights;
  for (int y = 2; y < image.rows; y += 4) {
    const std::uint16_t* p = image[y];
    for (int x = 0; x < image.cols;) {
      // Most of the image is empty: step over sixteen pixels at a time. Bin 0 is not asked for.
      while (x + 16 <= image.cols && NoneReaches(p + x, 1 << kShift)) x += 16;
      for (const int until = std::min(x + 16, image.cols); x < until; ++x) {
        ++heights.count[std::min<int>(p[x] >> kShift, kBins - 1)];
      }
    }
    heights.looked_at += image.cols;
  }
  for (int bin = 1; bin < kBins; ++bin) heights.occupied += heights.count[bin];
  return heights;
}

/// The first bin up to which a share `quantile` of the occupied pixels lies.
int QuantileOf(const Heights& heights, double quantile) {
  int below = 0;
  for (int bin = 1; bin < kBins; ++bin) {
    below += heights.count[bin];
    if (below >= quantile * heights.occupied) return bin;
  }
  return kBins - 1;
}

/// How likely a pixel is in each bin or a higher one, where so many events lie at random: the sum of what each place of
/// the blur's kernel, independent of the others, adds to it.
std::array<double, kBins> ChanceToReach(double events_per_pixel, double blur_px) {
  const auto kernel = BlurKernel(blur_px);
  std::array<double, kHeights> chance{};
  chance[0] = 1;
  for (int place = 0; place < 25; ++place) {
    const int added = kEventWeight * kernel[std::abs(place % 5 - 2)] * kernel[std::abs(place / 5 - 2)] >> 8;
    if (added == 0) continue;
    std::array<double, kHeights> with{};
    double likely = std::exp(-events_per_pixel);  // Poisson
    for (int events = 0; events <= kMostAtOnePlace; ++events) {
      for (int h = 0; h + events * added < kHeights; ++h) with[h + events * added] += likely * chance[h];
      likely *= events_per_pixel / (events + 1);
    }
    chance = with;
  }
  std::array<double, kBins> reached{};
  for (int h = 0; h < kHeights; ++h) reached[h >> kShift] += chance[h];
  for (int bin = kHeights >> kShift; bin-- > 0;) reached[bin] += reached[bin + 1];
  return reached;
}

}  // namespace

int CrestThreshold(const cv::Mat1w& blurred, double quantile, double noise_per_pixel, double blur_px) {
  const Heights heights = HeightsOf(blurred);
  int threshold = QuantileOf(heights, quantile);
  if (noise_per_pixel <= 0) return threshold << kShift;
  const int highest = QuantileOf(heights, std::max(quantile, kMostLeftOut));
  const auto reached_by_noise = ChanceToReach(noise_per_pixel, blur_px);
  int above = heights.occupied;
  for (int bin = 1; bin < threshold; ++bin) above -= heights.count[bin];
  while (threshold < highest && heights.looked_at * reached_by_noise[threshold] > kMostOfNoise * above) {
    above -= heights.count[threshold++];
  }
  return threshold << kShift;
}

}  // namespace devo
