// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/flicker_detector.h"

#include <gtest/gtest.h>

#include "firing.h"

namespace devo {
namespace {

constexpr int kSide = 48;
constexpr std::int64_t kStep_ns = 5'000'000;
constexpr int kSteps = 50;  // of a period
constexpr double kPeriod_s = 0.25;

struct Image {
  PixelMemory memory{kSide, kSide, 10000};
  FlickerDetector detector{kSide, kSide};
  std::int64_t t_ns = 1'000'000'000;

  /// How many pixels are found after a period in which the first `width` columns fire together, every 5 ms.
  std::size_t FoundAfter(int width) {
    for (int k = 0; k < kSteps; ++k, t_ns += kStep_ns) {
      Fire(t_ns, kSide - 1, kSide - 1, k % 2 == 0, &memory);
      for (int i = 0; i < width * kSide; ++i) Fire(t_ns, i % width, i / width, k % 2 == 0, &memory);
    }
    detector.Find(memory, t_ns, kPeriod_s);
    memory.BeginPeriod();
    return detector.pixels().size();
  }
};

TEST(FlickerDetector, FindsAnAreaInTheSecondPeriodInARow) {
  Image image;
  EXPECT_EQ(image.FoundAfter(16), 0U);
  EXPECT_GE(image.FoundAfter(16), 16U * kSide);
}

TEST(FlickerDetector, StartsAnewAfterAPeriodWithoutFlicker) {
  Image image;
  image.FoundAfter(16);
  EXPECT_EQ(image.FoundAfter(0), 0U);
  EXPECT_EQ(image.FoundAfter(16), 0U);
}

TEST(FlickerDetector, LeavesOutWhatFillsLessThanHalfOfAnArea) {
  Image image;
  image.FoundAfter(7);
  EXPECT_EQ(image.FoundAfter(7), 0U);
}

TEST(FlickerDetector, KeepsPixelsThatAreHotForAsLongAsTheyAreAsBusy) {
  Image image;
  image.FoundAfter(16);
  image.FoundAfter(16);
  image.memory.MarkHot(image.detector.pixels());  // from now on they have no times
  EXPECT_GE(image.FoundAfter(16), 16U * kSide);
  image.memory.MarkHot(image.detector.pixels());
  EXPECT_EQ(image.FoundAfter(0), 0U);
}

TEST(FlickerDetector, KnowsNothingAfterClearing) {
  Image image;
  image.FoundAfter(16);
  image.detector.Clear();
  EXPECT_EQ(image.FoundAfter(16), 0U);
}

}  // namespace
}  // namespace devo
