// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/hot_pixels.h"

#include <gtest/gtest.h>

#include "firing.h"

namespace devo {
namespace {

/// Of an image in which the pixel (9, 9) fires so many times, and `neighbours` of its eight once each.
std::vector<std::uint32_t> HotOf(int events, int neighbours, double factor) {
  PixelMemory memory(20, 20, 10000);
  for (int k = 0; k < events; ++k) Fire(k, 9, 9, true, &memory);
  for (int k = 0; k < neighbours; ++k) Fire(events, 8 + k % 3, k < 3 ? 8 : 10, true, &memory);
  std::vector<std::uint32_t> hot{0};  // of an image before
  FindHotPixels(memory, factor, &hot);
  for (const std::uint32_t pixel : hot) EXPECT_EQ(pixel, memory.PositionOf(9, 9));
  return hot;
}

TEST(FindHotPixels, FindsAPixelAmongSilentOnesThatHadAFewEvents) {
  EXPECT_EQ(HotOf(8, 0, 20).size(), 1U);
  EXPECT_TRUE(HotOf(7, 0, 20).empty());
}

TEST(FindHotPixels, ComparesWithTheMedianOfTheNeighboursWhichThreeBusyOnesDoNotRaise) {
  EXPECT_EQ(HotOf(25, 3, 20).size(), 1U);
  EXPECT_TRUE(HotOf(25, 4, 20).empty());
  EXPECT_EQ(HotOf(26, 4, 20).size(), 1U);
}

TEST(FindHotPixels, FindsNoneWithoutAFactor) { EXPECT_TRUE(HotOf(100, 0, 0).empty()); }

}  // namespace
}  // namespace devo
