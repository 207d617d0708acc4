// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include <gtest/gtest.h>
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
    std::string bag = folder_ + "/rewritten.bag";
    const std::string command = DEVO_SOURCE_DIR "/scripts/" + script + " " + sample_ + ".bag " + bag + " " + arguments;
    EXPECT_EQ(std::system(command.c_str()), 0);
    return bag;
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

 private:
  std::string folder_ = ::testing::TempDir() + "rewritten_recordings_test_" + std::to_string(getpid());
  std::string sample_ = DEVO_SOURCE_DIR "/test/data/sample_davis240";
};

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

}  // namespace
}  // namespace devo
