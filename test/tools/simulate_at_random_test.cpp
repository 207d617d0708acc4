// SPDX-License-Identifier: BSD-3-Clause
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace devo {
namespace {

/// The script, with a simulator that only notes what it is asked for.
class SimulateAtRandom : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(std::system(("mkdir -p " + folder_).c_str()), 0);
    std::ofstream(folder_ + "/simulate") << "#!/bin/sh\n"
                                            "touch \"$2.bag\"\n"
                                            "echo \"$@\" >> "
                                         << folder_ << "/asked\n";
    ASSERT_EQ(chmod((folder_ + "/simulate").c_str(), 0755), 0);
  }
  void TearDown() override { EXPECT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  void Run(int count, int seed) const {
    const std::string command = DEVO_SOURCE_DIR "/scripts/simulate_at_random.py " + folder_ + " --count " +
                                std::to_string(count) + " --seed " + std::to_string(seed) + " --devo-simulate " +
                                folder_ + "/simulate";
    EXPECT_EQ(std::system(command.c_str()), 0);
  }
  std::vector<std::string> Lines(const std::string& name) const {
    std::ifstream file(folder_ + "/" + name);
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }

 private:
  std::string folder_ = ::testing::TempDir() + "simulate_at_random_test_" + std::to_string(getpid());
};

TEST_F(SimulateAtRandom, WritesATableOfWhatItSimulatesAndKeepsWhatIsThere) {
  Run(3, 1);
  const auto first = Lines("random.txt");
  ASSERT_EQ(first.size(), 3U);
  EXPECT_EQ(Lines("asked").size(), 3U);
  Run(5, 1);
  const auto more = Lines("random.txt");
  ASSERT_EQ(more.size(), 5U);
  EXPECT_TRUE(std::equal(first.begin(), first.end(), more.begin())) << "the same seed draws the same";
  EXPECT_EQ(Lines("asked").size(), 5U) << "those that were missing";
  for (const std::string& row : more) {
    std::istringstream words(row);
    const std::vector<std::string> columns{std::istream_iterator<std::string>(words), {}};
    ASSERT_EQ(columns.size(), 3U) << row;
    EXPECT_EQ(columns[2], columns[0] + ".bag");
    EXPECT_NE(columns[1].find("/" + columns[0] + ".yaml"), std::string::npos);
  }
}

TEST_F(SimulateAtRandom, DrawsOthersForAnotherSeed) {
  Run(4, 1);
  const auto one = Lines("random.txt");
  Run(4, 2);
  EXPECT_NE(one, Lines("random.txt"));
}

}  // namespace
}  // namespace devo
