// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/miscalibration.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/io/disturbance.h"
#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

Rig ARig() {
  Rig rig;
  rig.event_camera = Camera(640, 480, 500, 510, 320, 240, "plumb_bob", {-0.1, 0.02, 1e-3, -1e-3, 0.01});
  rig.depth_camera = Camera(320, 288, 250, 250, 160, 144, "", {});
  rig.T_event_depth = Rigid3(ExpSO3({0.1, -0.2, 0.3}), {0.05, 0.01, -0.02});
  return rig;
}

Miscalibration With(const std::string& key, const std::string& value) {
  Miscalibration miscalibration;
  EXPECT_TRUE(miscalibration.Add(key, value));
  return miscalibration;
}

TEST(Miscalibration, LeavesARigAsItIsWhereNothingIsOff) {
  const Rig rig = Miscalibration().Of(ARig());
  EXPECT_EQ(rig.event_camera.fx(), 500);
  EXPECT_EQ(rig.depth_camera.fx(), 250);
  EXPECT_LT(Log(ARig().T_event_depth.inverse() * rig.T_event_depth).norm(), 1e-12);
}

TEST(Miscalibration, TurnsTheDepthCameraInItsFrameAndShiftsItInTheEventCameras) {
  const Rigid3 right = ARig().T_event_depth;
  const Rigid3 turned = With("depth_rotation", "0:1:0").Of(ARig()).T_event_depth;
  Vector6d degree = Vector6d::Zero();
  degree[4] = M_PI / 180;
  EXPECT_LT((Log(right.inverse() * turned) - degree).norm(), 1e-9);
  const Rigid3 shifted = With("depth_translation", "0.01:-0.02:0").Of(ARig()).T_event_depth;
  EXPECT_LT((shifted.translation() - right.translation() - Eigen::Vector3d(0.01, -0.02, 0)).norm(), 1e-12);
}

TEST(Miscalibration, LengthensAFocalLengthAndLeavesTheDistortion) {
  const Camera camera = With("event_focal", "0.01").Of(ARig()).event_camera;
  EXPECT_DOUBLE_EQ(camera.fx(), 505);
  EXPECT_EQ(camera.coefficients(), ARig().event_camera.coefficients());
  EXPECT_EQ(camera.distortion(), DistortionModel::kPlumbBob);
}

TEST(Miscalibration, MakesACameraOfItsOwnOfRegisteredDepthThatIsOff) {
  Rig rig = ARig();
  rig.depth_registered = true;
  rig.depth_camera = rig.event_camera;
  rig.T_event_depth = Rigid3();
  EXPECT_TRUE(With("event_focal", "0.01").Of(rig).depth_registered);
  const Rig off = With("depth_translation", "0:0:0.01").Of(rig);
  EXPECT_FALSE(off.depth_registered);
  EXPECT_EQ(off.depth_camera.width(), 640);
}

TEST(Miscalibration, FalsifiesAnInertialSensorsSample) {
  ImuSample sample;
  sample.angular_velocity = {1, 0, 0};
  sample.linear_acceleration = {0, 9.81, 0};
  EXPECT_LT((With("imu_rotation", "0:0:90").Of(sample).angular_velocity - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  EXPECT_DOUBLE_EQ(With("gyroscope_scale", "0.02").Of(sample).angular_velocity.x(), 1.02);
  EXPECT_DOUBLE_EQ(With("accelerometer_scale", "-0.1").Of(sample).linear_acceleration.y(), 0.9 * 9.81);
  EXPECT_DOUBLE_EQ(With("gyroscope_bias", "0:0:180").Of(sample).angular_velocity.z(), M_PI);
  EXPECT_DOUBLE_EQ(With("accelerometer_bias", "0:0:0.5").Of(sample).linear_acceleration.z(), 0.5);
  EXPECT_DOUBLE_EQ(With("imu_translation", "0.1:0:0").Of(sample).p_event_imu.x(), 0.1);
}

TEST(Miscalibration, IsPartOfWhatDisturbs) {
  DisturbanceOptions options;
  options.Add("gyroscope_scale=0.02");
  EXPECT_EQ(options.miscalibration.gyroscope_scale, 0.02);
}

TEST(Miscalibration, RefusesWhatIsNoErrorOfACalibrationAndSaysWhatIsExpected) {
  DisturbanceOptions options;
  for (const std::string& bad :
       std::vector<std::string>{"0.1", "0.1:0.2", "a:0:0", "0:0:0:0", "1:2:3:x", "x:1:2:3", "0:0:nan", "", "1:2:3x"}) {
    EXPECT_THAT([&] { options.Add("depth_rotation=" + bad); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("expected X:Y:Z in degrees")))
        << bad;
  }
  for (const std::string& bad : std::vector<std::string>{"-1", "x", "0.1:0.1", ""}) {
    EXPECT_THAT([&] { options.Add("event_focal=" + bad); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("expected a share above -1")))
        << bad;
  }
  EXPECT_FALSE(Miscalibration().Add("event_focus", "0.1"));
}

}  // namespace
}  // namespace devo
