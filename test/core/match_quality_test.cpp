// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/match_quality.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

/// After a second of poses that match this share.
MatchQuality Used(double share, double rate_hz = 100) {
  MatchQuality quality(rate_hz);
  for (int i = 0; i < rate_hz; ++i) quality.Note(share);
  return quality;
}

TEST(MatchQuality, JudgesByWhatIsUsualHere) {
  const MatchQuality clear = Used(0.9), busy = Used(0.45);
  EXPECT_TRUE(clear.IsSuspicious(0.45));
  EXPECT_FALSE(busy.IsSuspicious(0.45));
  EXPECT_TRUE(clear.IsBad(0.3));
  EXPECT_FALSE(busy.IsBad(0.3));
}

TEST(MatchQuality, FindsNextToNothingBadHoweverUsual) {
  MatchQuality quality(100);
  for (int i = 0; i < 10'000; ++i) quality.Note(0.1);
  EXPECT_FALSE(quality.IsSuspicious(0.1));
  EXPECT_TRUE(quality.IsBad(0.1));
}

TEST(MatchQuality, WeighsPosesThatMatchLessThanUsualLess) {
  const MatchQuality busy = Used(0.4);
  const double usual = busy.usual_share();
  EXPECT_EQ(busy.Weight(0.9), 1) << "none tells more than usual ones";
  EXPECT_NEAR(busy.Weight(0.5 * usual), 0.25, 1e-9);
  EXPECT_GT(busy.Weight(0), 0);
}

TEST(MatchQuality, CountsBadAndSuspiciousPosesUntilOneIsGood) {
  MatchQuality quality = Used(0.9);
  quality.Note(0.5);
  quality.Note(0.05);
  EXPECT_EQ(quality.suspicious_in_a_row(), 2);
  EXPECT_EQ(quality.bad_in_a_row(), 1);
  quality.Note(0.9);
  EXPECT_EQ(quality.suspicious_in_a_row(), 0);
  EXPECT_EQ(quality.bad_in_a_row(), 0);
}

TEST(MatchQuality, LearnsFromFalsePosesMuchMoreSlowly) {
  MatchQuality lost = Used(0.9), worse = Used(0.9);
  const double before = lost.usual_share();
  for (int i = 0; i < 20; ++i) {
    lost.Note(0.5);
    worse.Note(0.7);
  }
  EXPECT_LT(before - lost.usual_share(), 0.5 * (before - worse.usual_share()));
  EXPECT_LT(lost.usual_share(), before);
}

TEST(MatchQuality, LearnsInTheSameTimeAtAnyRate) {
  EXPECT_NEAR(Used(0.9, 30).usual_share(), Used(0.9, 300).usual_share(), 0.02);
}

TEST(MatchQuality, KnowsNothingOfANewMap) {
  MatchQuality quality = Used(0.9);
  quality.ForgetUsual();
  EXPECT_EQ(quality.usual_share(), MatchQuality(100).usual_share());
}

}  // namespace
}  // namespace devo
