// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

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
constexpr std::uint32_t kHotMinCount = 8;
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

// Lamps flicker at twice the mains' frequency, 100 or 120 Hz, and pixels that see them fire at least once brighter and
// once darker each time: this many events per second are half of that. Where they fill half of an area, nearly all with
// the last event of one polarity and within a quarter of a period, twice in a row, it is no motion: an edge that
// crosses so large an area so fast does so once.
constexpr double kFlicker_hz = 100;
constexpr int kFlickerSide = kBlock, kFlickerStep = 8, kFlickerLeast = kFlickerSide * kFlickerSide / 2;
constexpr double kFlickerAlike = 0.9;
constexpr std::int64_t kFlickerSpread_us = 2500;

/// Whether kFlickerAlike of the ages are within `spread` of each other, those of the other polarity lying far away.
bool AreAlike(std::int64_t* ages, std::size_t count, std::int64_t spread) {
  if (count == 0) return false;
  std::nth_element(ages, ages + count / 2, ages + count);
  const std::int64_t median = ages[count / 2];
  const auto alike =
      std::count_if(ages, ages + count, [&](std::int64_t age) { return std::abs(age - median) <= spread / 2; });
  return static_cast<double>(alike) >= kFlickerAlike * static_cast<double>(count);
}

NeededNeighbours Asked(double window_s, int min_neighbours) {
  return {min_neighbours, static_cast<std::uint32_t>(1e6 * window_s), false};
}

}  // namespace

NoiseFilter::NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor)
    : width_(width), height_(height), asked_(Asked(window_s, min_neighbours)), hot_factor_(hot_factor),
      memory_(width, height, asked_.window_us) {
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
  noise_hz_ = 0;
  noise_rates_hz_.clear();
  ForgetPassed();
  on_share_ = 0.5;
  const auto areas = [](int side) {
    return static_cast<std::size_t>(std::max(side - kFlickerSide, -kFlickerStep) / kFlickerStep + 1);
  };
  suspected_.assign(areas(width_) * areas(height_), 0);
  knows_noise_ = false;
  SetNeeded();
  hot_pixels_ = 0;
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
  FindFlicker(span_s, t_ns);
  on_share_ = memory_.ShareOfOn(t_ns);
  SetNeeded();
  if (!std::exchange(knows_noise_, true)) {
    // Too early to tell hot pixels, what was counted stays; and that there is too much noise, not that there is little.
    memory_.MarkHot(flickering_);
    next_update_ns_ = std::max(t_ns, counted_since_ns_ + kPeriod_ns);
    return;
  }
  UpdateHotPixels();
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

bool NoiseFilter::IsHot(std::size_t i) const {
  // More than the factor times the median of its neighbours and a quarter, that is: of eight, five are quiet enough.
  // The median, not the mean: two hot pixels side by side must not excuse each other.
  const std::uint32_t count = CountOf(memory_.words()[i]);
  const auto stands_out = [&](int quiet) { return count > hot_factor_ * (quiet + 0.25); };
  int quiet = static_cast<int>(std::min<double>(count / hot_factor_, kMostEvents));
  while (quiet >= 0 && !stands_out(quiet)) --quiet;
  return quiet >= 0 && NeighboursAbove(memory_.words() + i, memory_.stride(), static_cast<std::uint32_t>(quiet)) <= 3;
}

void NoiseFilter::FindFlicker(double span_s, std::int64_t t_ns) {
  flickering_.clear();
  const auto least = static_cast<std::uint32_t>(kFlicker_hz * span_s);
  std::size_t area = 0;
  for (int y = 0; y + kFlickerSide <= height_; y += kFlickerStep) {
    for (int x = 0; x + kFlickerSide <= width_; x += kFlickerStep, ++area) {
      AddFlickerOf(memory_.PositionOf(x, y), least, memory_.clock().At(t_ns), &suspected_[area]);
    }
  }
}

void NoiseFilter::AddFlickerOf(std::size_t corner, std::uint32_t least, std::int64_t ticks, char* suspected) {
  const std::uint32_t* const words = memory_.words();
  // The common case first: an area of which half flickers does so in one of these rows.
  const auto reaches = [&](int y) {
    return AnyReaches(words + corner + static_cast<std::size_t>(y) * memory_.stride(), least);
  };
  if (!reaches(kFlickerSide / 4) && !reaches(3 * kFlickerSide / 4)) {
    *suspected = 0;
    return;
  }
  std::array<std::uint32_t, kFlickerSide * kFlickerSide> busy;
  std::array<std::int64_t, kFlickerSide * kFlickerSide> ages;
  std::size_t count = 0, aged = 0;
  for (int y = 0; y < kFlickerSide; ++y) {
    const std::size_t row = corner + static_cast<std::size_t>(y) * memory_.stride();
    for (std::size_t i = row; i < row + kFlickerSide; ++i) {
      if (CountOf(words[i]) < least) continue;
      busy[count++] = static_cast<std::uint32_t>(i);
      // Those known to flicker, or hot, have no times any more: they do as long as they are as busy.
      if (!(words[i] & kHotBit)) ages[aged++] = (static_cast<std::uint32_t>(ticks) - words[i]) & kTickMask;
    }
  }
  const bool known = count - aged >= kFlickerLeast, suspected_before = *suspected;
  *suspected = count >= kFlickerLeast && AreAlike(ages.data(), aged, kFlickerSpread_us >> memory_.clock().shift);
  if (count < kFlickerLeast || !(known || (suspected_before && *suspected))) return;
  flickering_.insert(flickering_.end(), busy.begin(), busy.begin() + count);
}

void NoiseFilter::UpdateHotPixels() {
  hot_.clear();
  const std::uint32_t* const words = memory_.words();
  const int stride = memory_.stride();
  const std::size_t first = stride, last = static_cast<std::size_t>(stride) * (height_ + 1);
  for (std::size_t begin = first; begin < last && hot_factor_ > 0; begin += kBlock) {
    // The common case first: quiet pixels need no look at their neighbours.
    const std::size_t end = std::min(begin + kBlock, last);
    if (end - begin == kBlock && !AnyReaches(words + begin, kHotMinCount)) continue;
    for (std::size_t i = begin; i < end; ++i) {
      if (CountOf(words[i]) >= kHotMinCount && IsHot(i)) hot_.push_back(static_cast<std::uint32_t>(i));
    }
  }
  memory_.BeginPeriod();
  memory_.MarkHot(hot_);
  memory_.MarkHot(flickering_);
  hot_pixels_ = static_cast<int>(hot_.size());
}

}  // namespace devo
