// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/residual_scale.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

double ScaleAfter(double span_s, double residual_px, double flow_px_s, double period_s = 0.01) {
  ResidualScale scale;
  for (double t_s = 0; t_s < span_s; t_s += period_s) scale.Note(period_s, residual_px, flow_px_s);
  return scale.variance_scale();
}

TEST(ResidualScale, IsOneBeforeAnythingIsKnown) {
  EXPECT_EQ(ResidualScale().variance_scale(), 1);
  ResidualScale scale;
  scale.Note(0, 0.5, 300);
  EXPECT_EQ(scale.variance_scale(), 1);
}

TEST(ResidualScale, GrowsWithTheSquareOfTheMissAndWithTheSpeedOfTheEdges) {
  EXPECT_NEAR(ScaleAfter(1, 0.5, 100) / ScaleAfter(1, 0.25, 100), 4, 1e-6);
  EXPECT_GT(ScaleAfter(1, 0.25, 300), 1.5 * ScaleAfter(1, 0.25, 100));
}

TEST(ResidualScale, IsTheSameAtAllSurfaceRates) {
  EXPECT_NEAR(ScaleAfter(1, 0.4, 150, 0.002), ScaleAfter(1, 0.4, 150, 0.02), 1e-6);
}

TEST(ResidualScale, ForgetsWhatWasSecondsAgo) {
  ResidualScale scale;
  for (int i = 0; i < 300; ++i) scale.Note(0.01, 0.6, 300);
  for (int i = 0; i < 500; ++i) scale.Note(0.01, 0.26, 100);
  EXPECT_NEAR(scale.variance_scale(), 1, 0.1);
}

TEST(ResidualScale, StaysBoundedWhateverIsSeen) {
  EXPECT_EQ(ScaleAfter(2, NAN, 100), 1);
  EXPECT_GE(ScaleAfter(2, 0, 0), 0.25 - 1e-9);
  EXPECT_LE(ScaleAfter(2, 1e9, 1e9), 10 + 1e-9);
}

}  // namespace
}  // namespace devo
