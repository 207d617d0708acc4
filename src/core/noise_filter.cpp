// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "devo/core/hot_pixels.h"
#include "devo/core/neighbour_filter.h"
#include "devo/core/time.h"
#include "filter_pixel.h"

namespace devo {
namespace {

// Activity is compared over this span: long enough for a pixel at 40 Hz to stand out, short enough
// to follow changes of temperature and light.
constexpr std::int64_t kPeriod_ns = 250'000'000;
// Noise is first estimated after this time: a block at 1 Hz has a dozen events by then.
constexpr std::int64_t kFirstPeriod_ns = 50'000'000;
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
NeededNeighbours Asked(double window_s, int min_neighbours) {
  return {min_neighbours, static_cast<std::uint32_t>(1e6 * window_s), false};
}

}  // namespace

NoiseFilter::NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor)
    : width_(width), height_(height), asked_(Asked(window_s, min_neighbours)), hot_factor_(hot_factor),
      memory_(width, height, asked_.window_us), flicker_(width, height) {
  // Blocks cut by the border hold fewer pixels and would pass for quiet: they are not looked at.
  block_counts_.resize(static_cast<std::size_t>(width_ / kBlock) * (height_ / kBlock));
  noise_rates_hz_.reserve(block_counts_.size());
  ranked_counts_.reserve(block_counts_.size());
  passed_counts_.resize(static_cast<std::size_t>(width_ / kBlock + 1) * (height_ / kBlock + 1));
  Reset();
}

void NoiseFilter::SetCriteria(double window_s, int min_neighbours, double hot_factor) {
  asked_ = Asked(window_s, min_neighbours);
  hot_factor_ = hot_factor;
  SetNeeded();
}

void NoiseFilter::Reset() {
  memory_.Clear();
  flicker_.Clear();
  hot_.clear();
  noise_hz_ = 0;
  noise_rates_hz_.clear();
  ForgetPassed();
  on_share_ = 0.5;
  knows_noise_ = false;
  SetNeeded();
}

std::size_t NoiseFilter::Pass(EventSpan events, std::uint32_t* passed) {
  std::size_t count = 0;
  for (const Event* next = events.begin(); next != events.end();) {
    if (!memory_.has_begun()) {
      memory_.Begin(next->t_ns);
      counted_since_ns_ = next->t_ns;
      next_update_ns_ = next->t_ns + kFirstPeriod_ns;
    }
    memory_.ForgetLongAgo(next->t_ns);
    if (next->t_ns >= next_update_ns_) Update(next->t_ns);
    const std::int64_t end_ns = std::min(next_update_ns_, memory_.next_forgetting_ns());
    const Event* until =
        events.end()[-1].t_ns < end_ns
            ? events.end()
            : std::partition_point(next, events.end(), [&](const Event& e) { return e.t_ns < end_ns; });
    const EventSpan piece(next, static_cast<std::size_t>(until - next));
    const auto position = static_cast<std::uint32_t>(next - events.begin());
    const std::size_t of_piece = PassWithNeighbours(needed_, piece, position, &memory_, passed + count);
    CountPassed(piece.size, events.begin(), passed + count, of_piece);
    count += of_piece;
    next = until;
  }
  return count;
}

void NoiseFilter::CountPassed(std::size_t judged, const Event* events, const std::uint32_t* passed, std::size_t count) {
  judged_ += judged;
  if (!CountsAll()) return;
  const int columns = width_ / kBlock + 1;
  for (std::size_t k = 0; k < count; ++k) {
    const Event& event = events[passed[k]];
    ++passed_counts_[static_cast<std::size_t>(event.y / kBlock) * columns + event.x / kBlock];
  }
}

bool NoiseFilter::CountsAll() const {
  return static_cast<double>(judged_) <= kMostTold_hz * SecondsFromNs(kPeriod_ns) * width_ * height_;
}

void NoiseFilter::ForgetPassed() {
  judged_ = 0;
  std::fill(passed_counts_.begin(), passed_counts_.end(), 0);
}

double NoiseFilter::MeanPassingHz() const {
  const auto blocks = static_cast<double>(noise_rates_hz_.size());
  if (blocks < kKnownShare * static_cast<double>(block_counts_.size())) return passing_noise_hz();
  return std::accumulate(
             noise_rates_hz_.begin(), noise_rates_hz_.end(), 0.0,
             [this](double sum_hz, double rate_hz) { return sum_hz + PassingHz(needed_, rate_hz, on_share_); }) /
         blocks;
}

void NoiseFilter::SetNeeded() {
  needed_ = ChooseNeeded(asked_, noise_hz_, on_share_, knows_noise_);
  mean_passing_noise_hz_ = MeanPassingHz();
}

void NoiseFilter::Update(std::int64_t t_ns) {
  // After a gap it is the events before it that were counted.
  const double span_s = SecondsFromNs(next_update_ns_ - counted_since_ns_);
  UpdateNoise(span_s);
  FindNoise(span_s);
  flicker_.Find(memory_, t_ns, span_s);
  on_share_ = memory_.ShareOfOn(t_ns);
  SetNeeded();
  if (!std::exchange(knows_noise_, true)) {
    // Too early to tell hot pixels, what was counted stays; and that there is too much noise, not that there is little.
    memory_.MarkHot(flicker_.pixels());
    next_update_ns_ = std::max(t_ns, counted_since_ns_ + kPeriod_ns);
    return;
  }
  FindHotPixels(memory_, hot_factor_, &hot_);
  memory_.BeginPeriod();
  memory_.MarkHot(hot_);
  memory_.MarkHot(flicker_.pixels());
  ForgetPassed();
  counted_since_ns_ = t_ns;
  next_update_ns_ = t_ns + kPeriod_ns;
}

void NoiseFilter::UpdateNoise(double span_s) {
  std::fill(block_counts_.begin(), block_counts_.end(), 0);
  const int columns = width_ / kBlock;
  for (int y = 0; y < height_ / kBlock * kBlock; ++y) {
    const std::uint32_t* row = memory_.words() + memory_.PositionOf(0, y);
    std::uint32_t* blocks = block_counts_.data() + static_cast<std::size_t>(y / kBlock) * columns;
    for (int column = 0; column < columns; ++column, row += kBlock) {
      std::uint32_t sum = 0;
      for (int x = 0; x < kBlock; ++x) sum += row[x] & kHotBit ? 0 : CountOf(row[x]);  // hot ones never pass
      blocks[column] += sum;
    }
  }
  double count = 0;
  if (!block_counts_.empty()) {
    ranked_counts_ = block_counts_;
    const auto quiet = ranked_counts_.begin() + static_cast<std::ptrdiff_t>(kQuietShare * ranked_counts_.size());
    std::nth_element(ranked_counts_.begin(), quiet, ranked_counts_.end());
    // The quantile of Poisson counts lies kQuietSigmas deviations below their mean.
    if (*quiet > 0) count = std::pow(0.5 * kQuietSigmas + std::sqrt(0.25 * kQuietSigmas * kQuietSigmas + *quiet), 2);
  }
  noise_hz_ = count / (kBlock * kBlock * span_s);
}

void NoiseFilter::FindNoise(double span_s) {
  noise_rates_hz_.clear();
  if (!CountsAll()) return;
  const double pixel_seconds = kBlock * kBlock * span_s;
  const double most_hz = kMostTimesQuietest * std::max(noise_hz_, kLeastQuietest_hz);
  const std::size_t columns = width_ / kBlock;
  for (std::size_t i = 0; i < block_counts_.size(); ++i) {
    const double rate_hz = block_counts_[i] / pixel_seconds;
    const double by_chance = PassingHz(needed_, rate_hz, on_share_) * pixel_seconds;
    const double most = kBeyondChance * by_chance + kBeyondSigmas * std::sqrt(by_chance) + 1;
    const bool tells = rate_hz <= most_hz && by_chance <= kMostByChance * block_counts_[i];
    if (tells && passed_counts_[i / columns * (columns + 1) + i % columns] <= most) noise_rates_hz_.push_back(rate_hz);
  }
}

}  // namespace devo
