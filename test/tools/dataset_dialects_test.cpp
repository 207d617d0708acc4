// SPDX-License-Identifier: BSD-3-Clause
//
// Recordings in the dialects of public data sets: their topics, encodings, separate bags and calibration files, read as
// they are downloaded.
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

class DatasetDialects : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = ::testing::TempDir() + "dataset_dialects_test_" + std::to_string(getpid());
    ASSERT_EQ(std::system(("rm -rf " + folder_ + " && mkdir -p " + folder_).c_str()), 0);
  }
  void TearDown() override { ASSERT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  template <typename Message>
  void WriteBag(const std::string& name, const std::string& topic, const std::vector<Message>& messages,
                rosbag::bagmode::BagMode mode = rosbag::bagmode::Write) {
    rosbag::Bag bag(folder_ + "/" + name, mode);
    bag.setCompression(rosbag::compression::BZ2);
    for (const Message& m : messages) bag.write(topic, m.header.stamp, m);
  }

  void WriteFile(const std::string& name, const std::string& text) { std::ofstream(folder_ + "/" + name) << text; }

  void ExpectGoodRun(const std::string& config, const std::string& calibration, const std::string& bags) {
    const ProgramResult result = RunProgram(
        "devo_offline", "--config " DEVO_SOURCE_DIR "/config/" + config + " --set calibration.path=" + folder_ + "/" +
                            calibration + " --bag " + bags + " --out " + folder_ + "/out");
    ASSERT_EQ(result.status, 0) << result.err;
    const auto report = nlohmann::json::parse(std::ifstream(folder_ + "/out/report.json"));
    EXPECT_GE(report["coverage"], 0.99);
    ASSERT_FALSE(report["evaluation"].is_null());
    EXPECT_LT(report["evaluation"]["ate_rmse_m"], 0.005) << "of a path of 0.29 m";
  }

  std::string folder_;
  TinyRecording recording_;
};

TEST_F(DatasetDialects, OfMvsecAreReadFromItsDataAndGroundTruthBagsAndItsCamchain) {
  std::vector<sensor_msgs::Image> depth;
  for (const sensor_msgs::Image& millimetres : recording_.depth) {
    sensor_msgs::Image metres = millimetres;
    metres.encoding = "32FC1";
    metres.step = 4 * metres.width;
    std::vector<float> pixels(metres.width * metres.height, static_cast<float>(recording_.scene.wall_m));
    for (std::uint32_t x = 0; x < 20 * metres.width; ++x)
      pixels[x] = std::numeric_limits<float>::quiet_NaN();  // no LiDAR there
    metres.data.resize(4 * pixels.size());
    std::memcpy(metres.data.data(), pixels.data(), metres.data.size());
    depth.push_back(metres);
  }
  WriteBag("tiny1_data.bag", "/davis/left/events", recording_.events);
  WriteBag("tiny1_gt.bag", "/davis/left/depth_image_raw", depth);
  WriteBag("tiny1_gt.bag", "/davis/left/pose", recording_.truth, rosbag::bagmode::Append);
  WriteFile("camchain-imucam-tiny.yaml",
            "cam0: {camera_model: pinhole, intrinsics: [200, 200, 119.5, 89.5], resolution: [240, 180],"
            " distortion_model: radtan, distortion_coeffs: [0, 0, 0, 0], rostopic: /davis/left/image_raw}");
  ExpectGoodRun("mvsec.yaml", "camchain-imucam-tiny.yaml", folder_ + "/tiny1_data.bag " + folder_ + "/tiny1_gt.bag");
}

TEST_F(DatasetDialects, OfVectorAreReadFromItsBagsOfOneTopicAndItsYamlFiles) {
  // The ground truth is the pose of a body that sits elsewhere and looks elsewhere than the event camera.
  const Rigid3 T_body_cam0(ExpSO3({0.3, -0.5, 0.2}), {0.06, -0.03, 0.07}),
      T_cam0_event(ExpSO3({0, 0, 0.01}), {0, -0.04, -0.01});
  const Rigid3 T_body_event = T_body_cam0 * T_cam0_event;
  for (geometry_msgs::PoseStamped& pose : recording_.truth) {
    pose.pose = ToPoseMsg(FromPoseMsg(pose.pose) * T_body_event.inverse());
  }
  WriteBag("tiny.synced.left_event.bag", "/prophesee/left/events", recording_.events);
  WriteBag("tiny.synced.kinect_depth.bag", "/kinect/depth_image", recording_.depth);
  WriteBag("tiny.synced.gt.bag", "/gt/pose", recording_.truth);
  const std::string camera =
      "{image_width: 240, image_height: 180, camera_name: c, camera_model: plumb_bob, camera_matrix: {rows: 3, cols: 3,"
      " data: [200, 0, 119.5, 0, 200, 89.5, 0, 0, 1]}, distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, "
      "0]}}";
  WriteFile("left_event_camera_intrinsic_results.yaml", camera);
  WriteFile("rgbd_depth_camera_factory_intrinsic_results.yaml", camera);
  const auto matrix = [](const Rigid3& T) {
    std::ostringstream text;
    text.precision(17);
    const Eigen::Matrix4d M = T.matrix();
    for (int i = 0; i < 16; ++i) text << (i > 0 ? ", " : "[") << M(i / 4, i % 4);
    return text.str() + "]";
  };
  // Chosen so that the depth camera ends up in the event camera's place.
  const Rigid3 T_color_depth(ExpSO3({0.09, 0, 0}), {-0.03, 0, 0});
  WriteFile("small_scale_joint_camera_extrinsic_results.yaml",
            "cam2: {T_cam0_cam2: " + matrix(T_cam0_event) +
                "}\ncam4: {T_cam0_cam4: " + matrix(T_cam0_event * T_color_depth.inverse()) + "}\n");
  WriteFile("rgbd_camera_calibrated_extrinsic_results.yaml", "cam1: {T_cam0_cam1: " + matrix(T_color_depth) + "}\n");
  WriteFile("camera_mocap_extrinsic_results1.yaml", "cam0: {T_body_cam: " + matrix(T_body_cam0) + "}\n");
  const std::string base = folder_ + "/tiny.synced.";
  ExpectGoodRun("vector.yaml", "", base + "left_event.bag " + base + "kinect_depth.bag " + base + "gt.bag");
}

}  // namespace
}  // namespace devo
