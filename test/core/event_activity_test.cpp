// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/event_activity.h"

#include <vector>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr double kStill_hz = 0.15;

void Note(double activity_hz, double flow_px_s, EventActivity* activity) {
  activity->Note(activity_hz, activity_hz < kStill_hz, flow_px_s);
}

/// A camera that has made 0.04 events per pixel of motion, at 250 px/s.
EventActivity Moving(double rate_hz = 100) {
  EventActivity activity(rate_hz, kStill_hz);
  for (int k = 0; k < rate_hz; ++k) Note(10, 250, &activity);
  return activity;
}

bool EndedSuddenlyAfter(EventActivity activity, const std::vector<double>& activities_hz) {
  for (const double activity_hz : activities_hz) Note(activity_hz, 0, &activity);
  return activity.EndedSuddenly();
}

TEST(FlowAcrossEdges, IsThatOfTheEdgesBeforeTheCameraAcrossThemselves) {
  const Camera camera(640, 480, 500, 500, 319.5, 239.5, "none", {});
  MapPoint upright, lying, unseen;
  upright.p_ref = lying.p_ref = {0, 0, 2};
  upright.normal_ref = unseen.normal_ref = {1, 0, 0};
  lying.normal_ref = {0, 1, 0};
  unseen.p_ref = {0, 0, -2};
  Vector6d sideways = Vector6d::Zero(), turning = Vector6d::Zero();
  sideways[0] = 0.2;
  turning[4] = -0.1;  // makes up for it
  EXPECT_NEAR(FlowAcrossEdges({upright, unseen}, Rigid3(), sideways, camera), 50, 1e-3);
  EXPECT_NEAR(FlowAcrossEdges({upright, lying}, Rigid3(), sideways, camera), 25, 1e-3);
  EXPECT_NEAR(FlowAcrossEdges({upright, lying}, Rigid3(), sideways + turning, camera), 0, 1e-3);
  EXPECT_EQ(FlowAcrossEdges({unseen}, Rigid3(), sideways, camera), 0);
}

// Rates are means over 20 ms: those of events that end at once fall over two surfaces.
TEST(EventActivity, TellsMissingEventsFromAHardStop) {
  EXPECT_TRUE(EndedSuddenlyAfter(Moving(), {9.5}));
  EXPECT_TRUE(EndedSuddenlyAfter(Moving(), {5.5, 0.3}));
  EXPECT_TRUE(EndedSuddenlyAfter(Moving(), {9, 7, 4, 0.5})) << "while it slows down";
  // From 1.5 m/s at 2.5 m within 60 ms.
  EXPECT_FALSE(EndedSuddenlyAfter(Moving(), {9, 6.5, 3.5, 1.2, 0.2}));
}

TEST(EventActivity, TellsThemAtOtherRatesOfSurfacesToo) {
  EXPECT_TRUE(EndedSuddenlyAfter(Moving(50), {0.5}));
  EXPECT_FALSE(EndedSuddenlyAfter(Moving(50), {6.5, 1.2, 0.1}));
  EXPECT_TRUE(EndedSuddenlyAfter(Moving(200), {7.5, 5, 2.5}));
  EXPECT_FALSE(EndedSuddenlyAfter(Moving(200), {9, 8, 6.5, 5, 3.5, 2.2, 1.2, 0.6, 0.2}));
}

TEST(EventActivity, TakesTheEndOfAHandfulOfEventsForAStop) {
  EventActivity activity(100, kStill_hz);
  for (int k = 0; k < 100; ++k) Note(2 * kStill_hz, 10, &activity);
  EXPECT_FALSE(activity.EndedSuddenly());
}

/// After one more still surface, 10 ms after the one before.
bool RulesOutMotionOf(double flow_px_s, EventActivity* activity) {
  activity->NoteUnseen(flow_px_s, 0.01);
  return activity->RulesOutMotion();
}

TEST(EventActivity, RulesOutAMotionThatWouldHaveMadeEventsOnceItHasPassedTheWidthOfAnEdge) {
  EventActivity activity = Moving();
  EXPECT_FALSE(RulesOutMotionOf(60, &activity));
  EXPECT_FALSE(RulesOutMotionOf(60, &activity));
  EXPECT_TRUE(RulesOutMotionOf(60, &activity)) << "after 1.8 px";
  Note(10, 250, &activity);
  EXPECT_FALSE(RulesOutMotionOf(60, &activity)) << "it has moved since";
}

TEST(EventActivity, DoesNotRuleOutAMotionThatMakesHardlyMoreEventsThanAStandstill) {
  EventActivity activity = Moving();
  for (int k = 0; k < 100; ++k) ASSERT_FALSE(RulesOutMotionOf(15, &activity)) << k;
}

TEST(EventActivity, TellsHowFastEdgesMustMoveToShow) {
  EXPECT_FALSE(Moving().WouldShow(15));
  EXPECT_TRUE(Moving().WouldShow(30));
  EXPECT_FALSE(EventActivity(100, kStill_hz).WouldShow(1000)) << "before any motion has been seen";
}

TEST(EventActivity, RulesOutNothingBeforeAnyMotionWasSeen) {
  EventActivity activity(100, kStill_hz);
  for (int k = 0; k < 100; ++k) {
    Note(10, 0, &activity);
    ASSERT_FALSE(RulesOutMotionOf(1000, &activity)) << k;
  }
}

}  // namespace
}  // namespace devo
