// SPDX-License-Identifier: BSD-3-Clause
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sensor_msgs/Imu.h>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

class DevoValidateBag : public ::testing::Test {
 protected:
  void SetUp() override {
    bag_ = ::testing::TempDir() + "devo_validate_bag_test_" + std::to_string(getpid()) + ".bag";
    config_ =
        " --set topics.event_camera_info=/event_info topics.depth=/depth topics.depth_camera_info=/depth_info"
        " topics.ground_truth=/truth";
  }
  void TearDown() override { std::remove(bag_.c_str()); }
  ProgramResult Run(const std::string& more = "") { return RunProgram("devo_validate_bag", bag_ + more); }

  std::string bag_, config_;
};

TEST_F(DevoValidateBag, DescribesAGoodRecording) {
  TinyRecording().Write(bag_);
  const ProgramResult result = Run(config_);
  EXPECT_EQ(result.status, 0) << result.out << result.err;
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("20 images 240x180 16UC1"), HasSubstr("median depth from 1.00 to 1.00 m"),
                    HasSubstr("event camera 240x180, f 200.0"), HasSubstr("(CameraInfo on /event_info)"),
                    HasSubstr("(CameraInfo on /depth_info; /tf_static)"), HasSubstr("events and depth overlap"),
                    HasSubstr("The odometry can use this recording.")));
  EXPECT_THAT(result.out, Not(HasSubstr("PROBLEM")));
}

TEST_F(DevoValidateBag, FindsTopicsByTheirTypeAndProposesAYaml) {
  TinyRecording().Write(bag_);
  const ProgramResult result = Run();
  EXPECT_THAT(result.out, AllOf(HasSubstr("  events: /events\n"), HasSubstr("  depth: /depth\n"),
                                HasSubstr("ground_truth: \"/truth\"")));
}

TEST_F(DevoValidateBag, ProposesThePosesThatTheRecordingDoesNotTell) {
  TinyRecording recording;
  recording.AddImu();
  for (auto& sample : recording.imu) sample.header.frame_id = "imu_link";
  recording.Write(bag_);
  EXPECT_THAT(Run().out, Not(AnyOf(HasSubstr("T_event_depth: {}"), HasSubstr("T_event_imu: {}"))));
  recording.transforms.clear();
  recording.Write(bag_);
  EXPECT_THAT(Run().out, AllOf(HasSubstr("T_event_depth: {}"), HasSubstr("T_event_imu: {}")));
}

TEST_F(DevoValidateBag, SaysWhatToChange) {
  TinyRecording recording;
  recording.transforms.clear();
  for (auto& image : recording.depth) image.encoding = "mono16";
  recording.Write(bag_);
  ProgramResult result = Run(config_);
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.out, HasSubstr("PROBLEM: topic '/depth': depth image has encoding 'mono16', expected 16UC1"));
  result = Run(config_ + " topics.events=/nothing");
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.out, HasSubstr("PROBLEM: topic '/nothing' (key 'topics.events') is in none of the bags"));
  for (auto& image : recording.depth) image.encoding = "16UC1";
  recording.Write(bag_);
  EXPECT_THAT(Run(config_).out,
              HasSubstr("PROBLEM: no extrinsics from frame 'depth_optical' to frame 'event_optical'"));
}

TEST_F(DevoValidateBag, SaysThatTheClocksDiffer) {
  TinyRecording recording;
  for (auto& image : recording.depth) image.header.stamp += ros::Duration(50);
  recording.Write(bag_);
  const ProgramResult result = Run(config_);
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.out, AllOf(HasSubstr("do not overlap in time: their clocks differ by about -50."),
                                HasSubstr("'depth_time_offset_s'")));
}

TEST_F(DevoValidateBag, SaysThatTheImuHasAnotherUnitOrIsNotThere) {
  TinyRecording().Write(bag_);
  EXPECT_THAT(Run(config_ + " topics.imu=/imu").out, HasSubstr("WARNING: topic '/imu' (key 'topics.imu') is in none"));
  {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    for (int i = 0; i < 100; ++i) {
      sensor_msgs::Imu sample;
      sample.header.stamp = ToRosTime(TinyScene().begin_ns + i * 10'000'000LL);
      sample.linear_acceleration.z = 1;
      sample.angular_velocity.x = 90;
      bag.write("/imu", sample.header.stamp, sample);
    }
  }
  const ProgramResult result = Run(config_ + " topics.imu=/imu");
  EXPECT_EQ(result.status, 0) << result.out;  // it serves without
  EXPECT_THAT(result.out, AllOf(HasSubstr("IMU /imu: 100.0 messages per second"), HasSubstr("multiples of g"),
                                HasSubstr("look like degrees")));
}

TEST_F(DevoValidateBag, SaysThatNothingConnectsTheImusFrame) {
  TinyRecording recording;
  recording.AddImu();
  for (auto& sample : recording.imu) sample.header.frame_id = "imu_link";
  recording.Write(bag_);
  const ProgramResult result = Run(config_ + " topics.imu=/imu");
  EXPECT_EQ(result.status, 1) << "devo_offline refuses it, too";
  EXPECT_THAT(result.out, AllOf(HasSubstr("PROBLEM:"), HasSubstr("from the IMU's frame 'imu_link'")));
}

TEST_F(DevoValidateBag, TakesTheImusPlaceFromTheConfigurationWhateverItsFrame) {
  TinyRecording recording;
  recording.AddImu();
  for (auto& sample : recording.imu) sample.header.frame_id = "imu_link";
  recording.Write(bag_);
  const ProgramResult result =
      Run(config_ + " topics.imu=/imu 'T_event_imu={translation: [0.1, 0, 0], quaternion: [0, 0, 1, 0]}'");
  EXPECT_EQ(result.status, 0) << result.out;
  EXPECT_THAT(result.out, HasSubstr("IMU at (0.100, 0.000, 0.000) m in the event camera's frame, turned by 180.0 deg"));
}

TEST_F(DevoValidateBag, SaysThatTheCalibrationIsAnotherCameras) {
  TinyRecording recording;
  recording.event_info[0].width = 100;
  recording.Write(bag_);
  EXPECT_THAT(Run(config_).out, HasSubstr("outside the event camera's 100x180"));
}

TEST_F(DevoValidateBag, SaysWhatIsWrongWithEventsThatCannotBeReadAndGoesOn) {
  TinyRecording().Write(bag_);
  EventPacket packet;
  packet.encoding = "mono";
  packet.events = {1, 2};
  rosbag::Bag(bag_, rosbag::bagmode::Append).write("/packets", ros::Time(100), packet);
  const ProgramResult result = Run(config_ + " topics.events=/packets");
  EXPECT_EQ(result.status, 1) << result.out << result.err;
  EXPECT_THAT(result.out, AllOf(HasSubstr("PROBLEM"), HasSubstr("'mono'"), HasSubstr("20 images 240x180 16UC1")));
}

TEST_F(DevoValidateBag, RefusesWhatIsNoBag) {
  const ProgramResult missing = Run();
  EXPECT_EQ(missing.status, 2);
  EXPECT_THAT(missing.err, HasSubstr("cannot be opened"));
}

}  // namespace
}  // namespace devo
