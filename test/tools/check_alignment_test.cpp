// SPDX-License-Identifier: BSD-3-Clause
//
// devo_check_alignment as a user runs it, on simulated recordings whose time offset is known.
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

class CheckAlignment : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = ::testing::TempDir() + "check_alignment_test_" + std::to_string(getpid());
    ASSERT_EQ(std::system(("rm -rf " + folder_ + " && mkdir -p " + folder_).c_str()), 0);
  }
  void TearDown() override { ASSERT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  void Simulate(const std::string& more) {
    const ProgramResult result = RunProgram("devo_simulate", "--out " + folder_ +
                                                                 "/rig --scene table --sensor davis240 --depth exact "
                                                                 "--no-frames --no-imu --quiet " +
                                                                 more);
    ASSERT_EQ(result.status, 0) << result.err;
  }
  ProgramResult Check(const std::string& more = "") {
    return RunProgram("devo_check_alignment", "--config " + folder_ + "/rig.yaml --bag " + folder_ + "/rig.bag --out " +
                                                  folder_ + "/out " + more);
  }
  /// The number that the program prints, or NaN.
  static double OffsetIn(const std::string& output) {
    const std::string name = "depth_time_offset_s ";
    const auto at = output.find(name);
    return at == std::string::npos ? std::nan("") : std::strtod(output.c_str() + at + name.size(), nullptr);
  }

  std::string folder_;
};

TEST_F(CheckAlignment, FindsTheTimeOffsetThatTheDepthWasGiven) {
  Simulate("--ideal --speed mid --duration 2.5 --rest 0.2 --depth-offset 0.02");  // stamps are 20 ms late
  const ProgramResult result = Check("--set depth_time_offset_s=0");
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_NEAR(OffsetIn(result.out), -0.02, 0.006) << result.out;
  EXPECT_TRUE(std::ifstream(folder_ + "/out/alignment.png").good());
  EXPECT_TRUE(std::ifstream(folder_ + "/out/alignment.csv").good());
}

TEST_F(CheckAlignment, JudgesWhatIsReadableOfATruncatedBagAndNamesIt) {
  Simulate("--ideal --speed mid --duration 2.5 --rest 0.2");
  const std::string bag = folder_ + "/rig.bag";
  ASSERT_EQ(truncate(bag.c_str(), static_cast<off_t>(0.7 * static_cast<double>(std::filesystem::file_size(bag)))), 0);
  const ProgramResult result = Check();
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, ::testing::AllOf(::testing::HasSubstr(bag), ::testing::HasSubstr("ends early")));
  EXPECT_THAT(result.out, ::testing::HasSubstr("as configured"));
  EXPECT_TRUE(std::ifstream(folder_ + "/out/alignment.csv").good());
}

TEST_F(CheckAlignment, RefusesARecordingWithoutMotion) {
  Simulate("--speed slow --duration 0.6 --rest 0.6");
  const ProgramResult result = Check();
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, ::testing::HasSubstr("moving camera"));
}

TEST_F(CheckAlignment, RefusesNumbersThatAreNone) {
  for (const char* option : {"--start nan", "--duration inf", "--search nan", "--step nan", "--every nan"}) {
    EXPECT_THAT(Check(option).err, ::testing::HasSubstr("expected a number from")) << option;
  }
}

}  // namespace
}  // namespace devo
