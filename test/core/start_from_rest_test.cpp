// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/start_from_rest.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr double kPush_m_s2 = 1.5;
const Eigen::Vector3d kGravity_m_s2(0, -9.81,
                                    0);  // y points down in the image, an accelerometer reads what holds it up

/// At rest for a second, then pushed along x; read until `end_ms`.
InertialBuffer Read(int end_ms, bool accelerometer = true) {
  InertialBuffer buffer;
  for (int ms = 0; ms <= end_ms; ms += 5) {
    const Eigen::Vector3d force = kGravity_m_s2 + Eigen::Vector3d(ms > 1000 ? kPush_m_s2 : 0, 0, 0);
    buffer.Add({ms * kMs,
                {0.01, 0, 0},
                accelerometer ? force : Eigen::Vector3d(Eigen::Vector3d::Constant(std::nan(""))),
                {0, 0, 0}});
  }
  return buffer;
}

const RestDetector::Span kRest = {0, 1000 * kMs, {1e-4, 1e-3}};

LocalMap MapAt(int ms) {
  LocalMap map;
  map.t_ns = ms * kMs;
  map.T_world_ref = Rigid3::Translation({1, 2, 3});
  return map;
}

std::optional<StartFromRest> Follow(int map_ms, const InertialBuffer& inertial) {
  return FollowFromRest(kRest, MapAt(map_ms), inertial, TrackingOptions());
}

TEST(StartFromRest, KnowsTheVelocityThatTheSensorSawGrow) {
  const auto start = Follow(1300, Read(1400));
  ASSERT_TRUE(start);
  EXPECT_EQ(start->motion.time_ns(), 1300 * kMs);
  EXPECT_LT((start->motion.pose().translation() - Eigen::Vector3d(1, 2, 3)).norm(), 1e-9);
  const Vector6d velocity = start->motion.velocity_event();
  EXPECT_NEAR(velocity[0], 0.3 * kPush_m_s2, 0.05);
  EXPECT_LT(velocity.segment<2>(1).norm(), 0.05);
  EXPECT_LT(velocity.tail<3>().norm(), 2e-3) << "what it reads at rest is its bias";
}

TEST(StartFromRest, TellsWhereTheCameraRested) {
  const auto start = Follow(1300, Read(1400));
  ASSERT_TRUE(start);
  ASSERT_EQ(start->rested.size(), 2U);
  EXPECT_EQ(start->rested[0].t_ns, 0);
  EXPECT_EQ(start->rested[1].t_ns, 1000 * kMs);
  for (const auto& rested : start->rested)
    EXPECT_NEAR(rested.T_world_event.translation().x(), 1 - 0.5 * kPush_m_s2 * 0.3 * 0.3, 0.01);
}

TEST(StartFromRest, IsNoneWhereTheSensorDidNotReadAllOfTheWay) {
  EXPECT_FALSE(Follow(1300, Read(1200)));
  EXPECT_FALSE(Follow(1300, Read(1400, false))) << "no accelerometer";
  EXPECT_FALSE(Follow(1300, InertialBuffer()));
}

TEST(StartFromRest, IsNoneLongAfterTheRest) {
  EXPECT_TRUE(Follow(3900, Read(4200)));
  EXPECT_FALSE(Follow(4100, Read(4200)));
}

}  // namespace
}  // namespace devo
