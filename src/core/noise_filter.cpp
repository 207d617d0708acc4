// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "devo/core/time.h"
#include "simd.h"

#ifdef DEVO_AVX2
#include <immintrin.h>
#endif

namespace devo {
namespace {

// Activity is compared over this span: long enough for a pixel at 40 Hz to stand out, short enough
// to follow changes of temperature and light.
constexpr std::int64_t kPeriod_ns = 250'000'000;
// Noise is first estimated after this time: a block at 1 Hz has a dozen events by then.
constexpr std::int64_t kFirstPeriod_ns = 50'000'000;
constexpr std::int64_t kNsPerMicrosecond = 1000;
constexpr std::uint32_t kHotMinCount = 8;
constexpr int kBlock = 16;
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

// A pixel is one word: in the lower bits the tick at which it last fired, wrapping, half the range later for an ON
// event; in the upper bits how many events it had in this period, and whether it is hot. An event reads nine of them,
// so that their size decides the cost. As no age exceeds kAgeMask, an event of the other polarity has an age beyond it,
// or, with that bit masked out, its own.
constexpr std::uint32_t kTickMask = 0x1FFFF, kAgeMask = 0xFFFF, kOnTicks = 0x10000;
constexpr std::uint32_t kOneEvent = 0x20000, kCountMask = 0x7FFE0000, kHotBit = 0x80000000;
constexpr int kMostEvents = kCountMask / kOneEvent;
constexpr std::int64_t kLongAgo_ticks = 1 << 14;  // longer than any window: from then on age is not told apart
constexpr std::int64_t kForgettingPeriod_ticks = 1 << 15;
static_assert(kForgettingPeriod_ticks + 2 * kLongAgo_ticks <= kAgeMask + 1, "what is long ago must not come round");

constexpr std::ptrdiff_t kAhead = 40;  // events: about the time that the third cache takes to answer

/// A neighbour is old that fired longer than `window_ticks` ago; `age_mask`: kTickMask, where it also must have been of
/// the same polarity, else kAgeMask.
struct Age {
  std::uint32_t window_ticks, age_mask;
};

inline std::uint32_t CountOf(std::uint32_t pixel) { return (pixel & kCountMask) / kOneEvent; }

/// Tells how many of the eight neighbours of a pixel, in an image whose rows are `stride` long, are old at `tick`.
/// Without a branch: which of them are is nothing that a processor could guess.
struct OldNeighbours {
  explicit OldNeighbours(Age age)
      : window(cv::v_setall_s32(static_cast<int>(age.window_ticks))), mask(cv::v_setall_u32(age.age_mask)) {}

  DEVO_ALWAYS_INLINE int Count(const std::uint32_t* pixel, int stride, std::uint32_t tick) const {
    const cv::v_uint32x4 now = cv::v_setall_u32(tick);
    // -1 where it is.
    const auto old = [&](const std::uint32_t* p) {
      return cv::v_reinterpret_as_s32((now - cv::v_load(p)) & mask) > window;
    };
    const cv::v_int32x4 three(-1, -1, -1, 0), sides(-1, 0, -1, 0);
    const cv::v_int32x4 up_and_down = (old(pixel - stride - 1) + old(pixel + stride - 1)) & three;
    return -cv::v_reduce_sum(up_and_down + (old(pixel - 1) & sides));
  }

  cv::v_int32x4 window;
  cv::v_uint32x4 mask;
};

#ifdef DEVO_AVX2
/// The same, both outer rows at once.
struct OldNeighboursAvx2 {
  DEVO_AVX2 explicit OldNeighboursAvx2(Age age)
      : window(_mm256_set1_epi32(static_cast<int>(age.window_ticks))),
        mask(_mm256_set1_epi32(static_cast<int>(age.age_mask))) {}

  DEVO_AVX2 inline int Count(const std::uint32_t* pixel, int stride, std::uint32_t tick) const {
    const auto load = [](const std::uint32_t* p)
                          DEVO_AVX2 { return _mm_loadu_si128(reinterpret_cast<const __m128i*>(p)); };
    const __m256i now = _mm256_set1_epi32(static_cast<int>(tick));
    const __m256i outer =
        _mm256_inserti128_si256(_mm256_castsi128_si256(load(pixel - stride - 1)), load(pixel + stride - 1), 1);
    const __m256i old = _mm256_cmpgt_epi32(_mm256_and_si256(_mm256_sub_epi32(now, outer), mask), window);
    const __m128i old_sides = _mm_cmpgt_epi32(
        _mm_and_si128(_mm_sub_epi32(_mm256_castsi256_si128(now), load(pixel - 1)), _mm256_castsi256_si128(mask)),
        _mm256_castsi256_si128(window));
    const int outer_bits = _mm256_movemask_ps(_mm256_castsi256_ps(old)) & 0x77;
    const int side_bits = _mm_movemask_ps(_mm_castsi128_ps(old_sides)) & 0x5;
    return __builtin_popcount(static_cast<unsigned>(outer_bits | side_bits << 8));
  }

  __m256i window, mask;
};
#endif

/// -1 for each of the four pixels from `pixel` on that had more than `count` events.
inline cv::v_int32x4 Above(const std::uint32_t* pixel, std::uint32_t count) {
  const cv::v_uint32x4 counts = cv::v_load(pixel) & cv::v_setall_u32(kCountMask);
  return cv::v_reinterpret_as_s32(counts) > cv::v_setall_s32(static_cast<int>(count * kOneEvent));
}

/// Of the eight neighbours of a pixel, how many had more than `count` events.
inline int NeighboursAbove(const std::uint32_t* pixel, int stride, std::uint32_t count) {
  const cv::v_int32x4 three(-1, -1, -1, 0), sides(-1, 0, -1, 0);
  const cv::v_int32x4 up_and_down = (Above(pixel - stride - 1, count) + Above(pixel + stride - 1, count)) & three;
  return -cv::v_reduce_sum(up_and_down + (Above(pixel - 1, count) & sides));
}

/// Whether one of the kBlock pixels from `pixel` on had at least `count` events.
inline bool AnyReaches(const std::uint32_t* pixel, std::uint32_t count) {
  static_assert(kBlock == 16);
  return cv::v_check_any((Above(pixel, count - 1) | Above(pixel + 4, count - 1)) |
                         (Above(pixel + 8, count - 1) | Above(pixel + 12, count - 1)));
}

/// Whether kFlickerAlike of the ages are within `spread` of each other, those of the other polarity lying far away.
bool AreAlike(std::int64_t* ages, std::size_t count, std::int64_t spread) {
  if (count == 0) return false;
  std::nth_element(ages, ages + count / 2, ages + count);
  const std::int64_t median = ages[count / 2];
  const auto alike =
      std::count_if(ages, ages + count, [&](std::int64_t age) { return std::abs(age - median) <= spread / 2; });
  return static_cast<double>(alike) >= kFlickerAlike * static_cast<double>(count);
}

/// What events are judged by.
struct Judged {
  std::uint32_t* pixels;
  int stride, needed;
  std::int64_t t0_ns;
  int tick_shift;

  std::uint32_t* PixelOf(const Event& e) const { return pixels + static_cast<std::size_t>(e.y + 1) * stride + e.x + 1; }
};

inline std::uint32_t Counted(std::uint32_t pixel) {
  return pixel + ((pixel & kCountMask) < kCountMask ? kOneEvent : 0);
}

DEVO_ALWAYS_INLINE std::uint32_t TickOf(Judged by, const Event& event) {
  return static_cast<std::uint32_t>((event.t_ns - by.t0_ns) / kNsPerMicrosecond >> by.tick_shift) +
         (event.polarity ? kOnTicks : 0);
}

DEVO_ALWAYS_INLINE std::uint32_t Fired(std::uint32_t pixel, std::uint32_t tick) {
  return (Counted(pixel) & ~kTickMask) | (tick & kTickMask);
}

/// Writes the positions, counted from `position`, of the events that pass.
template <typename Neighbours>
DEVO_ALWAYS_INLINE std::size_t Judge(Judged by, const Neighbours& neighbours, EventSpan events, std::uint32_t position,
                                     std::uint32_t* passed) {
  std::size_t count = 0;
  const int most_old = 8 - by.needed;
  for (const Event& event : events) {
    // Events jump about in the image: what a later one will need is fetched while this one is judged. One in five rows
    // of its neighbours goes on in the next cache line.
    const std::uint32_t* const later =
        by.PixelOf(*(&event + std::min<std::ptrdiff_t>(kAhead, events.end() - 1 - &event)));
    for (const int row : {-by.stride, 0, by.stride}) {
      Prefetch(later + row - 1);
      Prefetch(later + row + 2);
    }
    std::uint32_t* const pixel = by.PixelOf(event);
    const std::uint32_t before = *pixel;
    passed[count] = position++;
    if (before & kHotBit) {
      *pixel = Counted(before);
      continue;
    }
    const std::uint32_t tick = TickOf(by, event);
    count += neighbours.Count(pixel, by.stride, tick) <= most_old;
    *pixel = Fired(before, tick);
  }
  return count;
}

#ifdef DEVO_AVX2
DEVO_AVX2 std::size_t JudgeAvx2(Judged by, Age age, EventSpan events, std::uint32_t position, std::uint32_t* passed) {
  return Judge(by, OldNeighboursAvx2(age), events, position, passed);
}
#endif

/// The same where only hot pixels are noise. Times are kept all the same: they tell flicker from motion.
std::size_t CountOnly(Judged by, EventSpan events, std::uint32_t position, std::uint32_t* passed) {
  std::size_t count = 0;
  for (const Event& event : events) {
    std::uint32_t* const pixel = by.PixelOf(event);
    const bool hot = *pixel & kHotBit;
    passed[count] = position++;
    count += hot ? 0 : 1;
    *pixel = hot ? Counted(*pixel) : Fired(*pixel, TickOf(by, event));
  }
  return count;
}

NeededNeighbours Asked(double window_s, int min_neighbours) {
  return {min_neighbours, static_cast<std::uint32_t>(1e6 * window_s), false};
}

}  // namespace

NoiseFilter::NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor)
    : width_(width), height_(height), stride_(width + 2), asked_(Asked(window_s, min_neighbours)),
      hot_factor_(hot_factor) {
  while (asked_.window_us >> tick_shift_ >= kLongAgo_ticks) ++tick_shift_;
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
  // Neighbours are read four at a time: one more than there are at the end.
  pixels_.assign(static_cast<std::size_t>(stride_) * (height_ + 2) + 1, kTickMask & -kLongAgo_ticks);
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
  t0_ns_ = -1;
  hot_pixels_ = 0;
}

std::size_t NoiseFilter::Pass(EventSpan events, std::uint32_t* passed) {
  std::size_t count = 0;
  for (const Event* next = events.begin(); next != events.end();) {
    if (t0_ns_ < 0) {
      t0_ns_ = next->t_ns;
      counted_since_ns_ = t0_ns_;
      next_update_ns_ = t0_ns_ + kFirstPeriod_ns;
      forgot_ticks_ = 0;
    }
    if (TicksAt(next->t_ns) - forgot_ticks_ >= kForgettingPeriod_ticks) ForgetLongAgo(TicksAt(next->t_ns));
    if (next->t_ns >= next_update_ns_) Update(next->t_ns);
    const std::int64_t forget_us = (forgot_ticks_ + kForgettingPeriod_ticks) << tick_shift_;
    const std::int64_t end_ns = std::min(next_update_ns_, t0_ns_ + forget_us * kNsPerMicrosecond);
    const Event* until =
        events.end()[-1].t_ns < end_ns
            ? events.end()
            : std::partition_point(next, events.end(), [&](const Event& e) { return e.t_ns < end_ns; });
    const EventSpan piece(next, static_cast<std::size_t>(until - next));
    const auto position = static_cast<std::uint32_t>(next - events.begin());
    const std::size_t of_piece = PassPiece(piece, position, passed + count);
    CountPassed(piece.size, events.begin(), passed + count, of_piece);
    count += of_piece;
    next = until;
  }
  return count;
}

std::int64_t NoiseFilter::TicksAt(std::int64_t t_ns) const {
  return (t_ns - t0_ns_) / kNsPerMicrosecond >> tick_shift_;
}

std::size_t NoiseFilter::PassPiece(EventSpan events, std::uint32_t position, std::uint32_t* passed) {
  const Judged judged{pixels_.data(), stride_, needed_.count, t0_ns_, tick_shift_};
  const Age age{needed_.window_us >> tick_shift_, needed_.same_polarity ? kTickMask : kAgeMask};
  if (needed_.count == 0) return CountOnly(judged, events, position, passed);
#ifdef DEVO_AVX2
  if (HasAvx2()) return JudgeAvx2(judged, age, events, position, passed);
#endif
  return Judge(judged, OldNeighbours(age), events, position, passed);
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
  FindFlicker(span_s, TicksAt(t_ns));
  UpdateShareOfOn(TicksAt(t_ns));
  SetNeeded();
  if (!std::exchange(knows_noise_, true)) {
    // Too early to tell hot pixels, what was counted stays; and that there is too much noise, not that there is little.
    for (const std::uint32_t i : flickering_) pixels_[i] |= kHotBit;
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
    const std::uint32_t* row = pixels_.data() + static_cast<std::size_t>(y + 1) * stride_ + 1;
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

void NoiseFilter::UpdateShareOfOn(std::int64_t ticks) {
  std::size_t recent = 0, on = 0;
  for (const std::uint32_t pixel : pixels_) {
    const std::uint32_t age = static_cast<std::uint32_t>(ticks) - pixel;
    const bool is_recent = (age & kAgeMask) < kLongAgo_ticks;
    recent += is_recent;
    on += is_recent & ((age & kOnTicks) != 0);
  }
  on_share_ = recent > 0 ? static_cast<double>(on) / static_cast<double>(recent) : 0.5;
}

bool NoiseFilter::IsHot(std::size_t i) const {
  // More than the factor times the median of its neighbours and a quarter, that is: of eight, five are quiet enough.
  // The median, not the mean: two hot pixels side by side must not excuse each other.
  const std::uint32_t count = CountOf(pixels_[i]);
  const auto stands_out = [&](int quiet) { return count > hot_factor_ * (quiet + 0.25); };
  int quiet = static_cast<int>(std::min<double>(count / hot_factor_, kMostEvents));
  while (quiet >= 0 && !stands_out(quiet)) --quiet;
  return quiet >= 0 && NeighboursAbove(pixels_.data() + i, stride_, static_cast<std::uint32_t>(quiet)) <= 3;
}

void NoiseFilter::FindFlicker(double span_s, std::int64_t ticks) {
  flickering_.clear();
  const auto least = static_cast<std::uint32_t>(kFlicker_hz * span_s);
  std::size_t area = 0;
  for (int y = 0; y + kFlickerSide <= height_; y += kFlickerStep) {
    const std::size_t row = static_cast<std::size_t>(y + 1) * stride_ + 1;
    for (int x = 0; x + kFlickerSide <= width_; x += kFlickerStep, ++area) {
      AddFlickerOf(row + x, least, ticks, &suspected_[area]);
    }
  }
}

void NoiseFilter::AddFlickerOf(std::size_t corner, std::uint32_t least, std::int64_t ticks, char* suspected) {
  // The common case first: an area of which half flickers does so in one of these rows.
  const auto reaches = [&](int y) {
    return AnyReaches(pixels_.data() + corner + static_cast<std::size_t>(y) * stride_, least);
  };
  if (!reaches(kFlickerSide / 4) && !reaches(3 * kFlickerSide / 4)) {
    *suspected = 0;
    return;
  }
  std::array<std::uint32_t, kFlickerSide * kFlickerSide> busy;
  std::array<std::int64_t, kFlickerSide * kFlickerSide> ages;
  std::size_t count = 0, aged = 0;
  for (int y = 0; y < kFlickerSide; ++y) {
    const std::size_t row = corner + static_cast<std::size_t>(y) * stride_;
    for (std::size_t i = row; i < row + kFlickerSide; ++i) {
      if (CountOf(pixels_[i]) < least) continue;
      busy[count++] = static_cast<std::uint32_t>(i);
      // Those known to flicker, or hot, have no times any more: they do as long as they are as busy.
      if (!(pixels_[i] & kHotBit)) ages[aged++] = (static_cast<std::uint32_t>(ticks) - pixels_[i]) & kTickMask;
    }
  }
  const bool known = count - aged >= kFlickerLeast, suspected_before = *suspected;
  *suspected = count >= kFlickerLeast && AreAlike(ages.data(), aged, kFlickerSpread_us >> tick_shift_);
  if (count < kFlickerLeast || !(known || (suspected_before && *suspected))) return;
  flickering_.insert(flickering_.end(), busy.begin(), busy.begin() + count);
}

void NoiseFilter::UpdateHotPixels() {
  hot_.clear();
  const std::size_t first = stride_, last = static_cast<std::size_t>(stride_) * (height_ + 1);
  for (std::size_t begin = first; begin < last && hot_factor_ > 0; begin += kBlock) {
    // The common case first: quiet pixels need no look at their neighbours.
    const std::size_t end = std::min(begin + kBlock, last);
    if (end - begin == kBlock && !AnyReaches(pixels_.data() + begin, kHotMinCount)) continue;
    for (std::size_t i = begin; i < end; ++i) {
      if (CountOf(pixels_[i]) >= kHotMinCount && IsHot(i)) hot_.push_back(static_cast<std::uint32_t>(i));
    }
  }
  for (std::uint32_t& pixel : pixels_) pixel &= kTickMask;
  for (const std::uint32_t i : hot_) pixels_[i] |= kHotBit;
  for (const std::uint32_t i : flickering_) pixels_[i] |= kHotBit;
  hot_pixels_ = static_cast<int>(hot_.size());
}

void NoiseFilter::ForgetLongAgo(std::int64_t ticks) {
  // After a gap this long, every pixel has been silent for long.
  const bool all = ticks - forgot_ticks_ >= kForgettingPeriod_ticks + kLongAgo_ticks;
  const auto now = static_cast<std::uint32_t>(ticks), long_ago = static_cast<std::uint32_t>(ticks - kLongAgo_ticks);
  for (std::uint32_t& pixel : pixels_) {
    const bool forget = all | (((now - pixel) & kAgeMask) > kLongAgo_ticks);
    pixel = forget ? (pixel & ~kTickMask) | (long_ago & kTickMask) : pixel;
  }
  forgot_ticks_ = ticks;
}

}  // namespace devo
