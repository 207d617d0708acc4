// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/drawn_path.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

std_msgs::Header HeaderAt(int second) {
  std_msgs::Header header;
  header.stamp = ros::Time(second, 0);
  header.frame_id = "odom";
  return header;
}

TEST(DrawnPath, DoesNotGrowAtRest) {
  DrawnPath path(0.01);
  EXPECT_TRUE(path.Extend(HeaderAt(1), Rigid3()));
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(path.Extend(HeaderAt(2 + i), Rigid3::Translation({0.009, 0, 0})));
  EXPECT_TRUE(path.Extend(HeaderAt(200), Rigid3::Translation({0.011, 0, 0})));
  EXPECT_TRUE(path.Extend(HeaderAt(201), Rigid3(ExpSO3({0, 0, 0.03}), {0.011, 0, 0})));
  ASSERT_EQ(path.message().poses.size(), 3U);
  EXPECT_EQ(path.message().poses[1].header.stamp, ros::Time(200));
  EXPECT_EQ(path.message().header.frame_id, "odom");
}

TEST(DrawnPath, KeepsBothEndsOfALongWayWithABoundedNumberOfPoses) {
  DrawnPath path(0.01);
  for (int i = 0; i < 50000; ++i) path.Extend(HeaderAt(1 + i), Rigid3::Translation({0.02 * i, 0, 0}));
  EXPECT_LE(path.message().poses.size(), 8000U);
  EXPECT_EQ(path.message().poses.front().pose.position.x, 0);
  EXPECT_NEAR(path.message().poses.back().pose.position.x, 0.02 * 49999, 1e-9);
}

TEST(DrawnPath, BeginsAnewWhenItIsCleared) {
  DrawnPath path(0.01);
  path.Extend(HeaderAt(1), Rigid3());
  path.Clear();
  EXPECT_TRUE(path.message().poses.empty());
  EXPECT_TRUE(path.Extend(HeaderAt(2), Rigid3()));
}

}  // namespace
}  // namespace devo
