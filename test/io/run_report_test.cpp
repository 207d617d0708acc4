// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/run_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace devo {
namespace {

PoseEstimate PoseAtTick(int tick, TrackingState state) {
  PoseEstimate estimate;
  estimate.t_ns = tick * 10000000LL;
  estimate.state = state;
  return estimate;
}

TEST(RunReport, CountsLostIntervalsAndLeavesLostPosesOutOfTheTrajectory) {
  RunReport report(100);
  report.AddPose(PoseAtTick(0, TrackingState::kInitialising));
  for (int tick = 1; tick <= 5; ++tick) report.AddPose(PoseAtTick(tick, TrackingState::kTracking));
  for (int tick = 6; tick <= 8; ++tick) report.AddPose(PoseAtTick(tick, TrackingState::kLost));
  report.AddPose(PoseAtTick(9, TrackingState::kRecovered));
  report.AddPose(PoseAtTick(10, TrackingState::kDegraded));
  EXPECT_EQ(report.trajectory().size(), 7U);
  ASSERT_EQ(report.lost_intervals().size(), 1U);
  EXPECT_EQ(report.lost_intervals()[0].begin_ns, 60000000);
  EXPECT_EQ(report.lost_intervals()[0].end_ns, 90000000);
  EXPECT_NEAR(report.Coverage(100000000), 0.7, 1e-9);
}

TEST(RunReport, CountsMissingTicksUpToTheEndOfTheEvents) {
  RunReport report(100);
  for (int tick = 0; tick < 50; ++tick) report.AddPose(PoseAtTick(tick, TrackingState::kTracking));
  EXPECT_NEAR(report.Coverage(490000000), 1, 1e-9);
  EXPECT_NEAR(report.Coverage(990000000), 0.5, 1e-9);
  EXPECT_EQ(RunReport(100).Coverage(1000000000), 0);
}

TEST(RunReport, HoldsWhatTheContractNames) {
  RunReport report(100);
  report.timings.tracking_ms = {1, 2, 3, 4};
  report.timings.surface_ms = {4, 3, 2, 5};
  report.counters.events.in = 10;
  report.counters.events.outside = 3;
  report.end_ns = 2000000000;
  report.wall_s = 0.5;
  const auto json = nlohmann::json::parse(report.ToJson());
  EXPECT_EQ(json["milliseconds"]["tracking"]["p50"], 2);
  EXPECT_EQ(json["milliseconds"]["tracking"]["max"], 4);
  EXPECT_EQ(json["milliseconds"]["event_to_pose"]["p50"], 5);
  EXPECT_EQ(json["milliseconds"]["event_to_pose"]["max"], 9);
  EXPECT_EQ(json["events"]["used"], 7);
  EXPECT_EQ(json["events"]["dropped"], 3);
  EXPECT_EQ(json["real_time_factor"], 4);
  EXPECT_TRUE(json["evaluation"].is_null());
  for (const char* key : {"poses", "coverage", "lost_intervals", "references", "depth_frames", "peak_memory_mb"}) {
    EXPECT_TRUE(json.contains(key)) << key;
  }
}

TEST(RunReport, SaysWhatIsWrongWithAnInertialSensorMostOfTheTime) {
  RunReport report(100);
  PoseEstimate pose;
  pose.state = TrackingState::kTracking;
  report.AddPose(pose);
  EXPECT_EQ(nlohmann::json::parse(report.ToJson())["inertial_fit"]["complaint"], "");
  for (const double gyroscope : {1.0, 300.0, 400.0}) {
    pose.inertial_fit = {gyroscope, 1, 9.8, M_PI / 180, 0.02};
    report.AddPose(pose);
  }
  const auto json = nlohmann::json::parse(report.ToJson())["inertial_fit"];
  EXPECT_EQ(json["gyroscope"], 300);
  EXPECT_NEAR(json["gyroscope_noise_deg_s_sqrt_hz"].get<double>(), 1, 1e-6);
  EXPECT_NEAR(json["accelerometer_noise_m_s2_sqrt_hz"].get<double>(), 0.02, 1e-6);
  EXPECT_NE(json["complaint"].get<std::string>().find("rad/s"), std::string::npos);
  EXPECT_FALSE(json["left_out"].get<bool>());
}

TEST(RunReport, SaysThatAnInertialSensorWasLeftOutThoughItWasNeverRead) {
  RunReport report(100);
  PoseEstimate pose;
  pose.state = TrackingState::kTracking;
  pose.inertial_fit.gyroscope_noise = 0.01;
  pose.inertial_fit.left_out = true;
  report.AddPose(pose);
  const auto json = nlohmann::json::parse(report.ToJson())["inertial_fit"];
  EXPECT_TRUE(json["left_out"].get<bool>());
  EXPECT_NE(json["complaint"].get<std::string>().find("noisy or shaken"), std::string::npos);
}

TEST(RunReport, SaysWhatTheCalibrationOfAnInertialSensorLacksAtTheEnd) {
  RunReport report(100);
  EXPECT_TRUE(nlohmann::json::parse(report.ToJson())["inertial_calibration"].is_null()) << "there is no sensor";
  PoseEstimate pose;
  pose.state = TrackingState::kTracking;
  pose.inertial_calibration = InertialCalibration{{1, 2, 3}, {0.01, 0, 0}, {4, 5, 6}, 0.03, {0, 0.02, 0}, {7, 8, 9}};
  report.AddPose(pose);
  const auto json = nlohmann::json::parse(report.ToJson())["inertial_calibration"];
  EXPECT_EQ(json["gyroscope_bias_rad_s"], nlohmann::json({1, 2, 3}));
  EXPECT_EQ(json["gyroscope_scale"][0], 0.01);
  EXPECT_EQ(json["accelerometer_bias_m_s2"], nlohmann::json({4, 5, 6}));
  EXPECT_EQ(json["accelerometer_scale"], 0.03);
  EXPECT_EQ(json["rotation_rad"][1], 0.02);
  EXPECT_EQ(json["translation_m"], nlohmann::json({7, 8, 9}));
}

TEST(Percentile, IsTheNearestRank) {
  EXPECT_EQ(Percentile({5, 1, 3, 2, 4}, 0.5), 3);
  EXPECT_EQ(Percentile({5, 1, 3, 2, 4}, 1.0), 5);
  EXPECT_EQ(Percentile({5, 1, 3, 2, 4}, 0.0), 1);
  EXPECT_EQ(Percentile({}, 0.5), 0);
}

}  // namespace
}  // namespace devo
