// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_repeats.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

cv::Mat1f Image() {
  cv::Mat1f depth_m(4, 6);
  for (int k = 0; k < 24; ++k) depth_m(k / 6, k % 6) = 1 + 0.01F * static_cast<float>(k);
  return depth_m;
}

/// Knows all directions but that along x.
DepthPose Shown() {
  DepthPose pose;
  pose.information = 1e6 * Matrix6d::Identity();
  pose.information(0, 0) = 0;
  return pose;
}

DepthRepeats AfterOne() {
  DepthRepeats repeats;
  repeats.Note(Image(), Rigid3::Translation({1, 2, 3}), Shown());
  return repeats;
}

TEST(DepthRepeats, AnImageThatComesAgainThoughTheCameraHasMovedIsARepeat) {
  const DepthRepeats repeats = AfterOne();
  EXPECT_TRUE(repeats.IsRepeat(Image(), Rigid3::Translation({1, 2, 3.01})));
  cv::Mat1f other = Image();
  other(3, 5) += 1e-4F;
  EXPECT_FALSE(repeats.IsRepeat(other, Rigid3::Translation({1, 2, 3.01})));
  EXPECT_FALSE(repeats.IsRepeat(Image().rowRange(0, 3), Rigid3::Translation({1, 2, 3.01})));
}

TEST(DepthRepeats, WithoutNoiseACameraThatStandsSeesTheSameAgain) {
  EXPECT_FALSE(AfterOne().IsRepeat(Image(), Rigid3::Translation({1, 2, 3.0005})));
}

TEST(DepthRepeats, WithoutNoiseACameraThatMovesAlongAWallSeesTheSameAgain) {
  EXPECT_FALSE(AfterOne().IsRepeat(Image(), Rigid3::Translation({1.2, 2, 3})));
}

TEST(DepthRepeats, TheFirstImageAndOneAfterAnEndAreNone) {
  DepthRepeats repeats = AfterOne();
  repeats.Clear();
  EXPECT_FALSE(repeats.IsRepeat(Image(), Rigid3()));
  EXPECT_FALSE(DepthRepeats().IsRepeat(Image(), Rigid3()));
}

}  // namespace
}  // namespace devo
