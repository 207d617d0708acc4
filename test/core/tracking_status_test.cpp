// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/tracking_status.h"

#include <gtest/gtest.h>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kRate_hz = 100;
constexpr TrackingStatus::Leads kByEvents{false, false, false, false}, kByInertial{true, false, false, false};
constexpr TrackingStatus::Leads kByInertialThatFits{true, true, false, false};
constexpr TrackingStatus::Leads kByDepth{false, false, true, true}, kByDepthThatReplaced{false, false, true, false};

/// For this time.
void Match(double inlier_share, double span_s, const TrackingStatus::Leads& by, TrackingStatus* status) {
  for (int i = 0; i < CountIn(span_s, kRate_hz); ++i) status->NoteMatch(inlier_share, by);
}

/// After a second of poses that match 0.8, from a first map at time 0.
TrackingStatus Tracking() {
  TrackingStatus status(kRate_hz);
  status.NoteNewView(0);
  Match(0.8, 1, kByEvents, &status);
  status.WantsSearch(NsFromSeconds(1), 0.8, false);
  return status;
}

TEST(TrackingStatus, IsInitialisingUntilTheFirstPose) {
  TrackingStatus status(kRate_hz);
  EXPECT_EQ(status.state(), TrackingState::kInitialising);
  status.NoteStandstill();
  EXPECT_EQ(status.state(), TrackingState::kTracking);
}

TEST(TrackingStatus, IsDegradedAtOnceAndLostAfterAWhileWithoutMatches) {
  TrackingStatus status = Tracking();
  EXPECT_TRUE(status.trusted());
  status.NoteMatch(0, kByEvents);
  EXPECT_EQ(status.state(), TrackingState::kDegraded);
  EXPECT_TRUE(status.doubtful());
  EXPECT_FALSE(status.MatchesNothing());
  Match(0, 0.1, kByEvents, &status);
  EXPECT_EQ(status.state(), TrackingState::kDegraded);
  EXPECT_TRUE(status.MatchesNothing());
  Match(0, 0.1, kByEvents, &status);
  EXPECT_TRUE(status.lost());
}

TEST(TrackingStatus, IsBridgedByAnInertialSensorForLongerTheMoreItKnows) {
  TrackingStatus by_gyroscope = Tracking(), by_both = Tracking();
  Match(0, 0.5, kByInertial, &by_gyroscope);
  Match(0, 1.1, kByInertialThatFits, &by_both);
  EXPECT_EQ(by_gyroscope.state(), TrackingState::kDegraded);
  EXPECT_EQ(by_both.state(), TrackingState::kDegraded);
  Match(0, 0.1, kByInertial, &by_gyroscope);
  Match(0, 0.1, kByInertialThatFits, &by_both);
  EXPECT_TRUE(by_gyroscope.lost());
  EXPECT_TRUE(by_both.lost());
}

TEST(TrackingStatus, IsNotLostWhereDepthAgrees) {
  TrackingStatus status = Tracking();
  Match(0, 5, kByDepth, &status);
  EXPECT_EQ(status.state(), TrackingState::kDegraded);
}

TEST(TrackingStatus, IsFoundByDepthOnlyWhereThatHasReplacedNoPose) {
  TrackingStatus status = Tracking();
  Match(0, 1, kByEvents, &status);
  status.NoteMatch(0, kByDepthThatReplaced);
  EXPECT_TRUE(status.lost());
  status.NoteMatch(0, kByDepth);
  EXPECT_EQ(status.state(), TrackingState::kDegraded);
}

TEST(TrackingStatus, IsRecoveredForOnePose) {
  TrackingStatus status = Tracking();
  Match(0, 1, kByEvents, &status);
  status.NoteMatch(0.8, kByEvents);
  EXPECT_EQ(status.state(), TrackingState::kRecovered);
  status.NoteMatch(0.8, kByEvents);
  EXPECT_EQ(status.state(), TrackingState::kTracking);
}

TEST(TrackingStatus, KnowsSinceWhenItSeesNothingAndThatAStandstillIsNoLoss) {
  TrackingStatus status = Tracking();
  status.NoteSurface(NsFromSeconds(1), false);
  Match(0, 1, kByEvents, &status);
  status.NoteSurface(NsFromSeconds(2), false);
  EXPECT_DOUBLE_EQ(status.UnseenFor_s(NsFromSeconds(2.5)), 1.5);
  status.NoteSurface(NsFromSeconds(2.5), true);
  EXPECT_DOUBLE_EQ(status.UnseenFor_s(NsFromSeconds(3)), 0.5);
}

TEST(TrackingStatus, IsNotAstrayWhereAViewHasJustBegun) {
  TrackingStatus status = Tracking();
  Match(0, 1, kByEvents, &status);
  EXPECT_TRUE(status.IsAstray());
  status.NoteNewView(NsFromSeconds(2));
  EXPECT_TRUE(status.lost());
  EXPECT_FALSE(status.IsAstray());
}

TEST(TrackingStatus, SeeksABetterPoseAtOnceInANewViewUnlessThePoseIsKnownThere) {
  TrackingStatus sought(kRate_hz), known(kRate_hz);
  sought.NoteNewView(0);
  known.NoteNewView(0);
  known.NoteKnown();
  EXPECT_TRUE(sought.WantsSearch(0, 0.8, false));
  EXPECT_FALSE(sought.WantsSearch(0, 0.8, false)) << "once is enough";
  EXPECT_FALSE(known.WantsSearch(0, 0.8, false));
}

TEST(TrackingStatus, SeeksABetterPoseEveryFewSurfacesThatMatchLessThanUsual) {
  TrackingStatus status = Tracking();
  int searches = 0;
  for (int i = 0; i < 20; ++i) {
    searches += status.WantsSearch(NsFromSeconds(1 + i / kRate_hz), 0.4, false);
    status.NoteMatch(0.4, kByEvents);
  }
  EXPECT_EQ(searches, 5);
}

TEST(TrackingStatus, DoesNotDoubtAnInertialSensorForAFewMatchesLess) {
  TrackingStatus status = Tracking();
  for (int i = 0; i < 20; ++i) {
    EXPECT_FALSE(status.WantsSearch(NsFromSeconds(1 + i / kRate_hz), 0.4, true));
    status.NoteMatch(0.4, kByInertial);
  }
}

TEST(TrackingStatus, SeeksABetterPoseWhereEventsComeBackAfterAGap) {
  TrackingStatus status = Tracking();
  status.NoteGuess();
  status.NoteMatch(0, kByInertial);
  EXPECT_TRUE(status.WantsSearch(NsFromSeconds(2), 0.4, true));
  EXPECT_FALSE(status.WantsSearch(NsFromSeconds(2.02), 0.4, true)) << "the next surface hardly shows it better";
  EXPECT_TRUE(status.WantsSearch(NsFromSeconds(2.05), 0.4, true));
  status.NoteFound();
  EXPECT_FALSE(status.WantsSearch(NsFromSeconds(2.2), 0.4, true));
}

}  // namespace
}  // namespace devo
