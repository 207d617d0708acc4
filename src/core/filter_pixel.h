// SPDX-License-Identifier: BSD-3-Clause
//
// The word that a noise filter keeps of each pixel (PixelMemory), and how many events several of them had.
#pragma once

#include <cstdint>

#include "simd.h"

namespace devo {

// A pixel is one word: in the lower bits the tick at which it last fired, wrapping, half the range later for an ON
// event; in the upper bits how many events it had in this period, and whether it is hot. An event reads nine of them,
// so that their size decides the cost. As no age exceeds kAgeMask, an event of the other polarity has an age beyond it,
// or, with that bit masked out, its own.
constexpr std::uint32_t kTickMask = 0x1FFFF, kAgeMask = 0xFFFF, kOnTicks = 0x10000;
constexpr std::uint32_t kOneEvent = 0x20000, kCountMask = 0x7FFE0000, kHotBit = 0x80000000;
constexpr int kMostEvents = kCountMask / kOneEvent;

constexpr int kBlock = 16;  // pixels that are looked at together, in a row or in both directions

inline std::uint32_t CountOf(std::uint32_t pixel) { return (pixel & kCountMask) / kOneEvent; }

inline std::uint32_t Counted(std::uint32_t pixel) {
  return pixel + ((pixel & kCountMask) < kCountMask ? kOneEvent : 0);
}

DEVO_ALWAYS_INLINE std::uint32_t Fired(std::uint32_t pixel, std::uint32_t tick) {
  return (Counted(pixel) & ~kTickMask) | (tick & kTickMask);
}

/// -1 for each of the four pixels from `pixel` on that had more than `count` events.
inline cv::v_int32x4 Above(const std::uint32_t* pixel, std::uint32_t count) {
  const cv::v_uint32x4 counts = cv::v_load(pixel) & cv::v_setall_u32(kCountMask);
  return cv::v_reinterpret_as_s32(counts) > cv::v_setall_s32(static_cast<int>(count * kOneEvent));
}

/// Of the eight neighbours of a pixel, in an image whose rows are `stride` long, how many had more than `count` events.
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

}  // namespace devo
