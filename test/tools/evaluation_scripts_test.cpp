// SPDX-License-Identifier: BSD-3-Clause
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace devo {
namespace {

/// The script that makes the tables of docs/results.md, with a devo_offline whose reports are known: an ATE of 1 mm,
/// times 4 with `--set worse=1` and 2 at another depth rate than all; `b` is lost twice at such a rate. With
/// `--set interrupt=1` it interrupts the script.
class EvaluateRecordings : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(std::system(("mkdir -p " + folder_ + "/temporary").c_str()), 0);
    std::ofstream(folder_ + "/devo_offline") << R"(#!/bin/sh
ate=0.001 lost= name=a
case "$*" in *b.bag*) name=b;; esac
case "$*" in *worse=1*) ate=0.004;; esac
case "$*" in *--depth-rate*) ate=0.002; [ $name = a ] || lost='[0, 1], [2, 3]';; esac
case "$*" in *unknown*) echo 'devo_offline: unknown key' >&2; exit 2;; esac
mkdir -p "$2"
cat > "$2/report.json" <<END
{"poses": 9, "lost_intervals": [$lost], "coverage": 1, "references": 3, "real_time_factor": 4, "cpu_s": 2, "begin_s": 0, "end_s": 8,
 "evaluation": {"ate_rmse_m": $ate, "drift_percent": 0.5, "rpe_rotation_rmse_deg": 0.1, "rpe_translation_rmse_cm": 0.2,
                "final_rotation_deg": 0, "final_translation_m": 0.003, "nees": 1.5}}
END
)";
    ASSERT_EQ(chmod((folder_ + "/devo_offline").c_str(), 0755), 0);
    for (const char* name : {"a", "b"}) {
      std::ofstream(folder_ + "/" + name + ".bag") << "bag";
      std::ofstream(folder_ + "/table.txt", std::ios::app) << name << " rig.yaml " << name << ".bag\n";
    }
  }
  void TearDown() override { EXPECT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  /// Lines of the table, of a script that ends with this status.
  std::vector<std::string> Table(const std::string& arguments, int status = 0) const {
    const int ended = Run("evaluate_recordings.py", "--devo-offline " + folder_ + "/devo_offline " + arguments);
    EXPECT_TRUE(WIFEXITED(ended) && WEXITSTATUS(ended) == status);
    return Lines("out");
  }
  /// As std::system() says how it ended.
  int Run(const std::string& script, const std::string& arguments) const {
    const std::string command = "TMPDIR=" + folder_ + "/temporary " DEVO_SOURCE_DIR "/scripts/" + script + " --data " +
                                folder_ + " --recordings " + folder_ + "/table.txt " + arguments + " > " + folder_ +
                                "/out 2> " + folder_ + "/error";
    return std::system(command.c_str());
  }
  std::vector<std::string> Lines(const std::string& name) const {
    std::vector<std::string> lines;
    std::ifstream file(folder_ + "/" + name);
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }
  std::string LastError() const {
    const auto lines = Lines("error");
    return lines.empty() ? "" : lines.back();
  }
  const std::string& folder() const { return folder_; }

 private:
  std::string folder_ = ::testing::TempDir() + "evaluation_scripts_test_" + std::to_string(getpid());
};

TEST_F(EvaluateRecordings, WritesARowPerRun) {
  const auto lines = Table("");
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[2],
            "| a | all | default | 0.10 | 0.50 | 0.10 | 0.20 | 0.00 | 0.30 | 1.50 | 0 | 100.0 | 3 | 4.0 | 0.25 |");
}

TEST_F(EvaluateRecordings, WritesARowPerRecordingWithTheRatesOfEachVariantSideBySide) {
  const auto lines = Table("--wide --depth-rate all 5 --variant 'plain:' --variant 'worse: --set worse=1'");
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[0], "| recording | plain | plain, 5 Hz | worse | worse, 5 Hz | RPE deg / cm | NEES | CPU s/s |");
  EXPECT_EQ(lines[2], "| a | 0.10 (0.50 %) | 0.20 | 0.40 | 0.20 | 0.10 / 0.20 | 1.50 | 0.25 |");
  EXPECT_EQ(lines[3],
            "| b | 0.10 (0.50 %) | 0.20 (lost 2 times) | 0.40 | 0.20 (lost 2 times) | 0.10 / 0.20 | 1.50 | 0.25 |");
  EXPECT_EQ(lines[4], "| geometric mean | 0.100 | 0.200 | 0.400 | 0.200 | - | - | - |");
}

TEST_F(EvaluateRecordings, SummarisesVariantsByTheFirstOfTheirDepthRate) {
  const auto lines = Table("--summary a b --variant 'plain:' --variant 'worse: --set worse=1'");
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[0], "| variant | a: ATE mm, mean / worst | b: ATE mm, mean / worst | x plain | lost |");
  EXPECT_EQ(lines[2], "| plain | 1.00 / 1.00 | 1.00 / 1.00 | 1.00 | 0 |");
  EXPECT_EQ(lines[3], "| worse | 4.00 / 4.00 | 4.00 / 4.00 | 4.00 | 0 |");
}

TEST_F(EvaluateRecordings, SaysWhatFailedAndGoesOnWithTheRest) {
  const auto lines = Table("--variant 'bad: --set unknown=1' --variant 'plain:'", 1);
  ASSERT_EQ(lines.size(), 6U);
  EXPECT_EQ(lines[2].find("| a | all | bad | failed: devo_offline: unknown key |"), 0U) << lines[2];
  EXPECT_EQ(lines[3].find("| a | all | plain | 0.10 |"), 0U) << lines[3];
}

TEST_F(EvaluateRecordings, SaysWhatWasAskedForWhereNoRecordingIsThere) {
  EXPECT_TRUE(Table("--only desk", 2).empty());
  const std::string expected = "no recording: expected one of " + folder() + "/table.txt";
  EXPECT_EQ(LastError(), expected + " whose name contains 'desk', its bags in " + folder());
  for (const char* name : {"/a.bag", "/b.bag"}) std::filesystem::remove(folder() + name);
  EXPECT_TRUE(Table("", 2).empty());
  EXPECT_EQ(LastError(), expected + ", its bags in " + folder());
}

TEST_F(EvaluateRecordings, OfPeersSaysWhatWasAskedForWhereNoRecordingIsThere) {
  std::filesystem::copy(folder() + "/devo_offline", folder() + "/devo_rgbd_baseline");
  const int ended = Run("compare_peers.py", "--programs " + folder());
  EXPECT_TRUE(WIFEXITED(ended) && WEXITSTATUS(ended) == 2);
  EXPECT_EQ(LastError(), "no recording: expected one of " + folder() + "/table.txt whose name contains 'noisy'" +
                             ", its bags in " + folder());
}

TEST_F(EvaluateRecordings, KeepsNoResultsOfItsOwn) {
  Table("");
  EXPECT_TRUE(std::filesystem::is_empty(folder() + "/temporary"));
}

}  // namespace
}  // namespace devo
