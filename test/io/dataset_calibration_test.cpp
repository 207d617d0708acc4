// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/dataset_calibration.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/io/rig_config.h"
#include "io/shared_data.h"
#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string VectorFolder() {
  const std::string readme = SharedData("vector_calibration/README.md");
  return readme.empty() ? "" : readme.substr(0, readme.rfind('/'));
}

TEST(VectorCalibration, IsReadAsPublished) {
  const std::string folder = VectorFolder();
  if (folder.empty()) GTEST_SKIP() << MissingSharedData("vector_calibration");
  const DatasetCalibration calibration = ReadVectorCalibration(folder);
  EXPECT_EQ(calibration.event_camera.width(), 640);
  EXPECT_NEAR(calibration.event_camera.fx(), 327.32749, 1e-9);
  EXPECT_EQ(calibration.event_camera.distortion(), DistortionModel::kPlumbBob);
  ASSERT_TRUE(calibration.depth_camera && calibration.T_event_depth && calibration.T_body_event);
  EXPECT_NEAR(calibration.depth_camera->cy(), 336.139, 1e-9);
  EXPECT_EQ(calibration.depth_camera->distortion(), DistortionModel::kRationalPolynomial)
      << "labelled plumb_bob, 8 coefficients";
}

TEST(VectorCalibration, ChainsTheExtrinsicsFromTheDepthToTheEventCamera) {
  const std::string folder = VectorFolder();
  if (folder.empty()) GTEST_SKIP() << MissingSharedData("vector_calibration");
  const Rigid3 T = *ReadVectorCalibration(folder).T_event_depth;
  // The Kinect's depth camera looks down by 5.5 deg against its colour camera, and the colour camera by another 1.9
  // against the event camera; it sits 8.6 cm to the right. Worked out by hand from the published matrices.
  EXPECT_NEAR(T.translation().x(), 0.0857, 1e-3);
  EXPECT_NEAR(T.translation().y(), 0.0039, 1e-3);
  EXPECT_NEAR(T.translation().z(), 0.0019, 1e-3);
  EXPECT_NEAR(RotationAngle(T) * 57.29578, 7.47, 0.05);
}

TEST(VectorCalibration, FillsARigUnlessTheYamlGivesMore) {
  const std::string folder = VectorFolder();
  if (folder.empty()) GTEST_SKIP() << MissingSharedData("vector_calibration");
  const std::string config = std::string(DEVO_SOURCE_DIR) + "/config/vector.yaml";
  const RigConfig rig = LoadRigConfig({config}, {"calibration.path=" + folder});
  ASSERT_TRUE(rig.event_camera && rig.depth_camera && rig.T_event_depth && rig.T_body_event);
  EXPECT_EQ(rig.depth_camera->height(), 576);
  const RigConfig own = LoadRigConfig(
      {config}, {"calibration.path=" + folder, "depth_camera={width: 4, height: 4, fx: 1, fy: 1, cx: 1, cy: 1}"});
  EXPECT_EQ(own.depth_camera->height(), 4);
}

TEST(VectorCalibration, PlacesTheLidarThroughTheLeftRegularCamera) {
  const std::string folder = VectorFolder();
  if (folder.empty()) GTEST_SKIP() << MissingSharedData("vector_calibration");
  const std::string own = ::testing::TempDir() + "vector_calibration_test";
  ASSERT_EQ(std::system(("rm -rf " + own + " && mkdir " + own + " && cp " + folder + "/*.yaml " + own).c_str()), 0);
  EXPECT_FALSE(ReadVectorCalibration(own).T_event_lidar);
  // The numbers that the data set publishes.
  std::ofstream(own + "/camera_lidar_extrinsic_results.yaml") << R"(camera_number: 2
cam0:
  camera_name: right_regular_camera
  T_cam_lidar: [0.00229446, -0.999714, -0.0238084, -0.0828514, -0.00737735, 0.0237909, -0.99969, -0.0633996,
                0.99997, 0.00246939, -0.00732065, -0.0852966, 0, 0, 0, 1]
cam1:
  camera_name: left_regular_camera
  T_cam_lidar: [0.0119197, -0.999929, 0.0000523, 0.0853154, -0.00648951, -0.00012969, -0.999979, -0.0684439,
                0.999908, 0.0119191, -0.0064906, -0.0958121, 0, 0, 0, 1]
)";
  const auto T = ReadVectorCalibration(own).T_event_lidar;
  ASSERT_TRUE(T);
  // Worked out by hand with the large-scale rig's event camera, 2.6 cm below the LiDAR and 8 cm in front of it.
  EXPECT_LT((T->translation() - Eigen::Vector3d(0.0856, -0.0281, -0.0816)).norm(), 1e-3);
  EXPECT_GT((T->rotation() * Eigen::Vector3d::UnitX()).z(), 0.99) << "forward of the LiDAR is forward of the camera";
  const RigConfig rig = LoadRigConfig({std::string(DEVO_SOURCE_DIR) + "/config/vector.yaml"},
                                      {"calibration.path=" + own, "topics.points=/ouster/point_cloud"});
  ASSERT_TRUE(rig.depth_from_lidar() && rig.T_event_depth);
  EXPECT_LT(Log(rig.T_event_depth->inverse() * *T).norm(), 1e-12);
  ASSERT_EQ(std::system(("rm -rf " + own).c_str()), 0);
}

TEST(VectorCalibration, PlacesTheImuThroughTheLeftRegularCameraOfEitherScale) {
  const std::string folder = VectorFolder();
  if (folder.empty()) GTEST_SKIP() << MissingSharedData("vector_calibration");
  const std::string own = ::testing::TempDir() + "vector_imu_test";
  ASSERT_EQ(std::system(("rm -rf " + own + " && mkdir " + own + " && cp " + folder + "/*.yaml " + own + " && rm -f " +
                         own + "/*imu*")
                            .c_str()),
            0);
  EXPECT_FALSE(ReadVectorCalibration(own).T_event_imu);
  // The numbers that the data set publishes; Kalibr's other keys are left out.
  std::ofstream(own + "/small_scale_camera_imu_extrinsic_results1.yaml") << R"(camera_number: 2
cam0: # left_regular_camera
  T_cam_imu: # transformation from IMU to left regular camera
  - [0.017248643674008135, -0.9998037138739959, 0.009747718459772736, 0.07733078169916466]
  - [0.012834636469124028, -0.009526963092989282, -0.999872246379971, -0.016637889364465353]
  - [0.9997688514842376, 0.017371548520172697, 0.01266779001636642, -0.14481844113148515]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: 0.008375665182111344
)";
  const DatasetCalibration small = ReadVectorCalibration(own);
  ASSERT_TRUE(small.T_event_imu && small.T_event_imu_of_lidar_rig);
  // Worked out by hand: the event camera is 4 cm above the regular camera, the IMU 13 cm behind the event camera.
  EXPECT_LT((small.T_event_imu->translation() - Eigen::Vector3d(0.0774, 0.0237, -0.1305)).norm(), 1e-3);
  EXPECT_GT((small.T_event_imu->rotation() * Eigen::Vector3d::UnitX()).z(), 0.99) << "forward is forward";
  EXPECT_LT((small.T_event_imu->rotation() * Eigen::Vector3d::UnitZ()).y(), -0.99) << "up is up";
  EXPECT_LT(Log(small.T_event_imu_of_lidar_rig->inverse() * *small.T_event_imu).norm(), 1e-12);
  std::ofstream(own + "/large_scale_camera_imu_extrinsic_results1.yaml")
      << "cam0:\n  T_cam_imu: [0, -1, 0, 0.07, 0, 0, -1, -0.015, 1, 0, 0, -0.14, 0, 0, 0, 1]\n";
  const std::string config = std::string(DEVO_SOURCE_DIR) + "/config/vector.yaml";
  const RigConfig kinect = LoadRigConfig({config}, {"calibration.path=" + own});
  const RigConfig lidar = LoadRigConfig({config}, {"calibration.path=" + own, "topics.points=/ouster/point_cloud"});
  ASSERT_TRUE(kinect.T_event_imu && lidar.T_event_imu);
  EXPECT_LT(Log(kinect.T_event_imu->inverse() * *small.T_event_imu).norm(), 1e-12);
  const double apart = Log(kinect.T_event_imu->inverse() * *lidar.T_event_imu).norm();
  EXPECT_TRUE(apart > 0.01 && apart < 0.1) << apart << ": the rig was mounted anew";
  ASSERT_EQ(std::system(("rm -rf " + own).c_str()), 0);
}

TEST(VectorCalibration, NamesTheFileThatIsMissing) {
  EXPECT_THAT(
      [] { ReadVectorCalibration("no_such_folder"); },
      ThrowsMessage<std::invalid_argument>(HasSubstr("no_such_folder/left_event_camera_intrinsic_results.yaml")));
}

class Camchain : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = ::testing::TempDir() + "camchain_test.yaml";
    Write(R"(cam0:
  T_cam_imu: [[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.048031442223833355, 0.011330957517194437, -0.055378166304281135, 0.021500973881459395]
  distortion_model: equidistant
  intrinsics: [226.38018519795807, 226.15002947047415, 173.6470807871759, 133.73271487507847]
  resolution: [346, 260]
  rostopic: /davis/left/image_raw
  projection_matrix: [[199.0, 0.0, 177.4, 0.0], [0.0, 199.0, 126.8, 0.0], [0.0, 0.0, 1.0, 0.0]]
cam1:
  T_cn_cnm1: [[1.0, 0.0, 0.0, -0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [226.0, 226.0, 175.0, 130.0]
  resolution: [346, 260]
  rostopic: /davis/right/image_raw
cam2:
  T_cn_cnm1: [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.5], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.2, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [300.0, 300.0, 376.0, 240.0]
  resolution: [752, 480]
T_cam0_lidar: [[0.0, -1.0, 0.0, 0.01], [0.0, 0.0, -1.0, 0.02], [1.0, 0.0, 0.0, 0.03], [0.0, 0.0, 0.0, 1.0]]
)");
  }
  void TearDown() override { std::remove(path_.c_str()); }
  void Write(const std::string& text) { std::ofstream(path_) << text; }

  std::string path_;
};

TEST_F(Camchain, IsReadInMvsecsLayout) {
  const KalibrChain chain = ReadKalibrChain(path_);
  ASSERT_EQ(chain.cameras.size(), 3U);
  EXPECT_EQ(chain.cameras[0].camera.distortion(), DistortionModel::kEquidistant);
  EXPECT_EQ(chain.cameras[0].camera.height(), 260);
  EXPECT_NEAR(chain.cameras[0].camera.cy(), 133.73271487507847, 1e-12);
  EXPECT_EQ(chain.cameras[0].rostopic, "/davis/left/image_raw");
  EXPECT_EQ(chain.cameras[2].camera.distortion(), DistortionModel::kPlumbBob);
  ASSERT_TRUE(chain.T_cam0_lidar);
  EXPECT_LT((*chain.T_cam0_lidar * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0.01, 0.02, 1.03)).norm(), 1e-9)
      << "forward of the LiDAR is forward of the camera";
}

TEST_F(Camchain, LinksEachCameraToThePreviousOne) {
  const KalibrChain chain = ReadKalibrChain(path_);
  EXPECT_LT((chain.Between(1, 0) * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(-0.1, 0, 1)).norm(), 1e-12);
  EXPECT_LT((chain.Between(2, 0) * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(0, 0.4, 1)).norm(), 1e-12);
  EXPECT_TRUE((chain.Between(0, 2) * chain.Between(2, 0)).matrix().isIdentity(1e-12));
}

TEST_F(Camchain, GivesMvsecsRig) {
  const RigConfig rig =
      LoadRigConfig({std::string(DEVO_SOURCE_DIR) + "/config/mvsec.yaml"}, {"calibration.path=" + path_});
  ASSERT_TRUE(rig.event_camera);
  EXPECT_EQ(rig.event_camera->width(), 346);
  EXPECT_TRUE(rig.registered);
  EXPECT_EQ(rig.topics.imu, "/davis/left/imu");
  ASSERT_TRUE(rig.T_event_imu);
  EXPECT_LT((rig.T_event_imu->translation() - Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-12);
}

TEST_F(Camchain, NamesTheKeyThatIsWrong) {
  Write("cam0: {intrinsics: [1, 2, 3], resolution: [4, 4], distortion_model: radtan, distortion_coeffs: []}");
  EXPECT_THAT([&] { ReadKalibrChain(path_); },
              ThrowsMessage<std::invalid_argument>(
                  AllOf(HasSubstr(path_), HasSubstr("'cam0.intrinsics': expected [fx, fy, cx, cy]"))));
  Write("camera: {}");
  EXPECT_THAT([&] { ReadKalibrChain(path_); }, ThrowsMessage<std::invalid_argument>(HasSubstr("'cam0': missing")));
}

}  // namespace
}  // namespace devo
