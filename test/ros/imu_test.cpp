// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"

namespace devo {
namespace {

ImuSurroundings InFrame(const std::string& event_frame) {
  ImuSurroundings known;
  known.event_frame = event_frame;
  return known;
}

/// The IMU's x axis is the event camera's z axis.
tf2::BufferCore& TurnedImu(tf2::BufferCore& transforms) {
  geometry_msgs::TransformStamped transform;
  transform.header.frame_id = "event";
  transform.child_frame_id = "imu";
  transform.transform = ToTransformMsg(Rigid3(Eigen::Quaterniond(0.5, -0.5, -0.5, -0.5), {1, 2, 3}));
  transforms.setTransform(transform, "test", true);
  return transforms;
}

sensor_msgs::Imu Turning() {
  sensor_msgs::Imu message;
  message.header.stamp.fromNSec(1'000'000'007);
  message.angular_velocity.x = 0.25;
  message.linear_acceleration.y = 9.5;
  return message;
}

TEST(Imu, ASampleIsTurnedIntoTheEventFrameByTheStaticTransformation) {
  tf2::BufferCore transforms;
  const ImuSample sample = ToImuSample(Turning(), PoseOfImu("/imu", InFrame("event"), TurnedImu(transforms)));
  EXPECT_EQ(sample.t_ns, 1'000'000'007);
  EXPECT_TRUE(sample.angular_velocity.isApprox(Eigen::Vector3d(0, 0, 0.25), 1e-12)) << sample.angular_velocity;
  EXPECT_TRUE(sample.linear_acceleration.isApprox(Eigen::Vector3d(9.5, 0, 0), 1e-12)) << sample.linear_acceleration;
}

TEST(Imu, ASampleKnowsWhereItsSensorIs) {
  tf2::BufferCore transforms;
  const ImuSample sample = ToImuSample(Turning(), PoseOfImu("imu", InFrame("event"), TurnedImu(transforms)));
  EXPECT_LT((sample.p_event_imu - Eigen::Vector3d(1, 2, 3)).norm(), 1e-12);
}

TEST(Imu, AMessageWithoutAnAccelerometerGivesNoAcceleration) {
  sensor_msgs::Imu message = Turning();
  message.linear_acceleration_covariance[0] = -1;
  EXPECT_TRUE(ToImuSample(message, Rigid3()).linear_acceleration.array().isNaN().all());
}

TEST(Imu, AMessageWithoutAGyroscopeIsNoReading) {
  sensor_msgs::Imu message = Turning();
  message.angular_velocity_covariance[0] = -1;
  EXPECT_FALSE(IsReading(ToImuSample(message, Rigid3())));
}

TEST(Imu, ASampleInTheEventFrameOrOfNoFrameStaysAsItIs) {
  const tf2::BufferCore nothing;
  for (const char* frame : {"", "event", "/event"}) {
    const ImuSample sample = ToImuSample(Turning(), PoseOfImu(frame, InFrame("event"), nothing));
    EXPECT_EQ(sample.angular_velocity, Eigen::Vector3d(0.25, 0, 0)) << frame;
  }
}

TEST(Imu, AMissingTransformationIsRefusedAndBothFramesAreNamed) {
  const tf2::BufferCore nothing;
  try {
    PoseOfImu("imu", InFrame("event"), nothing);
    FAIL() << "a guess was returned";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("'imu'"), testing::HasSubstr("'event'")));
  }
}

TEST(Imu, AConfiguredPlaceCountsWhateverTheFramesSay) {
  tf2::BufferCore transforms;
  ImuSurroundings known = InFrame("event");
  known.T_event_imu = Rigid3::Translation({4, 5, 6});
  for (const char* frame : {"imu", "event", "", "elsewhere"}) {
    const Rigid3 T_event_imu = PoseOfImu(frame, known, TurnedImu(transforms));
    EXPECT_LT(Log(T_event_imu.inverse() * *known.T_event_imu).norm(), 1e-12) << frame;
  }
}

TEST(Imu, ADepthCamerasImuIsPlacedThroughItsFrame) {
  tf2::BufferCore transforms;
  TurnedImu(transforms);  // of a frame "event" that is the depth camera's here
  ImuSurroundings known = InFrame("another");
  known.depth_frame = "event";
  EXPECT_THROW(PoseOfImu("imu", known, transforms), std::runtime_error) << "where the depth camera is, nobody says";
  known.T_event_depth = Rigid3(ExpSO3({0, 0, 1}), {0.1, 0, 0});
  const Rigid3 expected = *known.T_event_depth * PoseOfImu("imu", InFrame("event"), transforms);
  EXPECT_LT(Log(PoseOfImu("imu", known, transforms).inverse() * expected).norm(), 1e-12);
  EXPECT_LT(Log(PoseOfImu("event", known, transforms).inverse() * *known.T_event_depth).norm(), 1e-12);
  known.event_frame.clear();
  EXPECT_LT(Log(PoseOfImu("imu", known, transforms).inverse() * expected).norm(), 1e-12);
  try {
    PoseOfImu("lost", known, transforms);
    FAIL() << "a guess was returned";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("'lost'"), testing::HasSubstr("the depth's, 'event'")));
  }
}

TEST(Imu, AnOffsetOfItsClockIsAddedToTheStamp) {
  EXPECT_EQ(ToImuSample(Turning(), Rigid3(), -7'000'000).t_ns, 993'000'007);
}

TEST(Imu, AnUnknownEventFrameIsRefused) {
  const tf2::BufferCore nothing;
  EXPECT_THROW(PoseOfImu("imu", InFrame(""), nothing), std::runtime_error);
}

}  // namespace
}  // namespace devo
