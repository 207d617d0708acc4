// SPDX-License-Identifier: BSD-3-Clause
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "devo/sim/scene.h"

namespace devo {
namespace {

/// Scripts that simulate recordings, with a simulator that only notes what it is asked for.
class SimulationScript : public ::testing::Test {
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

  void Run(const std::string& script, const std::string& arguments = "") const {
    const std::string command =
        DEVO_SOURCE_DIR "/scripts/" + script + " " + folder_ + " --devo-simulate " + folder_ + "/simulate " + arguments;
    EXPECT_EQ(std::system(command.c_str()), 0);
  }
  void DrawAtRandom(int count, int seed) const {
    Run("simulate_at_random.py", "--count " + std::to_string(count) + " --seed " + std::to_string(seed));
  }
  std::string PathOf(const std::string& name) const { return folder_ + "/" + name; }
  std::vector<std::string> Lines(const std::string& name) const {
    std::ifstream file(PathOf(name));
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }
  static std::vector<std::string> Columns(const std::string& row) {
    std::istringstream words(row);
    return {std::istream_iterator<std::string>(words), {}};
  }

 private:
  std::string folder_ = ::testing::TempDir() + "simulation_scripts_test_" + std::to_string(getpid());
};

TEST_F(SimulationScript, AtRandomWritesATableOfWhatItSimulatesAndKeepsWhatIsThere) {
  DrawAtRandom(3, 1);
  const auto first = Lines("random.txt");
  ASSERT_EQ(first.size(), 3U);
  EXPECT_EQ(Lines("asked").size(), 3U);
  DrawAtRandom(5, 1);
  const auto more = Lines("random.txt");
  ASSERT_EQ(more.size(), 5U);
  EXPECT_TRUE(std::equal(first.begin(), first.end(), more.begin())) << "the same seed draws the same";
  EXPECT_EQ(Lines("asked").size(), 5U) << "those that were missing";
  for (const std::string& row : more) {
    const auto columns = Columns(row);
    ASSERT_EQ(columns.size(), 3U) << row;
    EXPECT_EQ(columns[2], columns[0] + ".bag");
    EXPECT_NE(columns[1].find("/" + columns[0] + ".yaml"), std::string::npos);
  }
}

TEST_F(SimulationScript, AtRandomDrawsOthersForAnotherSeed) {
  DrawAtRandom(4, 1);
  const auto one = Lines("random.txt");
  DrawAtRandom(4, 2);
  EXPECT_NE(one, Lines("random.txt"));
}

TEST_F(SimulationScript, OfMotionsWritesEachAsASmoothWayThatBeginsFromRest) {
  Run("simulate_motions.py");
  const auto table = Lines("motions.txt");
  ASSERT_GT(table.size(), 15U);
  EXPECT_EQ(Lines("asked").size(), table.size());
  for (const std::string& row : table) {
    const std::string name = row.substr(0, row.find(' '));
    std::vector<double> first, last;
    for (const std::string& line : Lines(name + "_motion.txt")) {
      std::istringstream numbers(line);
      const std::vector<double> pose{std::istream_iterator<double>(numbers), {}};
      ASSERT_EQ(pose.size(), 8U) << line;
      if (first.empty()) first = last = pose;
      const auto moved = [&pose](const std::vector<double>& from, std::size_t begin, std::size_t end) {
        double squares = 0;
        for (std::size_t i = begin; i < end; ++i) squares += std::pow(pose[i] - from[i], 2);
        return std::sqrt(squares);
      };
      if (pose[0] < 0.3) {
        EXPECT_LT(moved(first, 1, 8), 1e-9) << line;
      }
      EXPECT_LT(moved(last, 1, 4), 0.005 * 4) << name << ": " << line;  // 4 m/s
      EXPECT_LT(moved(last, 4, 8), 0.005 * 4) << name << ": " << line;  // 8 rad/s: half of that of the quaternion
      last = pose;
    }
    EXPECT_DOUBLE_EQ(last.at(0), 4.5);
  }
}

/// Of a scene, points 5 % of its size apart on each surface, or on the square around a disc.
std::vector<Eigen::Vector3d> PointsOf(const sim::Scene& scene) {
  std::vector<Eigen::Vector3d> points;
  for (const sim::Surface& surface : scene.surfaces()) {
    const double radius = surface.size_u;
    double begin = 0, end_a = surface.size_u, end_b = surface.size_v;
    if (surface.kind == sim::SurfaceKind::kCylinder) end_a = 2 * M_PI * radius;
    if (surface.kind == sim::SurfaceKind::kDisc) begin = -radius, end_a = end_b = radius;
    for (double a = 0; a <= 1; a += 0.05) {
      for (double b = 0; b <= 1; b += 0.05)
        points.push_back(sim::PointOn(surface, begin + a * (end_a - begin), begin + b * (end_b - begin)));
    }
  }
  return points;
}

TEST_F(SimulationScript, OfScenesDrawsRoomsInWhichNothingIsWhereTheCameraMoves) {
  Run("simulate_scenes.py", "--count 5");
  const auto table = Lines("scenes.txt");
  ASSERT_EQ(table.size(), 5U);
  for (const std::string& row : table) {
    const sim::Scene scene = sim::LoadScene(PathOf(Columns(row).at(0) + "_scene.yaml"));
    const Eigen::AlignedBox3d where(scene.motion.position_min, scene.motion.position_max);
    EXPECT_GT(scene.surfaces().size(), 6U) << row;
    for (const Eigen::Vector3d& point : PointsOf(scene))
      ASSERT_GT(where.exteriorDistance(point), 0.3) << row << ": " << point.transpose();
  }
}

TEST_F(SimulationScript, OfScenesNamesRoomsWithPeopleOtherwiseThanWithout) {
  Run("simulate_scenes.py", "--count 2");
  const auto empty = Lines("scenes.txt"), scene = Lines(Columns(empty.at(0)).at(0) + "_scene.yaml");
  Run("simulate_scenes.py", "--count 2 --people 1");
  const auto peopled = Lines("scenes.txt");
  ASSERT_EQ(peopled.size(), 2U);
  EXPECT_EQ(Lines("asked").size(), 4U) << "none is taken for one that is there";
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NE(Columns(peopled[i]).at(0), Columns(empty[i]).at(0));
  EXPECT_EQ(Lines(Columns(empty[0]).at(0) + "_scene.yaml"), scene);
}

TEST_F(SimulationScript, OfToursWalksRoundTheRoomPastItsFurnitureAndComesByTheBeginningAgain) {
  Run("simulate_tours.py", "--count 2");
  const auto table = Lines("tours.txt");
  ASSERT_EQ(table.size(), 2U);
  for (const std::string& row : table) {
    const std::string name = Columns(row).at(0);
    const auto points = PointsOf(sim::LoadScene(PathOf(name + "_scene.yaml")));
    std::vector<Eigen::Vector3d> way;
    for (const std::string& line : Lines(name + "_way.txt")) {
      const auto pose = Columns(line);
      way.emplace_back(std::stod(pose.at(1)), std::stod(pose.at(2)), std::stod(pose.at(3)));
    }
    ASSERT_EQ(way.size(), 3001U) << "a minute in steps of 20 ms";
    for (std::size_t i = 0; i < way.size(); i += 25) {
      for (const Eigen::Vector3d& point : points)
        ASSERT_GT((way[i] - point).norm(), 0.5) << row << ": " << point.transpose();
    }
    const auto to_begin = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
      return (a - way[0]).norm() < (b - way[0]).norm();
    };
    EXPECT_LT((*std::min_element(way.begin() + 500, way.end(), to_begin) - way[0]).norm(), 0.2) << row;
    EXPECT_GT((*std::max_element(way.begin(), way.end(), to_begin) - way[0]).norm(), 2) << row;
  }
}

TEST_F(SimulationScript, OfNoisierRecordingsUnpacksWhatIsMissingAndNamesWhatItDoesNotFind) {
  const std::string script = DEVO_SOURCE_DIR "/scripts/unpack_noisier.sh ", shared = PathOf("shared");
  const auto run = [&](const std::string& arguments) { return std::system((script + arguments).c_str()); };
  EXPECT_NE(run(shared + " " + PathOf("noisier") + " 2> " + PathOf("error")), 0);
  EXPECT_EQ(Lines("error").at(0), shared + "/recording.py: not there, expected the script that unpacks recordings");
  ASSERT_EQ(std::system(("mkdir -p " + shared).c_str()), 0);
  std::ofstream(shared + "/recording.py") << "import sys\nopen(sys.argv[3], 'w')\nopen('" << PathOf("asked")
                                          << "', 'a').write(' '.join(sys.argv) + '\\n')\n";
  ASSERT_EQ(run(shared + " " + PathOf("noisier")), 0);
  ASSERT_EQ(run(shared + " " + PathOf("noisier")), 0);
  const auto table = Lines("noisier/noisier.txt");
  EXPECT_EQ(table.size(), 30U);
  EXPECT_EQ(Lines("asked").size(), 30U) << "those that were missing";
  for (const std::string& row : table) {
    const auto columns = Columns(row);
    ASSERT_EQ(columns.size(), 3U) << row;
    EXPECT_TRUE(std::ifstream(DEVO_SOURCE_DIR "/" + columns[1])) << row;
    EXPECT_TRUE(std::ifstream(PathOf("noisier/" + columns[2]))) << row;
  }
}

}  // namespace
}  // namespace devo
