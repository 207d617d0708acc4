// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/manoeuvre.h"

#include <limits>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr double kStep_s = 0.01;

Manoeuvre After(double seconds, double moved_square, double acceleration_square) {
  Manoeuvre manoeuvre;
  for (double t = 0; t < seconds; t += kStep_s) manoeuvre.Note(kStep_s, moved_square, acceleration_square);
  return manoeuvre;
}

TEST(Manoeuvre, ExpectsTheMostLivelyMotionBeforeAnythingIsKnown) { EXPECT_EQ(Manoeuvre().variance_share(), 1); }

TEST(Manoeuvre, ExpectsLittleOfACalmMotionWithinASecondAndNeverNothing) {
  EXPECT_LT(After(1, 0.01, 1e-5).variance_share(), 0.1);
  EXPECT_GT(After(60, 0, 0).variance_share(), 0.05);
}

TEST(Manoeuvre, StaysLivelyWhereThePosesSurpriseOrTheAccelerationFoundIsLarge) {
  EXPECT_EQ(After(1, 0.5, 0).variance_share(), 1);
  EXPECT_EQ(After(1, 0.01, 0.05).variance_share(), 1);
}

TEST(Manoeuvre, ExpectsMoreThanOptionsSayWhereAccelerationsFoundAreAsLargeWithinBounds) {
  EXPECT_NEAR(After(1, 0.01, 2).variance_share(), 2.8, 0.01);
  EXPECT_NEAR(After(1, 0.01, 100).variance_share(), 4, 0.01);
}

TEST(Manoeuvre, TakesSurprisesForNoiseBeforeForAMotionThatIsLivelierThanOptionsSay) {
  EXPECT_EQ(After(1, 100, 0.4).variance_share(), 1);
}

TEST(Manoeuvre, ForgetsALivelyMotionWithinASecond) {
  Manoeuvre manoeuvre = After(1, 0.01, 100);
  for (double t = 0; t < 1; t += kStep_s) manoeuvre.Note(kStep_s, 0.5, 0.01);
  EXPECT_LT(manoeuvre.variance_share(), 1.1);
}

TEST(Manoeuvre, ExpectsMuchAgainWithinAFewPosesOfASurprise) {
  Manoeuvre manoeuvre = After(2, 0.01, 1e-5);
  for (int i = 0; i < 4; ++i) manoeuvre.Note(kStep_s, 20, 1e-5);
  EXPECT_GT(manoeuvre.variance_share(), 0.8);
}

TEST(Manoeuvre, IsNotMovedByWhatIsNoNumberNorByNoTime) {
  Manoeuvre manoeuvre = After(0.2, 0.01, 1e-5);
  const double before = manoeuvre.variance_share();
  manoeuvre.Note(kStep_s, std::numeric_limits<double>::quiet_NaN(), 0);
  manoeuvre.Note(0, 100, 1);
  EXPECT_EQ(manoeuvre.variance_share(), before);
}

}  // namespace
}  // namespace devo
