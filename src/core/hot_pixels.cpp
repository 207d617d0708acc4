// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/hot_pixels.h"

#include <algorithm>

#include "filter_pixel.h"

namespace devo {
namespace {

constexpr std::uint32_t kHotMinCount = 8;

bool IsHot(const std::uint32_t* pixel, int stride, double factor) {
  // More than the factor times the median of its neighbours and a quarter, that is: of eight, five are quiet enough.
  // The median, not the mean: two hot pixels side by side must not excuse each other.
  const std::uint32_t count = CountOf(*pixel);
  const auto stands_out = [&](int quiet) { return count > factor * (quiet + 0.25); };
  int quiet = static_cast<int>(std::min<double>(count / factor, kMostEvents));
  while (quiet >= 0 && !stands_out(quiet)) --quiet;
  return quiet >= 0 && NeighboursAbove(pixel, stride, static_cast<std::uint32_t>(quiet)) <= 3;
}

}  // namespace

void FindHotPixels(const PixelMemory& memory, double factor, std::vector<std::uint32_t>* hot) {
  hot->clear();
  if (!(factor > 0)) return;
  const std::uint32_t* const words = memory.words();
  const int stride = memory.stride();
  const std::size_t first = stride, last = static_cast<std::size_t>(stride) * (memory.height() + 1);
  for (std::size_t begin = first; begin < last; begin += kBlock) {
    // The common case first: quiet pixels need no look at their neighbours.
    const std::size_t end = std::min(begin + kBlock, last);
    if (end - begin == kBlock && !AnyReaches(words + begin, kHotMinCount)) continue;
    for (std::size_t i = begin; i < end; ++i) {
      if (CountOf(words[i]) >= kHotMinCount && IsHot(words + i, stride, factor)) {
        hot->push_back(static_cast<std::uint32_t>(i));
      }
    }
  }
}

}  // namespace devo
