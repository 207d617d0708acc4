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

TEST(ThereAndBack, MakesARecordingThatIsFollowedToItsEndAndBackToItsBeginning) {
  const std::string folder = ::testing::TempDir() + "there_and_back_test_" + std::to_string(getpid());
  ASSERT_EQ(std::system(("mkdir -p " + folder).c_str()), 0);
  const std::string sample = DEVO_SOURCE_DIR "/test/data/sample_davis240";
  const std::string both = folder + "/both.bag";
  ASSERT_EQ(std::system((DEVO_SOURCE_DIR "/scripts/there_and_back.py " + sample + ".bag " + both).c_str()), 0);
  const auto report_of = [&](const std::string& bag) {
    const ProgramResult result =
        RunProgram("devo_offline", "--config " + sample + ".yaml --bag " + bag + " --set topics.imu= --out " + folder);
    EXPECT_EQ(result.status, 0) << result.err;
    return nlohmann::json::parse(std::ifstream(folder + "/report.json"));
  };
  const auto there = report_of(sample + ".bag"), there_and_back = report_of(both);
  const auto path_m = [](const nlohmann::json& report) { return report["evaluation"]["path_length_m"].get<double>(); };
  EXPECT_NEAR(path_m(there_and_back), 2 * path_m(there), 0.1 * path_m(there));
  EXPECT_TRUE(there_and_back["lost_intervals"].empty());
  EXPECT_EQ(there_and_back["events"]["unordered"], 0);
  EXPECT_LT(there_and_back["evaluation"]["ate_rmse_m"].get<double>(), 5e-3);
  EXPECT_EQ(std::system(("rm -rf " + folder).c_str()), 0);
}

}  // namespace
}  // namespace devo
