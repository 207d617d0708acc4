// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/trajectory.h"

#include <cstdio>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

Rigid3 AnyPose(double s) { return {ExpSO3({0.3 * s, -0.2 * s, 0.1 * s}), {s, 2 * s, -s}}; }

class TrajectoryFile : public ::testing::Test {
 protected:
  void SetUp() override { path_ = ::testing::TempDir() + "trajectory_test.txt"; }
  void TearDown() override { std::remove(path_.c_str()); }
  void Write(const std::string& text) { std::ofstream(path_) << text; }

  std::string path_;
};

TEST_F(TrajectoryFile, KeepsEveryNanosecondOfAnAbsoluteStamp) {
  const std::int64_t t_ns = 1675956550318679123;
  WriteTum(path_, {{t_ns, AnyPose(1)}});
  const Trajectory read = ReadTum(path_);
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(read[0].t_ns, t_ns);
}

TEST_F(TrajectoryFile, KeepsPosesToATenthOfAMicrometreAndANanoradian) {
  WriteTum(path_, {{1000, AnyPose(1)}, {2000, AnyPose(2)}});
  const Trajectory read = ReadTum(path_);
  ASSERT_EQ(read.size(), 2U);
  const Rigid3 error = AnyPose(2).inverse() * read[1].T_world_body;
  EXPECT_LT(error.translation().norm(), 2e-7);
  EXPECT_LT(RotationAngle(error), 1e-8);
}

TEST_F(TrajectoryFile, SkipsCommentsSortsByTimeAndKeepsTheFirstOfRepeatedStamps) {
  Write("# t tx ty tz qx qy qz qw\n\n2.5 1 0 0 0 0 0 1\n1.25 2 0 0 0 0 0 1\n2.5 3 0 0 0 0 0 1\n");
  const Trajectory read = ReadTum(path_);
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].t_ns, 1250000000);
  EXPECT_EQ(read[1].t_ns, 2500000000);
  EXPECT_DOUBLE_EQ(read[1].T_world_body.translation().x(), 1);
}

TEST_F(TrajectoryFile, NamesTheLineThatIsNoPose) {
  Write("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n");
  EXPECT_THAT([&] { ReadTum(path_); },
              ThrowsMessage<std::runtime_error>(HasSubstr("line 2: expected 't tx ty tz qx qy qz qw'")));
  Write("1 0 0 nan 0 0 0 1\n");
  EXPECT_THAT([&] { ReadTum(path_); }, ThrowsMessage<std::runtime_error>(HasSubstr("line 1")));
  Write("1 0 0 0 0 0 0 0\n");
  EXPECT_THAT([&] { ReadTum(path_); }, ThrowsMessage<std::runtime_error>(HasSubstr("line 1")));
}

TEST_F(TrajectoryFile, NamesTheFileThatIsMissing) {
  EXPECT_THAT([&] { ReadTum("no/such/file.txt"); }, ThrowsMessage<std::runtime_error>(HasSubstr("'no/such/file.txt'")));
}

TEST(TumLine, IsTheSameForBothSignsOfAQuaternion) {
  const Rigid3 T = AnyPose(1);
  Eigen::Quaterniond negative = T.rotation();
  negative.coeffs() *= -1;
  EXPECT_EQ(TumLine({5, T}), TumLine({5, Rigid3(negative, T.translation())}));
}

TEST(WithEpoch, GivesAFileBesideTheTrajectorys) {
  EXPECT_EQ(WithEpoch("/a.b/trajectory.txt", 2), "/a.b/trajectory_epoch2.txt");
  EXPECT_EQ(WithEpoch("trajectory", 10), "trajectory_epoch10");
}

TEST(PoseAt, LiesOnTheScrewMotionBetweenTheNeighbours) {
  const Trajectory trajectory = {{0, AnyPose(0)}, {100, AnyPose(1)}};
  const auto middle = PoseAt(trajectory, 25, 100);
  ASSERT_TRUE(middle);
  const Rigid3 expected = Interpolate(AnyPose(0), AnyPose(1), 0.25);
  EXPECT_LT((middle->matrix() - expected.matrix()).norm(), 1e-12);
}

TEST(PoseAt, BridgesNoGapLongerThanAsked) {
  const Trajectory trajectory = {{0, AnyPose(0)}, {100, AnyPose(1)}, {301, AnyPose(2)}};
  EXPECT_TRUE(PoseAt(trajectory, 50, 200));
  EXPECT_FALSE(PoseAt(trajectory, 200, 200));
  EXPECT_TRUE(PoseAt(trajectory, 301, 200));
}

TEST(PoseAt, DoesNotExtrapolate) {
  const Trajectory trajectory = {{10, AnyPose(0)}, {20, AnyPose(1)}};
  EXPECT_FALSE(PoseAt(trajectory, 9, 100));
  EXPECT_FALSE(PoseAt(trajectory, 21, 100));
  EXPECT_FALSE(PoseAt({}, 21, 100));
}

}  // namespace
}  // namespace devo
