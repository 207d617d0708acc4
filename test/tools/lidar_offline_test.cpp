// SPDX-License-Identifier: BSD-3-Clause
//
// Depth from a LiDAR, end to end: short simulated recordings through the offline runner and the bag validation.
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class LidarOffline : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = ::testing::TempDir() + "lidar_offline_test_" + std::to_string(getpid());
    ASSERT_EQ(std::system(("rm -rf " + folder_ + " && mkdir -p " + folder_).c_str()), 0);
  }
  void TearDown() override { ASSERT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  void Simulate(const std::string& more, double duration_s = 2.5) {
    const ProgramResult result = RunProgram(
        "devo_simulate", "--out " + folder_ + "/sim --sensor davis240 --no-frames --no-imu --quiet --duration " +
                             std::to_string(duration_s) + " " + more);
    ASSERT_EQ(result.status, 0) << result.err;
  }
  std::string Trajectory(const std::string& arguments) {
    const ProgramResult result = RunProgram("devo_offline", arguments + " --out " + folder_ + "/out");
    EXPECT_EQ(result.status, 0) << result.err;
    std::stringstream text;
    text << std::ifstream(folder_ + "/out/trajectory.txt").rdbuf();
    return text.str();
  }
  void ExpectAte(double largest_share) {
    const auto report = nlohmann::json::parse(std::ifstream(folder_ + "/out/report.json"));
    EXPECT_EQ(report["lost_intervals"].size(), 0U);
    EXPECT_GE(report["coverage"], 0.99);
    EXPECT_GE(report["depth_frames"]["used"], 15);
    ASSERT_FALSE(report["evaluation"].is_null());
    const double ate_m = report["evaluation"]["ate_rmse_m"], path_m = report["evaluation"]["path_length_m"];
    EXPECT_GT(path_m, 0.2);
    EXPECT_LT(ate_m, largest_share * path_m) << "of a path of " << path_m << " m";
    RecordProperty("ate_percent", std::to_string(100 * ate_m / path_m));
  }

  std::string folder_;
};

TEST_F(LidarOffline, FollowsTheMotionInARoomWithTheSameBytesWhateverTheThreads) {
  Simulate("--scene table --speed mid --lidar --depth none");
  const std::string run = "--config " + folder_ + "/sim.yaml --bag " + folder_ + "/sim.bag";
  const std::string trajectory = Trajectory(run + " --threads 1");
  ExpectAte(0.03);
  EXPECT_EQ(trajectory, Trajectory(run + " --threads 2"));
  const ProgramResult result = RunProgram("devo_validate_bag", folder_ + "/sim.bag --config " + folder_ + "/sim.yaml");
  EXPECT_EQ(result.status, 0) << result.out << result.err;
  EXPECT_THAT(result.out, AllOf(HasSubstr("fields x y z intensity ring time"), HasSubstr("LiDAR at (0.000, -0.090"),
                                HasSubstr("The odometry can use this recording.")));
}

TEST_F(LidarOffline, FollowsTheMotionInAHallThatIsTooLargeForADepthCamera) {
  Simulate("--scene hall --speed mid --lidar --depth none");
  Trajectory("--config " + folder_ + "/sim.yaml --bag " + folder_ + "/sim.bag");
  ExpectAte(0.03);
}

TEST_F(LidarOffline, ReadsMvsecsCloudsWithoutTimesThroughItsOwnCalibration) {
  Simulate("--scene table --speed mid --dialect mvsec");
  Trajectory("--config " DEVO_SOURCE_DIR
             "/config/mvsec.yaml --set topics.points=/velodyne_point_cloud calibration.path=" +
             folder_ + "/camchain-imucam-sim.yaml --bag " + folder_ + "/sim_data.bag " + folder_ + "/sim_gt.bag");
  ExpectAte(0.03);
}

TEST_F(LidarOffline, ReadsVectorsCloudsThroughItsOwnCalibration) {
  Simulate("--scene table --speed mid --dialect vector");
  const std::string stem = folder_ + "/sim.synced.";
  Trajectory("--config " DEVO_SOURCE_DIR
             "/config/vector.yaml --set topics.points=/ouster/point_cloud calibration.path=" +
             folder_ + "/yaml --bag " + stem + "left_event.bag " + stem + "lidar.bag " + stem + "gt.bag");
  ExpectAte(0.03);
}

TEST_F(LidarOffline, NamesTheExtrinsicsThatAreMissing) {
  Simulate("--scene table --lidar --depth none", 0.3);
  const auto run = [this](const std::string& frame) {
    return RunProgram("devo_offline", "--config " DEVO_SOURCE_DIR "/config/simulated.yaml --set " +
                                          std::string("topics.points=/velodyne_points frames.depth=") + frame +
                                          " --bag " + folder_ + "/sim.bag --out " + folder_ + "/out");
  };
  const ProgramResult unknown = run("mast");
  EXPECT_EQ(unknown.status, 2);
  EXPECT_THAT(unknown.err, AllOf(HasSubstr("'mast'"), HasSubstr("'T_event_depth' (the LiDAR's pose)")));
  EXPECT_THAT(run("velodyne").err, Not(HasSubstr("extrinsics"))) << "found on /tf_static";
}

}  // namespace
}  // namespace devo
