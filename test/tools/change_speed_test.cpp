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

TEST(ChangeSpeed, MakesARecordingThatIsFollowedWithItsImuAtTwiceTheSpeed) {
  const std::string folder = ::testing::TempDir() + "change_speed_test_" + std::to_string(getpid());
  ASSERT_EQ(std::system(("mkdir -p " + folder).c_str()), 0);
  const std::string sample = DEVO_SOURCE_DIR "/test/data/sample_davis240";
  const std::string fast = folder + "/fast.bag";
  ASSERT_EQ(std::system((DEVO_SOURCE_DIR "/scripts/change_speed.py " + sample + ".bag " + fast + " --speed 2").c_str()),
            0);
  const auto report_of = [&](const std::string& bag) {
    const ProgramResult result =
        RunProgram("devo_offline", "--config " + sample + ".yaml --bag " + bag + " --out " + folder);
    EXPECT_EQ(result.status, 0) << result.err;
    return nlohmann::json::parse(std::ifstream(folder + "/report.json"));
  };
  const auto slow_report = report_of(sample + ".bag"), fast_report = report_of(fast);
  const auto seconds = [](const nlohmann::json& report) {
    return report["end_s"].get<double>() - report["begin_s"].get<double>();
  };
  EXPECT_NEAR(seconds(fast_report), 0.5 * seconds(slow_report), 0.02);
  EXPECT_NEAR(fast_report["evaluation"]["path_length_m"].get<double>(),
              slow_report["evaluation"]["path_length_m"].get<double>(), 0.05);
  EXPECT_TRUE(fast_report["lost_intervals"].empty());
  EXPECT_LT(fast_report["evaluation"]["ate_rmse_m"].get<double>(), 3e-3);
  // Readings whose gravity had grown, too, would not fit.
  EXPECT_EQ(fast_report["inertial_fit"]["complaint"], "");
  EXPECT_EQ(std::system(("rm -rf " + folder).c_str()), 0);
}

}  // namespace
}  // namespace devo
