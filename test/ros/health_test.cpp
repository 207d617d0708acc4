// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace devo {
namespace {

using diagnostic_msgs::DiagnosticStatus;

KnownTopics Known() { return {{"/dvs/events", "dvs_msgs/EventArray"}, {"/depth", "sensor_msgs/Image"}}; }

TEST(Failures, AreNamedForAWhileAndCountedForGood) {
  Failures failures(0.05);
  diagnostic_updater::DiagnosticStatusWrapper status;
  EXPECT_FALSE(failures.Fill(status));
  failures.Add("depth image has encoding 'mono16'");
  EXPECT_TRUE(failures.Fill(status));
  EXPECT_EQ(status.level, DiagnosticStatus::ERROR);
  EXPECT_EQ(status.message, "depth image has encoding 'mono16'");
  ros::WallDuration(0.1).sleep();
  diagnostic_updater::DiagnosticStatusWrapper later;
  EXPECT_FALSE(failures.Fill(later));
  EXPECT_EQ(later.level, DiagnosticStatus::OK);
  ASSERT_EQ(later.values.size(), 1U);
  EXPECT_EQ(later.values[0].value, "1");
}

TEST(Input, NamesTheTopicThatIsMissingAndWhatExistsInstead) {
  const Input events("events", "/events", "EventArray", Input::Kind::kSteady);
  EXPECT_EQ(events.MissingSentence(Known()),
            "No events on /events (EventArray): nobody publishes it; EventArray topics that exist: /dvs/events.");
  const Input wrong("events", "/depth", "EventArray", Input::Kind::kSteady);
  EXPECT_THAT(wrong.MissingSentence(Known()), testing::HasSubstr("it is published as sensor_msgs/Image"));
  Input depth("depth", "/depth", "Image", Input::Kind::kSteady);
  EXPECT_THAT(depth.MissingSentence(Known()), testing::HasSubstr("it is advertised but nothing comes"));
  depth.Arrived(1);
  EXPECT_EQ(depth.MissingSentence(Known()), "");
}

TEST(Input, DoesNotCallATopicSilentOfWhichTheMessagesAreEmptyOrNotRead) {
  Input events("events", "/dvs/events", "EventArray", Input::Kind::kSteady);
  events.ArrivedEmpty();
  EXPECT_EQ(events.MissingSentence(Known()), "No events on /dvs/events (EventArray): its messages come but hold none.");
  events.ArrivedUnread();
  EXPECT_EQ(events.MissingSentence(Known()), "");
  diagnostic_updater::DiagnosticStatusWrapper status;
  events.Fill(status);
  EXPECT_EQ(status.values.at(1).key, "events messages");
  EXPECT_EQ(status.values.at(1).value, "2");
}

TEST(Input, IsNoErrorToLackWhereItIsOptionalButNamedAlike) {
  Input imu("IMU samples", "/imu", "Imu", Input::Kind::kOptional);
  EXPECT_EQ(imu.MissingSentence(Known()), "No IMU samples on /imu (Imu): nobody publishes it, nor any other Imu.");
  EXPECT_EQ(imu.LevelOfMissing(), DiagnosticStatus::WARN);
  imu.Arrived(1);
  EXPECT_EQ(imu.MissingSentence(Known()), "");
  EXPECT_EQ(Input("depth", "/depth", "Image", Input::Kind::kSteady).LevelOfMissing(), DiagnosticStatus::ERROR);
}

TEST(Input, TakesATopicOfAnyOfItsTypesForRight) {
  const KnownTopics known = {{"/packets", "event_camera_msgs/EventPacket"}, {"/arrays", "dvs_msgs/EventArray"}};
  const Input silent("events", "/packets", "EventArray or EventPacket", Input::Kind::kSteady);
  EXPECT_THAT(silent.MissingSentence(known), testing::HasSubstr("it is advertised but nothing comes"));
  const Input missing("events", "/events", "EventArray or EventPacket", Input::Kind::kSteady);
  EXPECT_THAT(missing.MissingSentence(known), testing::HasSubstr("topics that exist: /packets, /arrays"));
}

}  // namespace
}  // namespace devo
