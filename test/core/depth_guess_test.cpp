// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_guess.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

const Camera kCamera(160, 120, 120, 120, 79.5, 59.5, "", {});

ReferenceMap::Visible PointAt(float u, float v, float z_m) { return {0, 0, {0, 0, z_m}, u, v, 1, 0}; }

TEST(DepthGuess, KnowsWhereThereArePointsOfTheMap) {
  const DepthGuess guess({PointAt(20, 100, 2)}, kCamera);
  EXPECT_TRUE(guess.IsKnown(30, 110));
  EXPECT_FALSE(guess.IsKnown(40, 110));
  EXPECT_FALSE(guess.IsKnown(159, 119)) << "the last cell is not a whole one";
}

TEST(DepthGuess, IsTheMeanInverseDepthAroundTheNearestFirst) {
  const std::vector<ReferenceMap::Visible> one = {PointAt(10, 10, 1), PointAt(12, 10, 3)};
  EXPECT_NEAR(DepthGuess(one, kCamera).At(150, 110), 1.5, 1e-5);
  std::vector<ReferenceMap::Visible> both = one;
  both.push_back(PointAt(150, 10, 8));
  both.push_back(PointAt(152, 10, 8));
  DepthGuess guess(both, kCamera);
  const float near_left = guess.At(45, 10), near_right = guess.At(115, 10);
  EXPECT_GT(near_left, 1.5);
  EXPECT_LT(near_left, 1.7);
  EXPECT_GT(near_right, 6);
  EXPECT_LT(near_right, 8);
  EXPECT_EQ(guess.At(50, 20), near_left) << "one for each cell";
}

TEST(DepthGuess, IsNoneWhereNothingIsKnown) { EXPECT_EQ(DepthGuess({}, kCamera).At(80, 60), 0); }

}  // namespace
}  // namespace devo
