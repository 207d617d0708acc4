// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/standstill.h"

#include <gtest/gtest.h>

#include "segment_scene.h"

namespace devo {
namespace {

using Kind = Standstill::Kind;

constexpr std::int64_t kPeriod_ns = 10'000'000;
constexpr double kStill_hz = 0.15;

/// A camera that moves sideways before a scene, tracked without an inertial sensor; its velocity is known to 1 cm/s.
struct Moving {
  Camera camera = SegmentCamera();
  LocalMap map;
  MotionFilter filter{TrackingOptions()};
  InertialBuffer inertial;
  DepthFusion depth;
  Standstill standstill{100, kStill_hz};

  explicit Moving(double speed_m_s) {
    map.points = SegmentScene(1, 1);
    filter.Start(0, Rigid3());
    Believe(speed_m_s);
    for (int k = 0; k < 50; ++k) Next(10);
  }

  /// From now on its velocity is thought to be this.
  void Believe(double speed_m_s) {
    Vector6d velocity = Vector6d::Zero();
    velocity[0] = speed_m_s;
    filter.Start(filter.time_ns(), filter.pose(), velocity, 0.01);
  }

  TrackedMotion Known(bool lost = false) const { return {filter, inertial, depth, map, camera, lost}; }

  /// At the next surface, of so many events per pixel and second.
  Kind Next(double activity_hz, bool lost = false) {
    Surface surface;
    surface.t_ns = surface.t_edges_ns = filter.time_ns() + kPeriod_ns;
    surface.activity_hz = activity_hz;
    surface.still = activity_hz < kStill_hz;
    const Kind kind = standstill.Judge(surface, surface.still, Known(lost));
    standstill.Note(surface, surface.still, surface.still ? 0 : Known().Flow(filter.velocity_event()));
    const Rigid3 T_world_event = filter.pose() * Exp(filter.velocity_event() * 1e-9 * kPeriod_ns);
    filter.Update(surface.t_ns, T_world_event, 1e6 * Matrix6d::Identity());
    return kind;
  }
};

TEST(Standstill, IsThatOfACameraWhoseEventsBecameFewerAsItSlowedDown) {
  Moving moving(0.02);
  for (const double activity_hz : {6.0, 3.0, 1.0, 0.3}) EXPECT_EQ(moving.Next(activity_hz), Kind::kMoving);
  EXPECT_EQ(moving.Next(0.1), Kind::kStill);
  EXPECT_TRUE(moving.standstill.held());
  EXPECT_EQ(moving.standstill.last_events_ns(), moving.filter.time_ns() - kPeriod_ns);
}

TEST(Standstill, IsNoneWhereTheEventsOfAFastMotionEndAtOnceButNotForever) {
  Moving moving(0.5);
  for (int k = 0; k < 90; ++k) ASSERT_EQ(moving.Next(0), Kind::kCoasting) << k;
  Kind last = Kind::kCoasting;
  for (int k = 0; k < 20; ++k) last = moving.Next(0);
  EXPECT_EQ(last, Kind::kStill);
}

TEST(Standstill, IsNotEndedByAVelocityThatIsLearntInIt) {
  Moving moving(0.02);
  while (moving.Next(0) != Kind::kStill) ASSERT_LT(moving.filter.time_ns(), 2'000'000'000);
  moving.Believe(0.5);
  EXPECT_EQ(moving.Next(0), Kind::kStill);
  EXPECT_EQ(moving.Next(10), Kind::kMoving) << "events end it";
}

TEST(Standstill, IsEndedByWhatElseSeesTheCameraMove) {
  Moving moving(0.02);
  while (moving.Next(0) != Kind::kStill) ASSERT_LT(moving.filter.time_ns(), 2'000'000'000);
  moving.Believe(0.5);
  moving.standstill.MoveOn(moving.filter.time_ns());
  EXPECT_FALSE(moving.standstill.held());
  EXPECT_EQ(moving.Next(0), Kind::kCoasting);
}

TEST(Standstill, IsWhatALostCameraIsTakenToBeIn) {
  Moving moving(0.4);
  for (const double activity_hz : {6.0, 3.0, 1.0, 0.3}) moving.Next(activity_hz);
  Moving lost = moving;
  EXPECT_EQ(moving.Next(0.1), Kind::kCoasting) << "its velocity is known";
  EXPECT_EQ(lost.Next(0.1, true), Kind::kStill) << "it is a guess";
}

TEST(Standstill, ForgetsAllWhenCleared) {
  Moving moving(0.5);
  EXPECT_EQ(moving.Next(0), Kind::kCoasting);
  moving.standstill.Clear();
  EXPECT_FALSE(moving.standstill.coasting());
  EXPECT_EQ(moving.standstill.last_active_ns(), 0);
  EXPECT_EQ(moving.standstill.last_events_ns(), 0);
}

}  // namespace
}  // namespace devo
