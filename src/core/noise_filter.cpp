// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {

// Activity is compared over this span: long enough for a pixel at 40 Hz to stand out, short enough
// to follow changes of temperature and light.
constexpr std::int64_t kPeriod_ns = 250'000'000;
constexpr int kHotMinCount = 8;
constexpr int kBlock = 16;
constexpr double kQuietShare = 0.1;    // of the blocks is taken to show nothing but noise
constexpr double kQuietSigmas = 1.28;  // of a normal distribution's quantile kQuietShare
// Passing noise of this rate is a third of the least activity of a motion.
constexpr double kTolerableNoise_hz = 0.05;
// Time is kept in wrapping microseconds of 32 bits; this offset makes "never" older than any window.
constexpr std::uint32_t kNever = 0x80000000U;

}  // namespace

NoiseFilter::NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor)
    : width_(width), height_(height), stride_(width + 2), window_us_(static_cast<std::uint32_t>(1e6 * window_s)),
      min_neighbours_(min_neighbours), hot_factor_(hot_factor) {
  Reset();
}

void NoiseFilter::SetCriteria(double window_s, int min_neighbours, double hot_factor) {
  // The one more that dense noise asks for stays until the next update.
  needed_neighbours_ = min_neighbours > 0 ? min_neighbours + needed_neighbours_ - min_neighbours_ : 0;
  window_us_ = static_cast<std::uint32_t>(1e6 * window_s);
  min_neighbours_ = min_neighbours;
  hot_factor_ = hot_factor;
}

void NoiseFilter::Reset() {
  const std::size_t padded = static_cast<std::size_t>(stride_) * (height_ + 2);
  last_us_.assign(padded, kNever);
  counts_.assign(padded, 0);
  hot_.assign(padded, 0);
  // Blocks cut by the border hold fewer pixels and would pass for quiet: the last column and row are not looked at.
  blocks_per_row_ = width_ / kBlock + 1;
  block_counts_.assign(static_cast<std::size_t>(blocks_per_row_) * (height_ / kBlock + 1), 0);
  noise_hz_ = 0;
  needed_neighbours_ = min_neighbours_ > 0 ? min_neighbours_ + 1 : 0;  // until the noise is known
  t0_ns_ = -1;
  hot_pixels_ = 0;
}

bool NoiseFilter::Pass(const Event& event) {
  if (t0_ns_ < 0) {
    t0_ns_ = event.t_ns;
    next_update_ns_ = event.t_ns + kPeriod_ns;
  }
  const std::size_t i = static_cast<std::size_t>(event.y + 1) * stride_ + event.x + 1;
  if (event.t_ns >= next_update_ns_) {
    UpdateNoise();
    UpdateHotPixels(static_cast<std::uint32_t>((event.t_ns - t0_ns_) / 1000));
    next_update_ns_ = event.t_ns + kPeriod_ns;
  }
  ++block_counts_[static_cast<std::size_t>(event.y / kBlock) * blocks_per_row_ + event.x / kBlock];
  counts_[i] += counts_[i] < 0xFFFF;
  if (hot_[i]) return false;
  if (min_neighbours_ == 0) return true;

  const auto now_us = static_cast<std::uint32_t>((event.t_ns - t0_ns_) / 1000);
  const auto recent = [&](std::size_t k) { return static_cast<int>(now_us - last_us_[k] <= window_us_); };
  const std::size_t up = i - stride_, down = i + stride_;
  last_us_[i] = now_us;
  // On an edge the first few neighbours suffice: row by row, most events never reach the last.
  int neighbours = recent(i - 1) + recent(i + 1);
  if (neighbours >= needed_neighbours_) return true;
  neighbours += recent(up - 1) + recent(up) + recent(up + 1);
  if (neighbours >= needed_neighbours_) return true;
  neighbours += recent(down - 1) + recent(down) + recent(down + 1);
  return neighbours >= needed_neighbours_;
}

double NoiseFilter::ChanceOfNeighbours(int at_least) const {
  // Binomial: each of eight neighbours fired within the window or did not, however often.
  const double none = std::exp(-noise_hz_ * 1e-6 * window_us_);
  double term = std::pow(none, 8), below = 0;
  for (int k = 0; k < at_least; ++k) {
    below += term;
    term *= (8 - k) * (1 - none) / ((k + 1) * none);
  }
  return 1 - below;
}

double NoiseFilter::passing_noise_hz() const { return noise_hz_ * ChanceOfNeighbours(needed_neighbours_); }

void NoiseFilter::UpdateNoise() {
  std::vector<std::uint32_t> whole;
  for (int y = 0; y < height_ / kBlock; ++y) {
    const auto row = block_counts_.begin() + static_cast<std::ptrdiff_t>(y) * blocks_per_row_;
    whole.insert(whole.end(), row, row + blocks_per_row_ - 1);
  }
  double count = 0;
  if (!whole.empty()) {
    const auto quiet = whole.begin() + static_cast<std::ptrdiff_t>(kQuietShare * whole.size());
    std::nth_element(whole.begin(), quiet, whole.end());
    // The quantile of Poisson counts lies kQuietSigmas deviations below their mean.
    if (*quiet > 0) count = std::pow(0.5 * kQuietSigmas + std::sqrt(0.25 * kQuietSigmas * kQuietSigmas + *quiet), 2);
  }
  noise_hz_ = count / (kBlock * kBlock * SecondsFromNs(kPeriod_ns));
  std::fill(block_counts_.begin(), block_counts_.end(), 0);
  if (min_neighbours_ == 0) return;
  const bool noisy = noise_hz_ * ChanceOfNeighbours(min_neighbours_) > kTolerableNoise_hz;
  needed_neighbours_ = min_neighbours_ + (noisy ? 1 : 0);
}

void NoiseFilter::UpdateHotPixels(std::uint32_t now_us) {
  hot_pixels_ = 0;
  for (int y = 1; y <= height_; ++y) {
    for (int x = 1; x <= width_; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * stride_ + x;
      // Wrapping time: what was long ago must not come round and look recent.
      if (now_us - last_us_[i] > kNever) last_us_[i] = now_us - kNever;
      // The common case first: a quiet pixel needs no look at its neighbours.
      if (counts_[i] < kHotMinCount) {
        hot_[i] = 0;
        continue;
      }
      const std::size_t up = i - stride_, down = i + stride_;
      // The median of the neighbours, not their mean: two hot pixels side by side must not excuse each other.
      std::uint16_t around[8] = {counts_[up - 1], counts_[up],       counts_[up + 1], counts_[i - 1],
                                 counts_[i + 1],  counts_[down - 1], counts_[down],   counts_[down + 1]};
      std::nth_element(around, around + 4, around + 8);
      hot_[i] = hot_factor_ > 0 && counts_[i] > hot_factor_ * (around[4] + 0.25);
      hot_pixels_ += hot_[i];
    }
  }
  std::fill(counts_.begin(), counts_.end(), 0);
}

}  // namespace devo
