// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/needed_neighbours.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr NeededNeighbours kAsked{1, 10000, false};

TEST(ChanceOfNeighbours, IsCertaintyWhereNoneIsNeeded) { EXPECT_EQ(ChanceOfNeighbours(0, 5, 10000), 1); }

TEST(ChanceOfNeighbours, OfAllEightIsThatOfOneAsOftenAsThereAreNeighbours) {
  const double one = 1 - std::exp(-0.5);
  EXPECT_NEAR(ChanceOfNeighbours(8, 50, 10000), std::pow(one, 8), 1e-12);
}

TEST(PassingHz, CountsNoiseOfOnePolarityAsIfPolarityWereNotAskedFor) {
  const NeededNeighbours alike{2, 5000, true}, any{2, 5000, false};
  EXPECT_DOUBLE_EQ(PassingHz(alike, 10, 1), PassingHz(any, 10, 1));
  EXPECT_LT(PassingHz(alike, 10, 0.5), 0.4 * PassingHz(any, 10, 0.5));
}

TEST(ChooseNeeded, KeepsWhatIsAskedForWhereThereIsHardlyAnyNoise) {
  const NeededNeighbours needed = ChooseNeeded(kAsked, 0.1, 0.5, true);
  EXPECT_EQ(needed.count, kAsked.count);
  EXPECT_EQ(needed.window_us, kAsked.window_us);
  EXPECT_FALSE(needed.same_polarity);
}

TEST(ChooseNeeded, LeavesEverythingToPassWhereNothingIsAskedForHoweverDenseTheNoise) {
  const NeededNeighbours needed = ChooseNeeded({0, 10000, false}, 100, 0.5, false);
  EXPECT_EQ(needed.count, 0);
  EXPECT_FALSE(needed.same_polarity);
}

TEST(ChooseNeeded, AsksForNoMoreNeighboursThanAPixelHas) {
  EXPECT_EQ(ChooseNeeded({8, 10000, false}, 0.1, 0.5, false).count, 8);
  EXPECT_EQ(ChooseNeeded({8, 100000, false}, 100, 0.5, true).count, 8);
  EXPECT_EQ(ChooseNeeded({7, 10000, false}, 0.1, 0.5, false).count, 8);
}

TEST(ChooseNeeded, TakesTheLongestWindowInWhichNotTooMuchNoisePasses) {
  NeededNeighbours needed = ChooseNeeded(kAsked, 40, 0.5, true);
  EXPECT_EQ(needed.count, 2);
  EXPECT_TRUE(needed.same_polarity);
  EXPECT_LE(PassingHz(needed, 40, 0.5), 0.5);
  ++needed.window_us;
  EXPECT_GT(PassingHz(needed, 40, 0.5), 0.5);
}

}  // namespace
}  // namespace devo
