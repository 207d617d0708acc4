// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/flicker_detector.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "filter_pixel.h"

namespace devo {
namespace {

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

}  // namespace

FlickerDetector::FlickerDetector(int width, int height) {
  const auto areas = [](int side) {
    return static_cast<std::size_t>(std::max(side - kFlickerSide, -kFlickerStep) / kFlickerStep + 1);
  };
  suspected_.assign(areas(width) * areas(height), 0);
}

void FlickerDetector::Find(const PixelMemory& memory, std::int64_t t_ns, double span_s) {
  pixels_.clear();
  const auto least = static_cast<std::uint32_t>(kFlicker_hz * span_s);
  std::size_t area = 0;
  for (int y = 0; y + kFlickerSide <= memory.height(); y += kFlickerStep) {
    for (int x = 0; x + kFlickerSide <= memory.width(); x += kFlickerStep, ++area) {
      AddPixelsOf(memory, memory.PositionOf(x, y), least, memory.clock().At(t_ns), &suspected_[area]);
    }
  }
}

void FlickerDetector::AddPixelsOf(const PixelMemory& memory, std::size_t corner, std::uint32_t least,
                                  std::int64_t ticks, char* suspected) {
  const std::uint32_t* const words = memory.words();
  // The common case first: an area of which half flickers does so in one of these rows.
  const auto reaches = [&](int y) {
    return AnyReaches(words + corner + static_cast<std::size_t>(y) * memory.stride(), least);
  };
  if (!reaches(kFlickerSide / 4) && !reaches(3 * kFlickerSide / 4)) {
    *suspected = 0;
    return;
  }
  std::array<std::uint32_t, kFlickerSide * kFlickerSide> busy;
  std::array<std::int64_t, kFlickerSide * kFlickerSide> ages;
  std::size_t count = 0, aged = 0;
  for (int y = 0; y < kFlickerSide; ++y) {
    const std::size_t row = corner + static_cast<std::size_t>(y) * memory.stride();
    for (std::size_t i = row; i < row + kFlickerSide; ++i) {
      if (CountOf(words[i]) < least) continue;
      busy[count++] = static_cast<std::uint32_t>(i);
      // Those known to flicker, or hot, have no times any more: they do as long as they are as busy.
      if (!(words[i] & kHotBit)) ages[aged++] = (static_cast<std::uint32_t>(ticks) - words[i]) & kTickMask;
    }
  }
  const bool known = count - aged >= kFlickerLeast, suspected_before = *suspected;
  *suspected = count >= kFlickerLeast && AreAlike(ages.data(), aged, kFlickerSpread_us >> memory.clock().shift);
  if (count < kFlickerLeast || !(known || (suspected_before && *suspected))) return;
  pixels_.insert(pixels_.end(), busy.begin(), busy.begin() + count);
}

void FlickerDetector::Clear() {
  pixels_.clear();
  std::fill(suspected_.begin(), suspected_.end(), 0);
}

}  // namespace devo
