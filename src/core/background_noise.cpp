// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/background_noise.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "filter_pixel.h"

namespace devo {
namespace {

constexpr double kQuietShare = 0.1;    // of the blocks is taken to show nothing but noise
constexpr double kQuietSigmas = 1.28;  // of a normal distribution's quantile kQuietShare
// Noise depends on the light, and so differs between parts of the image. A block shows nothing else where it passes as
// often as chance lets its own rate pass, times this and plus so many deviations: edges pass far more often. Where
// chance alone lets more than a share pass, the two look alike; nor is any noise beyond so many times the quietest's:
// that of dark parts, where a bright one has next to none.
constexpr double kBeyondChance = 1.3, kBeyondSigmas = 2, kMostByChance = 0.4;
constexpr double kMostTimesQuietest = 40, kLeastQuietest_hz = 0.1;
constexpr double kKnownShare = 0.25;  // of the blocks tells of all
constexpr double kMostTold_hz = 8;    // of all events per pixel: beyond, there is motion, and looking costs

}  // namespace

BackgroundNoise::BackgroundNoise(int width, int height, double period_s)
    : width_(width), height_(height), most_told_(kMostTold_hz * period_s * width * height) {
  // Blocks cut by the border hold fewer pixels and would pass for quiet: they are not looked at.
  block_counts_.resize(static_cast<std::size_t>(width_ / kBlock) * (height_ / kBlock));
  rates_hz_.reserve(block_counts_.size());
  ranked_counts_.reserve(block_counts_.size());
  passed_counts_.resize(static_cast<std::size_t>(width_ / kBlock + 1) * (height_ / kBlock + 1));
}

void BackgroundNoise::CountPassed(std::size_t judged, const Event* events, const std::uint32_t* passed,
                                  std::size_t count) {
  judged_ += judged;
  if (!CountsAll()) return;
  const int columns = width_ / kBlock + 1;
  for (std::size_t k = 0; k < count; ++k) {
    const Event& event = events[passed[k]];
    ++passed_counts_[static_cast<std::size_t>(event.y / kBlock) * columns + event.x / kBlock];
  }
}

bool BackgroundNoise::CountsAll() const { return static_cast<double>(judged_) <= most_told_; }

void BackgroundNoise::ForgetPassed() {
  judged_ = 0;
  std::fill(passed_counts_.begin(), passed_counts_.end(), 0);
}

void BackgroundNoise::Measure(const PixelMemory& memory, std::int64_t t_ns, double span_s,
                              const NeededNeighbours& needed) {
  CountPerBlock(memory);
  hz_ = QuietCount() / (kBlock * kBlock * span_s);
  FindRates(span_s, needed);
  on_share_ = memory.ShareOfOn(t_ns);
}

void BackgroundNoise::CountPerBlock(const PixelMemory& memory) {
  std::fill(block_counts_.begin(), block_counts_.end(), 0);
  const int columns = width_ / kBlock;
  for (int y = 0; y < height_ / kBlock * kBlock; ++y) {
    const std::uint32_t* row = memory.words() + memory.PositionOf(0, y);
    std::uint32_t* blocks = block_counts_.data() + static_cast<std::size_t>(y / kBlock) * columns;
    for (int column = 0; column < columns; ++column, row += kBlock) {
      std::uint32_t sum = 0;
      for (int x = 0; x < kBlock; ++x) sum += row[x] & kHotBit ? 0 : CountOf(row[x]);  // hot ones never pass
      blocks[column] += sum;
    }
  }
}

double BackgroundNoise::QuietCount() {
  if (block_counts_.empty()) return 0;
  ranked_counts_ = block_counts_;
  const auto quiet = ranked_counts_.begin() + static_cast<std::ptrdiff_t>(kQuietShare * ranked_counts_.size());
  std::nth_element(ranked_counts_.begin(), quiet, ranked_counts_.end());
  if (*quiet == 0) return 0;
  // The quantile of Poisson counts lies kQuietSigmas deviations below their mean.
  return std::pow(0.5 * kQuietSigmas + std::sqrt(0.25 * kQuietSigmas * kQuietSigmas + *quiet), 2);
}

void BackgroundNoise::FindRates(double span_s, const NeededNeighbours& needed) {
  rates_hz_.clear();
  if (!CountsAll()) return;
  const double pixel_seconds = kBlock * kBlock * span_s;
  const double most_hz = kMostTimesQuietest * std::max(hz_, kLeastQuietest_hz);
  const std::size_t columns = width_ / kBlock;
  for (std::size_t i = 0; i < block_counts_.size(); ++i) {
    const double rate_hz = block_counts_[i] / pixel_seconds;
    const double by_chance = PassingHz(needed, rate_hz, on_share_) * pixel_seconds;
    const double most = kBeyondChance * by_chance + kBeyondSigmas * std::sqrt(by_chance) + 1;
    const bool tells = rate_hz <= most_hz && by_chance <= kMostByChance * block_counts_[i];
    if (tells && passed_counts_[i / columns * (columns + 1) + i % columns] <= most) rates_hz_.push_back(rate_hz);
  }
}

double BackgroundNoise::MeanPassingHz(const NeededNeighbours& needed) const {
  const auto blocks = static_cast<double>(rates_hz_.size());
  if (blocks == 0 || blocks < kKnownShare * static_cast<double>(block_counts_.size())) {
    return PassingHz(needed, hz_, on_share_);
  }
  return std::accumulate(
             rates_hz_.begin(), rates_hz_.end(), 0.0,
             [&](double sum_hz, double rate_hz) { return sum_hz + PassingHz(needed, rate_hz, on_share_); }) /
         blocks;
}

void BackgroundNoise::Clear() {
  hz_ = 0;
  rates_hz_.clear();
  ForgetPassed();
  on_share_ = 0.5;
}

}  // namespace devo
