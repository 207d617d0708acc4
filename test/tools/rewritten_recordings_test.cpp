// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <rosbag/view.h>
#include <std_msgs/String.h>
#include <nlohmann/json.hpp>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

/// The scripts that write a recording anew, and what the odometry makes of the sample's.
class RewrittenRecording : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(std::system(("mkdir -p " + folder_).c_str()), 0); }
  void TearDown() override { EXPECT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  /// The bag that a script makes of the sample.
  std::string Rewritten(const std::string& script, const std::string& arguments = "") const {
    return RewrittenOf(sample_ + ".bag", script, arguments);
  }
  std::string RewrittenOf(const std::string& source, const std::string& script,
                          const std::string& arguments = "") const {
    std::string bag = folder_ + "/rewritten.bag";
    const std::string command = CommandOf(script, source + " " + bag + " " + arguments) + " 2> " + folder_ + "/said";
    EXPECT_EQ(std::system(command.c_str()), 0) << Said();
    return bag;
  }
  /// What the last script said.
  std::string Said() const {
    std::stringstream text;
    text << std::ifstream(folder_ + "/said").rdbuf();
    return text.str();
  }
  static std::string CommandOf(const std::string& script, const std::string& arguments) {
    return DEVO_SOURCE_DIR "/scripts/" + script + " " + arguments;
  }
  /// A recording of a second with a text and a transform in its middle, of which neither has a header.
  std::string WithoutHeaders() const {
    std::string path = folder_ + "/without_headers.bag";
    const TinyRecording recording;
    recording.Write(path);
    rosbag::Bag bag(path, rosbag::bagmode::Append);
    const ros::Time middle = ToRosTime(recording.scene.begin_ns + 500000000);
    bag.write("/note", middle, std_msgs::String());
    bag.write("/tf", middle, recording.transforms.front());
    return path;
  }
  nlohmann::json ReportOf(const std::string& bag, const std::string& arguments = "") const {
    const ProgramResult result = RunProgram(
        "devo_offline", "--config " + sample_ + ".yaml --bag " + bag + " --out " + folder_ + " " + arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    return nlohmann::json::parse(std::ifstream(folder_ + "/report.json"));
  }
  nlohmann::json ReportOfSample(const std::string& arguments = "") const {
    return ReportOf(sample_ + ".bag", arguments);
  }
  /// Whether a script that has no room for what it makes of the sample leaves nothing behind.
  bool LeavesNothingWithoutRoom(const std::string& script, const std::string& arguments = "") const {
    const std::string bags = sample_ + ".bag " + folder_ + "/rewritten.bag ";
    const std::string command = "ulimit -f 200; " + CommandOf(script, bags + arguments) + " 2> /dev/null";
    EXPECT_NE(std::system(command.c_str()), 0);
    return std::filesystem::is_empty(folder_);
  }

 private:
  std::string folder_ = ::testing::TempDir() + "rewritten_recordings_test_" + std::to_string(getpid());
  std::string sample_ = DEVO_SOURCE_DIR "/test/data/sample_davis240";
};

/// When the messages of each topic were recorded.
std::map<std::string, std::vector<ros::Time>> TimesByTopic(const std::string& path) {
  const rosbag::Bag bag(path);
  std::map<std::string, std::vector<ros::Time>> times;
  for (const rosbag::MessageInstance& message : rosbag::View(bag))
    times[message.getTopic()].push_back(message.getTime());
  return times;
}

double PathLength_m(const nlohmann::json& report) { return report["evaluation"]["path_length_m"].get<double>(); }
double Ate_m(const nlohmann::json& report) { return report["evaluation"]["ate_rmse_m"].get<double>(); }
double Seconds(const nlohmann::json& report) { return report["end_s"].get<double>() - report["begin_s"].get<double>(); }

TEST_F(RewrittenRecording, AtTwiceTheSpeedIsFollowedWithItsImu) {
  const auto fast = ReportOf(Rewritten("change_speed.py", "--speed 2")), slow = ReportOfSample();
  EXPECT_NEAR(Seconds(fast), 0.5 * Seconds(slow), 0.02);
  EXPECT_NEAR(PathLength_m(fast), PathLength_m(slow), 0.05);
  EXPECT_TRUE(fast["lost_intervals"].empty());
  EXPECT_LT(Ate_m(fast), 3e-3);
  // Readings whose gravity had grown, too, would not fit.
  EXPECT_EQ(fast["inertial_fit"]["complaint"], "");
}

TEST_F(RewrittenRecording, ThatGoesThereAndBackIsFollowedToItsEndAndBackToItsBeginning) {
  const std::string no_imu = "--set topics.imu=";
  const auto both = ReportOf(Rewritten("there_and_back.py"), no_imu), there = ReportOfSample(no_imu);
  EXPECT_NEAR(PathLength_m(both), 2 * PathLength_m(there), 0.1 * PathLength_m(there));
  EXPECT_TRUE(both["lost_intervals"].empty());
  EXPECT_EQ(both["events"]["unordered"], 0);
  EXPECT_LT(Ate_m(both), 5e-3);
}

TEST_F(RewrittenRecording, AtAnotherSpeedKeepsWhatHasNoHeaderAndLeavesOutWhatHoldsStampsWithoutOne) {
  auto times = TimesByTopic(RewrittenOf(WithoutHeaders(), "change_speed.py", "--speed 2"));
  EXPECT_EQ(times["/note"], std::vector<ros::Time>{ToRosTime(TinyScene().begin_ns + 250000000)});
  EXPECT_EQ(times["/tf_static"].size(), 1U);
  EXPECT_GT(times["/events"].size(), 50U);
  EXPECT_EQ(times.count("/tf"), 0U);
  EXPECT_EQ(Said(), "left out: /tf, whose messages hold stamps but have no header\n");
}

TEST_F(RewrittenRecording, ThatGoesThereAndBackLeavesOutWhatHasNoHeaderAndNamesIt) {
  auto times = TimesByTopic(RewrittenOf(WithoutHeaders(), "there_and_back.py"));
  EXPECT_EQ(times["/tf_static"].size(), 1U);
  EXPECT_GT(times["/events"].size(), 100U);
  EXPECT_EQ(times.count("/tf") + times.count("/note"), 0U);
  EXPECT_EQ(Said(), "left out: /note, /tf, whose messages have no header\n");
}

TEST_F(RewrittenRecording, ThatCannotBeWrittenToItsEndLeavesNothingBehind) {
  EXPECT_TRUE(LeavesNothingWithoutRoom("change_speed.py", "--speed 2"));
  EXPECT_TRUE(LeavesNothingWithoutRoom("there_and_back.py"));
}

}  // namespace
}  // namespace devo
