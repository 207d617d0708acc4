// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/neighbour_filter.h"

#include <algorithm>

#include "filter_pixel.h"
#include "simd.h"

#ifdef DEVO_AVX2
#include <immintrin.h>
#endif

namespace devo {
namespace {

constexpr std::ptrdiff_t kAhead = 40;  // events: about the time that the third cache takes to answer

/// A neighbour is old that fired longer than `window_ticks` ago; `age_mask`: kTickMask, where it also must have been of
/// the same polarity, else kAgeMask.
struct Age {
  std::uint32_t window_ticks, age_mask;
};

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

/// What events are judged by.
struct Judged {
  std::uint32_t* first;  // of the image's pixels
  int stride, needed;
  TickClock clock;

  std::uint32_t* PixelOf(const Event& e) const { return first + static_cast<std::size_t>(e.y) * stride + e.x; }
};

DEVO_ALWAYS_INLINE std::uint32_t TickOf(Judged by, const Event& event) {
  return static_cast<std::uint32_t>(by.clock.At(event.t_ns)) + (event.polarity ? kOnTicks : 0);
}

/// Writes the positions, counted from `position`, of the events that pass.
template <typename Neighbours>
DEVO_ALWAYS_INLINE std::size_t Judge(Judged by, const Neighbours& neighbours, EventSpan events, std::uint32_t position,
                                     std::uint32_t* passed) {
  std::size_t count = 0;
  const int most_old = kNeighbours - by.needed;
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

}  // namespace

std::size_t PassWithNeighbours(const NeededNeighbours& needed, EventSpan events, std::uint32_t position,
                               PixelMemory* memory, std::uint32_t* passed) {
  const TickClock& clock = memory->clock();
  const Judged judged{memory->words() + memory->PositionOf(0, 0), memory->stride(), needed.count, clock};
  const Age age{needed.window_us >> clock.shift, needed.same_polarity ? kTickMask : kAgeMask};
  if (needed.count == 0) return CountOnly(judged, events, position, passed);
#ifdef DEVO_AVX2
  if (HasAvx2()) return JudgeAvx2(judged, age, events, position, passed);
#endif
  return Judge(judged, OldNeighbours(age), events, position, passed);
}

}  // namespace devo
