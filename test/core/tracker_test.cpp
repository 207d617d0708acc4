// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/tracker.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "devo/core/nearest_edge_field.h"
#include "devo/core/time.h"
#include "segment_scene.h"

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 10'000'000;

Camera TestCamera() { return SegmentCamera(); }

/// Segments 1.5 to 3 m away, as a local map at the identity.
LocalMapPtr Map(std::uint64_t epoch = 0) {
  auto map = std::make_shared<LocalMap>();
  map->epoch = epoch;
  map->points = SegmentScene(14, 1.5);
  return map;
}

/// What a camera at the pose sees of the map.
Surface Seen(std::int64_t t_ns, const Rigid3& T_world_event) {
  static const LocalMapPtr map = Map();
  Surface surface = SegmentsSeen(map->points, T_world_event.inverse());
  surface.t_ns = surface.t_edges_ns = t_ns;
  surface.activity_hz = 5;
  return surface;
}

/// Events of a camera in motion that make no edge.
Surface Blank(std::int64_t t_ns) {
  Surface surface = Seen(t_ns, Rigid3());
  surface.edges.clear();
  surface.nearest_edge.setTo(Surface::kNoEdge);
  return surface;
}

/// Too few events to see motion.
Surface Still(std::int64_t t_ns, double activity_hz = 0.01) {
  Surface surface = Blank(t_ns);
  surface.activity_hz = activity_hz;
  surface.still = surface.maybe_noise = true;
  return surface;
}

Vector6d Twist() {
  Vector6d twist;
  twist << 0.3, -0.1, 0.1, 0.05, 0.1, -0.2;
  return twist;
}
Rigid3 TrueAt(std::int64_t t_ns) { return Exp(Twist() * SecondsFromNs(t_ns)); }

/// In m and rad.
double ErrorOf(const PoseEstimate& pose) { return Log(TrueAt(pose.t_ns).inverse() * pose.T_world_event).norm(); }

/// A tracker that has followed the constant motion for 50 surfaces.
std::unique_ptr<Tracker> Moving(const TrackingIdeas& ideas = {}) {
  OdometryOptions options;
  options.tracking.ideas = ideas;
  auto tracker = std::make_unique<Tracker>(TestCamera(), options);
  tracker->SetMap(Map());
  for (int k = 1; k <= 50; ++k) tracker->Track(Seen(k * kPeriod_ns, TrueAt(k * kPeriod_ns)));
  return tracker;
}
constexpr std::int64_t kNow_ns = 50 * kPeriod_ns;

TEST(Tracker, HasNoPoseWithoutAMap) {
  Tracker tracker(TestCamera(), OdometryOptions());
  EXPECT_FALSE(tracker.Track(Seen(kPeriod_ns, Rigid3())));
  EXPECT_TRUE(tracker.SurfaceVelocity().isZero());
}

TEST(Tracker, IgnoresAMapOfAnotherEpoch) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map(1));
  EXPECT_FALSE(tracker.Track(Seen(kPeriod_ns, Rigid3())));
}

TEST(Tracker, FollowsACameraInMotionFromTheTimeOfAFirstMapThatComesLate) {
  Vector6d fast;
  fast << 2, -1, 1, 0.3, 1.2, -1.3;
  const auto at = [&](int k) { return Exp(fast * SecondsFromNs(k * kPeriod_ns)); };
  Tracker waiting(TestCamera(), OdometryOptions()), sudden(TestCamera(), OdometryOptions());
  const auto last = std::make_shared<const Surface>(Seen(10 * kPeriod_ns, at(10)));
  for (int k = 1; k < 10; ++k) {
    EXPECT_FALSE(waiting.Track(std::make_shared<const Surface>(Seen(k * kPeriod_ns, at(k)))));
  }
  for (Tracker* tracker : {&waiting, &sudden}) {
    tracker->SetMap(Map());  // of the time 0
    ASSERT_TRUE(tracker->Track(last));
  }
  const auto pose = waiting.Track(std::make_shared<const Surface>(Seen(11 * kPeriod_ns, at(11))));
  EXPECT_LT(Log(at(11).inverse() * pose->T_world_event).norm(), 3e-3);
  EXPECT_LT((waiting.SurfaceVelocity() - fast).norm(), 0.3);
  EXPECT_GT((sudden.SurfaceVelocity() - fast).norm(), 1);
}

TEST(Tracker, BeginsInMotionWithTheTurnThatEventsTell) {
  Vector6d fast = Vector6d::Zero();
  fast.tail<3>() << 4, -6, 1;
  OdometryOptions options;
  options.tracking.ideas.search = false;
  for (const bool told : {true, false}) {
    Tracker tracker(TestCamera(), options);
    tracker.SetMap(Map());  // of the time 0
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 10; ++k) {
      Surface surface = Seen(k * kPeriod_ns, Exp(fast * SecondsFromNs(k * kPeriod_ns)));
      if (told) surface.turn_event = fast.tail<3>();
      pose = tracker.Track(surface);
      ASSERT_TRUE(pose);
    }
    const double error = Log(Exp(fast * SecondsFromNs(pose->t_ns)).inverse() * pose->T_world_event).norm();
    EXPECT_EQ(error < 3e-3, told) << error;
  }
}

TEST(Tracker, BeginsInMotionWithTheVelocityThatSurfacesShowBesideAnInertialSensorsTurn) {
  Vector6d fast;
  fast << -0.9, 1.2, 0, 0.3, 1.2, -1.3;
  const auto at = [&](int k) { return Exp(fast * SecondsFromNs(k * kPeriod_ns)); };
  auto near = std::make_shared<LocalMap>(*Map());  // of the time 0; the image moves by 10 pixels per surface
  for (MapPoint& point : near->points) point.p_ref *= 0.12F;
  OdometryOptions options;
  options.tracking.ideas.search = false;
  Tracker tracker(TestCamera(), options);
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 4; ++k) {
    for (int i = -5; i <= 0; ++i) {
      ImuSample sample;
      sample.t_ns = k * kPeriod_ns + i * kPeriod_ns / 5;
      sample.angular_velocity = fast.tail<3>();
      sample.linear_acceleration.setConstant(std::nan(""));
      tracker.AddImu(sample);
    }
    Surface surface = SegmentsSeen(near->points, at(k).inverse());
    surface.t_ns = surface.t_edges_ns = k * kPeriod_ns;
    surface.activity_hz = 5;
    if (k == 4) tracker.SetMap(near);
    pose = tracker.Track(std::make_shared<const Surface>(surface));
  }
  ASSERT_TRUE(pose);
  EXPECT_LT((tracker.SurfaceVelocity() - fast).norm(), 0.1);
  EXPECT_LT(Log(at(4).inverse() * pose->T_world_event).norm(), 2e-3);
}

TEST(Tracker, SaysWhereTheCameraWasSinceTheTimeOfAFirstMapThatComesLate) {
  Vector6d velocity;
  velocity << 0.3, -0.1, 0.1, 0.1, 0.2, -0.2;
  const auto at = [&](int k) { return Exp(velocity * SecondsFromNs(k * kPeriod_ns)); };
  const auto seen = [&](int k) { return std::make_shared<const Surface>(Seen(k * kPeriod_ns, at(k))); };
  Tracker tracker(TestCamera(), OdometryOptions());
  for (int k = 1; k < 10; ++k) EXPECT_FALSE(tracker.Track(seen(k)));
  tracker.SetMap(Map());  // of the time 0
  const auto first = tracker.Track(seen(10));
  ASSERT_TRUE(first);
  ASSERT_EQ(first->earlier.size(), 10U);  // the map's own and nine of surfaces
  for (int k = 0; k < 10; ++k) {
    EXPECT_EQ(first->earlier[static_cast<std::size_t>(k)].t_ns, k * kPeriod_ns);
    EXPECT_LT(Log(at(k).inverse() * first->earlier[static_cast<std::size_t>(k)].T_world_event).norm(), 4e-3) << k;
  }
  EXPECT_TRUE(tracker.Track(seen(11))->earlier.empty());
}

TEST(Tracker, SaysThatAPoseFoundAnewDoesNotFollowFromThoseBefore) {
  Vector6d fast;
  fast << 2, -1, 1, 0.3, 1.2, -1.3;
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());  // of the time 0; too far away by now for anything but a search
  const auto pose = tracker.Track(Seen(10 * kPeriod_ns, Exp(fast * SecondsFromNs(10 * kPeriod_ns))));
  ASSERT_TRUE(pose);
  ASSERT_EQ(pose->earlier.size(), 1U);
  EXPECT_EQ(pose->earlier[0].t_ns, 10 * kPeriod_ns);
}

TEST(Tracker, ForgetsItsMapWhenANewEpochBegins) {
  const auto tracker = Moving();
  Surface surface = Seen(kPeriod_ns, Rigid3());
  surface.epoch = 1;
  EXPECT_FALSE(tracker->Track(surface));
  tracker->SetMap(Map(1));
  const auto pose = tracker->Track(surface);
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->epoch, 1U);
  EXPECT_LT(Log(pose->T_world_event).norm(), 1e-3);
}

TEST(Tracker, TakesNoMapOfAnEpochBeforeThatWasOnItsWay) {
  Tracker tracker(TestCamera(), OdometryOptions());
  const auto track = [&tracker](int k) {
    Surface surface = Seen(k * kPeriod_ns, Rigid3());
    surface.epoch = 1;
    return tracker.Track(surface);
  };
  EXPECT_FALSE(track(1));
  tracker.SetMap(Map(1));
  EXPECT_TRUE(track(2));
  tracker.SetMap(Map(0));
  EXPECT_TRUE(track(3)) << "it goes on in its own";
}

TEST(Tracker, FollowsAConstantMotionToAMillimetreAndKnowsItsVelocity) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  for (int k = 1; k <= 50; ++k) {
    const auto pose = tracker.Track(Seen(k * kPeriod_ns, TrueAt(k * kPeriod_ns)));
    ASSERT_TRUE(pose);
    ASSERT_EQ(pose->state, TrackingState::kTracking) << k;
    // It is started at rest, so the first poses lag behind.
    ASSERT_LT(Log(TrueAt(k * kPeriod_ns).inverse() * pose->T_world_event).norm(), k < 10 ? 5e-3 : 1e-3) << k;
    ASSERT_GT(pose->inlier_share, 0.9) << k;
    ASSERT_TRUE(pose->covariance_event.allFinite());
  }
  EXPECT_LT((tracker.SurfaceVelocity() - Twist()).norm(), 0.02);
}

/// Of a position, m, as stated after 0.3 s.
double StatedSigma_m(double rate_hz) {
  OdometryOptions options;
  options.surface.rate_hz = rate_hz;
  Tracker tracker(TestCamera(), options);
  tracker.SetMap(Map());
  const std::int64_t period_ns = NsFromSeconds(1 / rate_hz);
  std::optional<PoseEstimate> pose;
  for (std::int64_t t_ns = period_ns; t_ns <= NsFromSeconds(0.3); t_ns += period_ns) {
    pose = tracker.Track(Seen(t_ns, TrueAt(t_ns)));
  }
  return std::sqrt(pose->covariance_event.diagonal().head<3>().sum());
}

TEST(Tracker, IsNotSurerForBeingShownTheSameEventsMoreOften) {
  EXPECT_GT(StatedSigma_m(1000), 0.8 * StatedSigma_m(100));
}

TEST(Tracker, ContinuesThePoseOfTheEdgesToTheTimeOfTheSurface) {
  const auto tracker = Moving();
  Surface surface = Seen(kNow_ns + kPeriod_ns, TrueAt(kNow_ns + kPeriod_ns));
  surface.t_ns += kPeriod_ns;  // rendered later than its edges were where it shows them
  const auto pose = tracker->Track(surface);
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->t_edges_ns, kNow_ns + kPeriod_ns);
  EXPECT_EQ(pose->t_ns, kNow_ns + 2 * kPeriod_ns);
  EXPECT_LT(Log(TrueAt(pose->t_edges_ns).inverse() * pose->T_world_event_edges).norm(), 1e-3);
  EXPECT_LT(ErrorOf(*pose), 1e-3);
}

TEST(Tracker, TakesOtherOptionsWithoutLosingItsTrack) {
  const auto tracker = Moving();
  OdometryOptions hasty;
  hasty.tracking.max_iterations = 1;
  tracker->SetOptions(hasty);
  const auto pose = tracker->Track(Seen(kNow_ns + kPeriod_ns, TrueAt(kNow_ns + kPeriod_ns)));
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->iterations, 1);
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_LT(ErrorOf(*pose), 1e-3);
}

/// What an inertial sensor in the event camera reads of the constant motion.
ImuSample Read(std::int64_t t_ns) {
  const Eigen::Vector3d v = Twist().head<3>(), omega = Twist().tail<3>(), gravity_world(0, 9.81, 0);
  ImuSample sample;
  sample.t_ns = t_ns;
  sample.angular_velocity = omega;
  sample.linear_acceleration = omega.cross(v) - TrueAt(t_ns).rotation().conjugate() * gravity_world;
  return sample;
}

/// The five of the last period until `t_ns`.
template <typename Reader>
void AddReadings(const Reader& read, std::int64_t t_ns, Tracker* tracker) {
  for (int i = -4; i <= 0; ++i) tracker->AddImu(read(t_ns + i * kPeriod_ns / 5));
}

TEST(Tracker, KeepsWhatWasReadBeforeTheFirstSurfaceOfAnEpochThatItWasToldOf) {
  Tracker tracker(TestCamera(), OdometryOptions());
  AddReadings(Read, 100 * kPeriod_ns, &tracker);  // a bag that is played again: the times before come anew
  tracker.BeginEpoch(1);
  for (int k = 1; k <= 4; ++k) AddReadings(Read, k * kPeriod_ns, &tracker);
  Surface surface = Seen(4 * kPeriod_ns, TrueAt(4 * kPeriod_ns));
  surface.epoch = 1;
  EXPECT_FALSE(tracker.Track(surface));
  EXPECT_TRUE(tracker.TurnRead(4 * kPeriod_ns));
}

TEST(Tracker, KeepsAsManySurfacesForAFirstMapAtAHighRate) {
  Tracker tracker(TestCamera(), OdometryOptions());
  std::vector<std::weak_ptr<const Surface>> seen;
  for (int k = 1; k <= 1000; ++k) {
    const SurfacePtr surface = std::make_shared<Surface>(Seen(k * kPeriod_ns / 10, Rigid3()));
    EXPECT_FALSE(tracker.Track(surface));
    seen.push_back(surface);
  }
  const auto kept = std::count_if(seen.begin(), seen.end(), [](const auto& surface) { return !surface.expired(); });
  EXPECT_GE(kept, 25);
  EXPECT_LE(kept, 35);
}

TEST(Tracker, TellsTheTurnThatAGyroscopeReadsBeforeThereIsAMap) {
  Tracker tracker(TestCamera(), OdometryOptions());
  EXPECT_FALSE(tracker.TurnRead(4 * kPeriod_ns));
  for (int k = 1; k <= 4; ++k) AddReadings(Read, k * kPeriod_ns, &tracker);
  const auto turn = tracker.TurnRead(4 * kPeriod_ns);
  ASSERT_TRUE(turn);
  EXPECT_LT((*turn - Twist().tail<3>()).norm(), 1e-9);
  EXPECT_FALSE(tracker.TurnRead(8 * kPeriod_ns)) << "the readings end before";
}

/// What an inertial sensor in a camera that only moves along x reads.
ImuSample ReadAlongX(std::int64_t t_ns, double acceleration_m_s2) {
  ImuSample sample;
  sample.t_ns = t_ns;
  sample.angular_velocity.setZero();
  sample.linear_acceleration = Eigen::Vector3d(acceleration_m_s2, -9.81, 0);
  return sample;
}

// After a rest that is longer than readings are kept, with hardly an event, a camera is pushed ever harder along x; the
// first map is made 0.4 s later.
constexpr int kRestEnds = 1200, kMapAt = 1240;
double PushedSince_s(double k) { return 0.01 * std::max(0.0, k - kRestEnds); }
double PushedBy_m(double k) { return 4 / 6.0 * std::pow(PushedSince_s(k), 3); }

/// The poses until 0.1 s after that map. `dark`: the motion makes hardly an event, either.
std::vector<PoseEstimate> PosesAfterAStartInMotion(const OdometryOptions& options, bool dark) {
  Tracker tracker(TestCamera(), options);
  std::vector<PoseEstimate> poses;
  int read_until = 0;
  for (int k = 1; k <= kMapAt + 10; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    // In the rest, readings come 30 ms after the surfaces.
    for (; read_until < (k <= kRestEnds ? k - 3 : k); ++read_until) {
      for (int i = 1; i <= 5; ++i) {
        const double push_m_s2 = 4 * PushedSince_s(read_until + 0.2 * i);
        tracker.AddImu(ReadAlongX(read_until * kPeriod_ns + i * kPeriod_ns / 5, push_m_s2));
      }
    }
    if (k == kMapAt + 1) {
      auto map = std::make_shared<LocalMap>(*Map());
      map->t_ns = kMapAt * kPeriod_ns;
      tracker.SetMap(map);
    }
    // After the map nothing matches: the pose is what was known of the motion.
    Surface surface = Still(t_ns);
    surface.still = surface.maybe_noise = dark || k <= kRestEnds;
    surface.activity_hz = surface.still ? 0.01 : 5;
    if (auto pose = tracker.Track(surface)) poses.push_back(std::move(*pose));
  }
  return poses;
}

double ErrorAfterAStartInMotion(const OdometryOptions& options, bool dark) {
  const double moved_m = PushedBy_m(kMapAt + 10) - PushedBy_m(kMapAt);  // 41 mm
  const Rigid3 T_world_event = PosesAfterAStartInMotion(options, dark).back().T_world_event;
  return Log(Rigid3::Translation({-moved_m, 0, 0}) * T_world_event).norm();
}

TEST(Tracker, KnowsTheVelocityAtAFirstMapInMotionFromTheRestBefore) {
  OdometryOptions options;
  EXPECT_LT(ErrorAfterAStartInMotion(options, false), 4e-3);
  options.tracking.ideas.start_from_rest = false;
  EXPECT_GT(ErrorAfterAStartInMotion(options, false), 2e-2);
}

TEST(Tracker, SaysWhereTheRestBeforeAFirstMapInMotionWas) {
  const PoseEstimate first = PosesAfterAStartInMotion(OdometryOptions(), false).front();
  ASSERT_EQ(first.earlier.size(), 3U);
  EXPECT_LT(first.earlier[0].t_ns, first.earlier[1].t_ns);
  EXPECT_NEAR(SecondsFromNs(first.earlier[1].t_ns), 0.01 * kRestEnds, 0.2);
  EXPECT_EQ(first.earlier[2].t_ns, kMapAt * kPeriod_ns);
  for (int i : {0, 1}) {
    const Eigen::Vector3d rest = first.earlier[i].T_world_event.translation();
    EXPECT_LT((rest - Eigen::Vector3d(-PushedBy_m(kMapAt), 0, 0)).norm(), 5e-3) << rest.transpose();  // of 43 mm
  }
}

TEST(Tracker, GoesOnFromAFirstMapInMotionThatMakesHardlyAnEvent) {
  EXPECT_LT(ErrorAfterAStartInMotion(OdometryOptions(), true), 4e-3);
}

TEST(Tracker, IsLedLessFarAstrayByAStartWhoseSurfacesAreBlurredAlike) {
  const auto worst_m = [](bool moved_by_turn) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    double worst = 0;
    for (int k = 1; k <= 30; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      AddReadings(Read, t_ns, &tracker);
      // At first the edges seem to stand still.
      Surface surface = Seen(t_ns, TrueAt(k <= 5 ? 0 : t_ns));
      if (moved_by_turn && k <= 5) surface.turn_event = Twist().tail<3>();
      const auto pose = tracker.Track(surface);
      if (k > 5) worst = std::max(worst, ErrorOf(*pose));
    }
    return worst;
  };
  const double blurred_m = worst_m(true), sharp_m = worst_m(false);
  EXPECT_LT(blurred_m, 0.7 * sharp_m) << blurred_m << " and " << sharp_m;
}

TEST(Tracker, GoesOnWithTheInertialSensorWhereASlowMotionMakesTooFewEventsForAMoment) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 70; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(Read, t_ns, &tracker);
    // Fewer from surface to surface, as at a standstill, and none in the last ten.
    Surface surface = k <= 60 ? Seen(t_ns, TrueAt(t_ns)) : Still(t_ns);
    if (k > 50 && k <= 60) surface.activity_hz = 0.1 * (61 - k);
    pose = tracker.Track(surface);
  }
  ASSERT_TRUE(pose);
  EXPECT_LT(ErrorOf(*pose), 3e-3);  // held, it would be 3e-2
}

TEST(Tracker, GoesOnAsWithoutAnInertialSensorWhereThatIsShakenTooMuch) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const auto shaken = [&](std::int64_t t_ns) {
    ImuSample sample = Read(t_ns);
    for (int axis = 0; axis < 3; ++axis) sample.angular_velocity[axis] += 0.2 * normal(random);
    return sample;
  };
  const auto estimate = [&](bool read) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 30; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      if (read) AddReadings(shaken, t_ns, &tracker);
      // Before a tenth of a second its noise is not known.
      if (k > 10) pose = tracker.Track(Seen(t_ns, TrueAt(t_ns)));
    }
    return *pose;
  };
  const PoseEstimate pose = estimate(true);
  EXPECT_EQ(pose.T_world_event.translation(), estimate(false).T_world_event.translation());
  EXPECT_TRUE(pose.velocity_of_poses);
  EXPECT_EQ(pose.inertial_fit.gyroscope, 0);
  EXPECT_NEAR(pose.inertial_fit.gyroscope_noise, 0.2 / std::sqrt(500), 0.4 * 0.2 / std::sqrt(500));
  EXPECT_NE(Complaint(pose.inertial_fit).find("noisy or shaken"), std::string::npos) << Complaint(pose.inertial_fit);
}

TEST(Tracker, LeavesOutAnInertialSensorThatReadsOtherTurnsAndGoesOnWithout) {
  const auto follow = [](bool reads_others) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 60; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      const auto read = [reads_others](std::int64_t at_ns) {
        ImuSample sample = Read(at_ns);
        if (reads_others) sample.angular_velocity = -3 * sample.angular_velocity;
        return sample;
      };
      AddReadings(read, t_ns, &tracker);
      pose = tracker.Track(Seen(t_ns, TrueAt(t_ns)));
    }
    EXPECT_LT(ErrorOf(*pose), 1e-3);
    return *pose;
  };
  EXPECT_FALSE(follow(false).inertial_fit.left_out);
  const PoseEstimate pose = follow(true);
  EXPECT_TRUE(pose.inertial_fit.left_out);
  EXPECT_TRUE(pose.velocity_of_poses);
  EXPECT_NE(Complaint(pose.inertial_fit).find("check the IMU's place"), std::string::npos);
}

TEST(Tracker, TellsASlowMotionWithoutEventsFromAStopByTheInertialSensor) {
  // Events ebb away; then the camera goes on without, or slows down within 0.2 s.
  constexpr int kEventsEnd = 150;
  constexpr double kEnd_s = 0.01 * kEventsEnd, kSpeed_m_s = 0.12, kBraking_m_s2 = kSpeed_m_s / 0.2;
  for (const bool stops : {false, true}) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    const auto at_m = [&](double t_s) {
      const double braking_s = stops ? std::clamp(t_s - kEnd_s, 0.0, 0.2) : 0.0;
      const double after_s = std::max(0.0, t_s - kEnd_s - 0.2);
      return kSpeed_m_s * (stops ? t_s - after_s : t_s) - 0.5 * kBraking_m_s2 * braking_s * braking_s;
    };
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= kEventsEnd + 40; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      for (int i = -4; i <= 0; ++i) {
        const std::int64_t read_ns = t_ns + i * kPeriod_ns / 5;
        const double since_s = SecondsFromNs(read_ns) - kEnd_s;
        tracker.AddImu(ReadAlongX(read_ns, stops && since_s > 0 && since_s <= 0.2 ? -kBraking_m_s2 : 0));
      }
      const Rigid3 truth = Rigid3::Translation({at_m(SecondsFromNs(t_ns)), 0, 0});
      Surface surface = k <= kEventsEnd ? Seen(t_ns, truth) : Still(t_ns);
      if (k > kEventsEnd - 10 && k <= kEventsEnd) surface.activity_hz = 0.02 * (kEventsEnd + 1 - k) + 0.15;
      pose = tracker.Track(surface);
      ASSERT_TRUE(pose);
      // Held at once, it would be 48 mm off; gone on with at the old speed, 36 mm.
      ASSERT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 6e-3) << stops << " " << k;
    }
    EXPECT_EQ(pose->velocity_event.norm() < 1e-6, stops);
  }
}

/// Events grow fewer over several surfaces, the last at t_ns, as when a camera comes to a stop at TrueAt(kNow_ns).
void SlowDown(std::int64_t* t_ns, Tracker* tracker) {
  for (const double activity_hz : {3.0, 2.0, 1.5, 1.0, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.2}) {
    Surface slow = Seen(*t_ns += kPeriod_ns, TrueAt(kNow_ns));
    slow.activity_hz = activity_hz;
    tracker->Track(slow);
  }
}

TEST(Tracker, HoldsThePoseWhenTheCameraStandsStill) {
  std::int64_t t_ns = kNow_ns;
  const auto tracker = Moving();
  SlowDown(&t_ns, tracker.get());
  const Rigid3 stopped = TrueAt(kNow_ns);
  Rigid3 held;
  for (int k = 0; k < 100; ++k) {
    const auto pose = tracker->Track(Still(t_ns += kPeriod_ns));
    ASSERT_TRUE(pose);
    ASSERT_EQ(pose->state, TrackingState::kTracking) << k;
    if (k == 0) held = pose->T_world_event;
    ASSERT_LT(Log(held.inverse() * pose->T_world_event).norm(), 1e-9) << k;
  }
  EXPECT_LT(Log(stopped.inverse() * held).norm(), 3e-3);
  EXPECT_LT(tracker->SurfaceVelocity().norm(), 1e-6);
}

/// More events than a standstill may have, of noise that differs between parts of the image.
Surface UnevenNoise(std::int64_t t_ns) {
  Surface surface = Still(t_ns, 0.3);
  surface.still = false;
  return surface;
}

TEST(Tracker, HoldsThePoseWhereEventsAreNotMoreThanNoiseMayMakeAndMatchNothing) {
  std::int64_t t_ns = kNow_ns;
  const auto tracker = Moving();
  SlowDown(&t_ns, tracker.get());
  Rigid3 held;
  for (int k = 0; k < 100; ++k) {
    const auto pose = tracker->Track(UnevenNoise(t_ns += kPeriod_ns));
    ASSERT_TRUE(pose);
    ASSERT_NE(pose->state, TrackingState::kLost) << k;
    if (k < 5) held = pose->T_world_event;  // a few may be false for another reason
    ASSERT_LT(Log(held.inverse() * pose->T_world_event).norm(), 1e-9) << k;
  }
  EXPECT_LT(Log(TrueAt(kNow_ns).inverse() * held).norm(), 5e-3);
  EXPECT_LT(tracker->SurfaceVelocity().norm(), 1e-6);
}

TEST(Tracker, FollowsEventsThatMatchThoughTheyAreNotMoreThanNoiseMayMake) {
  const auto tracker = Moving();
  for (int k = 1; k <= 50; ++k) {
    const std::int64_t t_ns = kNow_ns + k * kPeriod_ns;
    Surface few = Seen(t_ns, TrueAt(t_ns));
    few.maybe_noise = true;
    const auto pose = tracker->Track(few);
    ASSERT_TRUE(pose);
    ASSERT_LT(ErrorOf(*pose), 3e-3) << k;
  }
}

TEST(Tracker, LeavesARestWithTheVelocityThatTheCameraReachedBeforeEventsShowedIt) {
  constexpr int kBegins = 100, kShows = 120;
  constexpr double kAcceleration_m_s2 = 0.8;
  const auto since_s = [](double k) { return 0.01 * std::max(0.0, k - kBegins); };
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  for (int k = 1; k <= kShows; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    for (int i = -4; i <= 0; ++i) {
      const double read = k + 0.2 * i;
      tracker.AddImu(ReadAlongX(t_ns + i * kPeriod_ns / 5, read > kBegins ? kAcceleration_m_s2 : 0));
    }
    // Nothing matches: the pose is what was known of the motion.
    Surface surface = Still(t_ns);
    surface.still = surface.maybe_noise = k < kShows;
    surface.activity_hz = surface.still ? 0.01 : 5;
    const auto pose = tracker.Track(surface);
    ASSERT_TRUE(pose);
    if (k < kShows) {
      ASSERT_EQ(pose->T_world_event.translation().norm(), 0) << k;
      continue;
    }
    const double moved_m = 0.5 * kAcceleration_m_s2 * std::pow(since_s(k), 2);  // 16 mm
    EXPECT_LT(Log(Rigid3::Translation({-moved_m, 0, 0}) * pose->T_world_event).norm(), 1.5e-3);
    EXPECT_NEAR(pose->velocity_event[0], kAcceleration_m_s2 * since_s(k), 0.02);
  }
}

TEST(Tracker, HoldsThePoseAfterAHardStop) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  std::optional<PoseEstimate> pose;
  double x_m = 0, last_m_s = 0;
  const auto step = [&](double speed_m_s) {
    const std::int64_t t_ns = (pose ? pose->t_ns : 0) + kPeriod_ns;
    x_m += 0.01 * speed_m_s;
    const double activity_hz = 10 * (speed_m_s + std::exchange(last_m_s, speed_m_s));  // of 20 ms
    Surface surface = Seen(t_ns, Rigid3::Translation({x_m, 0, 0}));
    if (activity_hz == 0) surface = Still(t_ns, 0);
    surface.activity_hz = activity_hz;
    pose = tracker.Track(surface);
  };
  for (int k = 0; k < 100; ++k) step(0.5);
  for (const double speed_m_s : {0.42, 0.34, 0.25, 0.14, 0.05}) step(speed_m_s);
  for (int k = 0; k < 60; ++k) step(0);
  ASSERT_TRUE(pose);
  // After a second without an acceleration it takes two poses to expect one.
  EXPECT_LT(std::abs(pose->T_world_event.translation().x() - x_m), 0.015);
  EXPECT_LT(pose->velocity_event.norm(), 1e-6);
}

TEST(Tracker, CoastsOnWhenEventsEndSuddenlyAndIsNotCertainOfIt) {
  const auto tracker = Moving();
  const auto before = tracker->Track(Seen(kNow_ns + kPeriod_ns, TrueAt(kNow_ns + kPeriod_ns)));
  std::optional<PoseEstimate> pose;
  for (int k = 2; k <= 6; ++k) pose = tracker->Track(Still(kNow_ns + k * kPeriod_ns));
  ASSERT_TRUE(pose);
  const std::int64_t t_ns = kNow_ns + 6 * kPeriod_ns;
  // 50 ms at 0.33 m/s are 17 mm; slowing down costs one of them.
  EXPECT_LT((TrueAt(t_ns).inverse() * pose->T_world_event).translation().norm(), 0.005);
  EXPECT_NE(pose->state, TrackingState::kTracking);
  EXPECT_GT(pose->covariance_event.trace(), before->covariance_event.trace());
}

TEST(Tracker, TakesAnEndOfTheEventsForAStopWhereNoiseGoesOn) {
  const auto tracker = Moving();
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 20; ++k) {
    Surface surface = Still(kNow_ns + k * kPeriod_ns);
    surface.noise_goes_on = true;
    pose = tracker->Track(surface);
  }
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_LT(Log(TrueAt(kNow_ns).inverse() * pose->T_world_event).norm(), 0.02);  // 0.07 of which it coasts on
}

TEST(Tracker, IsHeldAtOnceWhereNoiseGoesOnAndAnInertialSensorIsNotSureOfAVelocity) {
  const auto moved_m = [](bool noise_goes_on) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    Rigid3 before;
    for (int k = 1; k <= 70; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      for (int i = -4; i <= 0; ++i) tracker.AddImu(ReadAlongX(t_ns + i * kPeriod_ns / 5, 0));
      Surface surface = k <= 60 ? Seen(t_ns, Rigid3::Translation({0.011 * SecondsFromNs(t_ns), 0, 0})) : Still(t_ns);
      surface.activity_hz = k <= 60 ? 0.2 : 0.01;
      surface.noise_goes_on = noise_goes_on;
      pose = tracker.Track(surface);
      if (k == 60) before = pose->T_world_event;
    }
    return (before.inverse() * pose->T_world_event).translation().norm();
  };
  EXPECT_LT(moved_m(true), 1e-5);
  EXPECT_GT(moved_m(false), 5e-4);
}

TEST(Tracker, GoesOnWhenEventsComeBackAfterAGap) {
  const auto tracker = Moving();
  for (int k = 1; k <= 20; ++k) tracker->Track(Still(kNow_ns + k * kPeriod_ns));
  std::optional<PoseEstimate> pose;
  for (int k = 21; k <= 40; ++k) {
    pose = tracker->Track(Seen(kNow_ns + k * kPeriod_ns, TrueAt(kNow_ns + k * kPeriod_ns)));
    ASSERT_TRUE(pose && pose->T_world_event.IsFinite());
  }
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_LT(ErrorOf(*pose), 5e-3);
}

TEST(Tracker, FindsThePoseAgainAfterAJump) {
  const auto tracker = Moving();
  // 12 pixels at once: three times what an edge attracts.
  const Rigid3 jumped = TrueAt(kNow_ns) * Rigid3::Rotation(ExpSO3({0, 0.06, 0}));
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 60; ++k) {
    pose = tracker->Track(Seen(kNow_ns + k * kPeriod_ns, jumped));
    ASSERT_TRUE(pose && pose->T_world_event.IsFinite());
  }
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_GT(pose->inlier_share, 0.9);
  EXPECT_LT(Log(jumped.inverse() * pose->T_world_event).norm(), 5e-3);
}

TEST(Tracker, KeepsTheVelocityThatAnInertialSensorLedToWhereASearchFindsThePose) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  const Rigid3 jump = Exp((Vector6d() << 0.03, -0.022, 0.015, 0.01, -0.01, 0.01).finished());
  std::optional<PoseEstimate> pose;
  bool found = false;
  for (int k = 1; k <= 60 && !found; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(Read, t_ns, &tracker);
    pose = tracker.Track(Seen(t_ns, k <= 30 ? TrueAt(t_ns) : TrueAt(t_ns) * jump));
    ASSERT_TRUE(pose);
    found = k > 30 && !pose->earlier.empty();
  }
  ASSERT_TRUE(found);
  EXPECT_LT((pose->velocity_event - Twist()).norm(), 0.2 * Twist().norm());
}

TEST(Tracker, FindsThePoseAfterAJumpFarBeyondItsReachUnlessTheSearchIsSwitchedOff) {
  const Rigid3 jumped = TrueAt(kNow_ns) * Rigid3::Rotation(ExpSO3({0, 0.2, 0}));
  TrackingIdeas off;
  off.search = false;
  for (const TrackingIdeas& ideas : {TrackingIdeas(), off}) {
    const auto tracker = Moving(ideas);
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 60; ++k) pose = tracker->Track(Seen(kNow_ns + k * kPeriod_ns, jumped));
    ASSERT_TRUE(pose);
    EXPECT_EQ(Log(jumped.inverse() * pose->T_world_event).norm() < 5e-3, ideas.search);
  }
}

TEST(Tracker, GivesWayToThePredictionUnlessThePriorIsSwitchedOff) {
  // One pixel aside in 10 ms: an acceleration that nobody would believe.
  const Rigid3 shown = TrueAt(kNow_ns + kPeriod_ns) * Rigid3::Rotation(ExpSO3({0, 0.005, 0}));
  TrackingIdeas off;
  off.motion_prior = false;
  for (const TrackingIdeas& ideas : {TrackingIdeas(), off}) {
    const auto pose = Moving(ideas)->Track(Seen(kNow_ns + kPeriod_ns, shown));
    const double error = Log(shown.inverse() * pose->T_world_event_edges).norm();
    if (ideas.motion_prior) {
      EXPECT_GT(error, 5e-4);
    } else {
      EXPECT_LT(error, 1e-4);
    }
  }
}

TEST(Tracker, GivesTheNewestVelocityNotAMeanOfPosesWithAndWithoutAnInertialSensor) {
  // From rest, 3 m/s^2 sideways for 0.2 s: the mean of the last 40 ms is 20 ms older than the newest.
  constexpr double kMeanBehind_m_s = 3 * 0.02;
  const auto behind_m_s = [](bool inertial) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    for (int k = 1; k <= 20; ++k) {
      const double t_s = SecondsFromNs(k * kPeriod_ns);
      for (int i = -4; i <= 0 && inertial; ++i) tracker.AddImu(ReadAlongX(k * kPeriod_ns + i * kPeriod_ns / 5, 3));
      tracker.Track(Seen(k * kPeriod_ns, Rigid3::Translation({1.5 * t_s * t_s, 0, 0})));
    }
    return 0.6 - tracker.SurfaceVelocity()[0];
  };
  EXPECT_GT(behind_m_s(false), 0);
  EXPECT_LT(behind_m_s(false), kMeanBehind_m_s - 0.01);
  EXPECT_LT(std::abs(behind_m_s(true)), kMeanBehind_m_s - 0.01);
}

TEST(Tracker, SaysWhetherItsVelocityIsOfPosesAlone) {
  for (const bool inertial : {false, true}) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 20; ++k) {
      for (int i = -4; i <= 0 && inertial; ++i) tracker.AddImu(ReadAlongX(k * kPeriod_ns + i * kPeriod_ns / 5, 0));
      pose = tracker.Track(Seen(k * kPeriod_ns, Rigid3()));
    }
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->velocity_of_poses, !inertial);
  }
}

TEST(Tracker, SaysThatAGapOfEventsAndReadingsTogetherIsLedByNoSensor) {
  for (const bool read : {true, false}) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    bool led = false;
    for (int k = 1; k <= 70; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      if (k <= 60 || read) {
        for (int i = -4; i <= 0; ++i) tracker.AddImu(ReadAlongX(t_ns + i * kPeriod_ns / 5, 0));
      }
      const Rigid3 T_world_event = Rigid3::Translation({0.3 * SecondsFromNs(t_ns), 0, 0});
      pose = tracker.Track(k <= 60 ? Seen(t_ns, T_world_event) : Still(t_ns));
      if (k <= 60) led |= !pose->velocity_of_poses;
    }
    EXPECT_TRUE(led);
    EXPECT_EQ(pose->velocity_of_poses, !read);
  }
}

TEST(Tracker, FollowsEdgesOfFewEventsLessAndIsLessCertainUnlessThatIsSwitchedOff) {
  // A camera at rest whose edges jump by 2 mm, about a pixel, for one surface.
  const auto after_jump = [](std::uint32_t events, bool weigh) {
    TrackingIdeas ideas;
    ideas.weigh_events = weigh;
    OdometryOptions options;
    options.tracking.ideas = ideas;
    Tracker tracker(TestCamera(), options);
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 50; ++k) {
      Surface surface = Seen(k * kPeriod_ns, Rigid3::Translation({k == 50 ? 0.002 : 0, 0, 0}));
      surface.events_used = events;
      pose = tracker.Track(surface);
    }
    return *pose;
  };
  const PoseEstimate many = after_jump(50'000, true), few = after_jump(500, true), alike = after_jump(500, false);
  EXPECT_LT(few.T_world_event.translation().x(), 0.9 * many.T_world_event.translation().x());
  EXPECT_GT(few.covariance_event(0, 0), 1.5 * many.covariance_event(0, 0));
  EXPECT_EQ(alike.T_world_event.translation(), many.T_world_event.translation());
  EXPECT_EQ(alike.covariance_event, many.covariance_event);
}

TEST(Tracker, DoubtsTheNormalsOfEdgesOnlyWithoutAnInertialSensor) {
  const auto stated = [](bool inertial, bool noise_of_normals) {
    OdometryOptions exact, options;
    exact.tracking.ideas.noise_of_normals = false;
    options.tracking.ideas.noise_of_normals = noise_of_normals;
    Tracker tracker(TestCamera(), exact);
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 30; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns;
      if (inertial) AddReadings(Read, t_ns, &tracker);
      // Before a tenth of a second an inertial sensor's noise is not known, and it leads nobody.
      if (k == 15) tracker.SetOptions(options);
      if (k > 10) pose = tracker.Track(WithTurnedNormals(Seen(t_ns, TrueAt(t_ns)), 0, 0.2));
    }
    return pose->covariance_event;
  };
  EXPECT_GT(stated(false, true).trace(), 1.001 * stated(false, false).trace());
  EXPECT_EQ(stated(true, true), stated(true, false)) << "the errors of an inertial sensor are to be held";
}

TEST(Tracker, FollowsPosesThatMatchLessThanUsualLessUnlessThatIsSwitchedOff) {
  // A camera at rest, with an inertial sensor, whose edges jump by 2 mm, about a pixel, for one surface, in which two
  // fifths of the points match nothing any more.
  const auto after_jump = [](bool fewer, bool weigh) {
    OdometryOptions options;
    options.tracking.ideas.weigh_matches = weigh;
    Tracker tracker(TestCamera(), options);
    tracker.SetMap(Map());
    const auto track = [&tracker](int k, const Rigid3& T_world_event) {
      for (int i = -4; i <= 0; ++i) tracker.AddImu(ReadAlongX(k * kPeriod_ns + i * kPeriod_ns / 5, 0));
      return *tracker.Track(Seen(k * kPeriod_ns, T_world_event));
    };
    for (int k = 1; k <= 50; ++k) track(k, Rigid3());
    auto map = std::make_shared<LocalMap>(*Map());
    for (std::size_t i = 0; fewer && i < map->points.size(); ++i) {
      if (i % 5 < 2) map->points[i].p_ref += Eigen::Vector3f(0.13F, 0.17F, 0);
    }
    tracker.SetMap(map);
    return track(51, Rigid3::Translation({0.002, 0, 0}));
  };
  const PoseEstimate fewer = after_jump(true, true), alike = after_jump(true, false);
  EXPECT_LT(fewer.inlier_share, 0.8);
  EXPECT_LT(fewer.T_world_event.translation().x(), 0.9 * alike.T_world_event.translation().x());
  EXPECT_NEAR(after_jump(false, true).T_world_event.translation().x(),
              after_jump(false, false).T_world_event.translation().x(), 1e-6);
}

TEST(Tracker, TakesAHandfulOfMatchesForNoPoseAndHoldsWhileItIsLost) {
  const auto tracker = Moving();
  auto few = std::make_shared<LocalMap>(*Map());
  few->points.resize(20);
  tracker->SetMap(few);
  PoseEstimate pose, when_lost;
  for (int k = 51; k <= 250; ++k) {
    pose = *tracker->Track(Seen(k * kPeriod_ns, TrueAt(k * kPeriod_ns)));
    if (k == 100) when_lost = pose;
  }
  EXPECT_EQ(when_lost.state, TrackingState::kLost);
  EXPECT_EQ(pose.state, TrackingState::kLost);
  EXPECT_EQ(pose.inlier_share, 0);
  // A velocity that nothing confirms fades: 1.5 s on, it is less than half a metre.
  EXPECT_LT(Log(when_lost.T_world_event.inverse() * pose.T_world_event).norm(), 0.3);
}

/// Segments that have nothing to do with those of Map().
LocalMapPtr ElsewhereMap(int chapter) {
  auto map = std::make_shared<LocalMap>(*Map());
  map->chapter = chapter;
  map->points = SegmentScene(77, 1.5);
  return map;
}

Surface SeenElsewhere(std::int64_t t_ns) {
  Surface surface = SegmentsSeen(ElsewhereMap(0)->points, Rigid3());
  surface.t_ns = surface.t_edges_ns = t_ns;
  surface.activity_hz = 5;
  return surface;
}

/// Poses of a constant motion with an inertial sensor, at which surfaces of (from, until] see what the map does not
/// have.
std::vector<PoseEstimate> PosesPastAnUnknownView(int from, int until, int surfaces) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  std::vector<PoseEstimate> poses;
  for (int k = 1; k <= surfaces; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(Read, t_ns, &tracker);
    poses.push_back(tracker.Track(k <= from || k > until ? Seen(t_ns, TrueAt(t_ns)) : SeenElsewhere(t_ns)).value());
  }
  return poses;
}

TEST(Tracker, GoesOnWithTheInertialSensorThroughAViewThatTheMapDoesNotHaveYet) {
  const auto poses = PosesPastAnUnknownView(60, 160, 180);  // a second: the time between depth images at 1 Hz
  for (const PoseEstimate& pose : poses) {
    EXPECT_NE(pose.state, TrackingState::kLost) << pose.t_ns;
    if (pose.t_ns > 60 * kPeriod_ns) {
      EXPECT_LT(ErrorOf(pose), 0.03) << pose.t_ns;  // of 0.34 m
    }
  }
  EXPECT_LT(ErrorOf(poses.back()), 1e-3);
}

TEST(Tracker, SaysThatItIsLostWhenTheViewStaysUnknownButGoesOnWithTheInertialSensor) {
  const auto poses = PosesPastAnUnknownView(60, 260, 280);
  EXPECT_EQ(poses[259].state, TrackingState::kLost);
  EXPECT_LT(ErrorOf(poses[259]), 0.15);  // of 0.67 m
  EXPECT_NE(poses.back().state, TrackingState::kLost);
  EXPECT_LT(ErrorOf(poses.back()), 1e-3);
}

/// A third of what a camera at the pose sees of the map, and all of it as if from elsewhere.
Surface SeenBesideALookalike(std::int64_t t_ns, const Rigid3& T_world_event, const Rigid3& T_world_elsewhere) {
  std::vector<MapPoint> third = Map()->points;
  third.resize(third.size() / 3);
  Surface surface = Seen(t_ns, T_world_elsewhere);
  const Surface there = SegmentsSeen(third, T_world_event.inverse());
  surface.edges.insert(surface.edges.end(), there.edges.begin(), there.edges.end());
  BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
  return surface;
}

TEST(Tracker, DoesNotLeaveAnInertialSensorsPoseForALookalikeThatMatchesMore) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  const Rigid3 aside = Rigid3::Translation({0.08, 0, 0});
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 60; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(Read, t_ns, &tracker);
    pose = tracker.Track(k <= 50 ? Seen(t_ns, TrueAt(t_ns))
                                 : SeenBesideALookalike(t_ns, TrueAt(t_ns), TrueAt(t_ns) * aside));
    ASSERT_TRUE(pose);
    EXPECT_LT(ErrorOf(*pose), 0.01) << k;
  }
  EXPECT_LT(pose->inlier_share, 0.7);
}

TEST(Tracker, SaysThatItIsLostWhenNothingMatchesAndStaysFinite) {
  const auto tracker = Moving();
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 60; ++k) {
    Surface nothing = Still(kNow_ns + k * kPeriod_ns, 5);
    nothing.still = nothing.maybe_noise = false;
    pose = tracker->Track(nothing);
    ASSERT_TRUE(pose);
    ASSERT_TRUE(pose->T_world_event.IsFinite() && pose->covariance_event.allFinite()) << k;
  }
  EXPECT_EQ(pose->state, TrackingState::kLost);
}

TEST(Tracker, AsksForANewMapInAnUnknownViewAndGoesOnInItsChapterWithoutCertaintyOfTheWay) {
  const auto tracker = Moving();
  std::optional<PoseEstimate> pose;
  std::int64_t t_ns = kNow_ns;
  for (int k = 0; k < 100; ++k) pose = tracker->Track(SeenElsewhere(t_ns += kPeriod_ns));
  ASSERT_EQ(pose->state, TrackingState::kLost);
  EXPECT_FALSE(pose->needs_map);
  for (int k = 0; k < 50; ++k) pose = tracker->Track(SeenElsewhere(t_ns += kPeriod_ns));
  ASSERT_TRUE(pose->needs_map);
  EXPECT_EQ(pose->chapter, 0);

  auto map = std::make_shared<LocalMap>(*ElsewhereMap(1));
  map->t_ns = t_ns;
  map->T_world_ref = pose->T_world_event;
  tracker->SetMap(map);
  bool recovered = false;
  for (int k = 0; k < 10; ++k) {
    pose = tracker->Track(SeenElsewhere(t_ns += kPeriod_ns));
    recovered |= pose->state == TrackingState::kRecovered;
  }
  EXPECT_TRUE(recovered);
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_EQ(pose->chapter, 1);
  EXPECT_FALSE(pose->needs_map);
  EXPECT_LT(Log(map->T_world_ref.inverse() * pose->T_world_event).norm(), 2e-3);
  EXPECT_GT(pose->covariance_event(0, 0), 0.01);  // where the chapter began was a guess
  EXPECT_LT(pose->covariance_in_chapter(0, 0), 1e-4);

  // What is not known of the next one adds to that.
  const Matrix6d of_first = pose->covariance_event;
  for (int k = 0; k < 150; ++k) {
    Surface nothing = Still(t_ns += kPeriod_ns, 5);
    nothing.still = nothing.maybe_noise = false;
    pose = tracker->Track(nothing);
  }
  ASSERT_TRUE(pose->needs_map);
  auto next = std::make_shared<LocalMap>(*map);
  next->chapter = 2;
  next->t_ns = t_ns;
  next->T_world_ref = pose->T_world_event;
  tracker->SetMap(next);
  for (int k = 0; k < 10; ++k) pose = tracker->Track(SeenElsewhere(t_ns += kPeriod_ns));
  ASSERT_EQ(pose->chapter, 2);
  EXPECT_GT(pose->covariance_event(0, 0), of_first(0, 0) + 0.2);  // 0.22 m^2 by 1.5 s of coasting alone
}

TEST(Tracker, BeginsAnewWhereDepthFoundItAndIsCertainOfThatOnceItIsLost) {
  const Rigid3 found = Rigid3::Translation({0.7, -0.2, 0.1});
  for (const bool lost : {true, false}) {
    const auto tracker = Moving();
    std::int64_t t_ns = kNow_ns;
    std::optional<PoseEstimate> pose;
    const auto track = [&](int surfaces) {
      for (int k = 0; k < surfaces; ++k) {
        t_ns += kPeriod_ns;
        pose = tracker->Track(lost ? SeenElsewhere(t_ns) : Seen(t_ns, TrueAt(t_ns)));
      }
    };
    track(60);
    ASSERT_EQ(pose->state == TrackingState::kLost, lost);
    auto map = std::make_shared<LocalMap>(*ElsewhereMap(0));
    map->t_ns = t_ns - kPeriod_ns;
    map->T_world_ref = found;
    map->found_by_depth = true;
    tracker->SetMap(map);
    track(10);
    EXPECT_EQ(pose->state, TrackingState::kTracking);
    EXPECT_EQ(pose->chapter, 0);
    EXPECT_LT(Log((lost ? found : TrueAt(t_ns)).inverse() * pose->T_world_event).norm(), 2e-3);
    EXPECT_LT(pose->covariance_event(0, 0), 1e-4);
  }
}

TEST(Tracker, OnlyRemembersAMapOfAnotherChapterWhileItIsNotLost) {
  const auto tracker = Moving();
  tracker->SetMap(ElsewhereMap(1));
  const auto pose = tracker->Track(Seen(kNow_ns + kPeriod_ns, TrueAt(kNow_ns + kPeriod_ns)));
  EXPECT_EQ(pose->chapter, 0);
  EXPECT_EQ(pose->state, TrackingState::kTracking);
  EXPECT_LT(ErrorOf(*pose), 1e-3);
}

/// What a depth image says that shows the camera at this pose.
DepthPose ByDepth(std::int64_t t_ns, const Rigid3& T_world_event) {
  DepthPose pose;
  pose.t_ns = t_ns;
  pose.T_world_event = T_world_event;
  pose.information = 1e6 * Matrix6d::Identity();  // a millimetre and milliradian
  return pose;
}

TEST(Tracker, DoesNotSearchWhereAnInertialSensorLeadsAndDepthHasJustAgreed) {
  const Rigid3 looks_like_it = Rigid3::Rotation(ExpSO3({0, 0.02, 0})) * Rigid3::Translation({0.02, 0.02, 0});
  for (const bool depth : {true, false}) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 80; ++k) {
      for (int i = -4; i <= 0; ++i) tracker.AddImu(ReadAlongX(k * kPeriod_ns + i * kPeriod_ns / 5, 0));
      pose = tracker.Track(Seen(k * kPeriod_ns, k <= 50 ? Rigid3() : looks_like_it));
      if (depth && k % 3 == 0) tracker.AddDepthPose(ByDepth(k * kPeriod_ns, Rigid3()));
    }
    ASSERT_TRUE(pose);
    EXPECT_EQ(Log(looks_like_it.inverse() * pose->T_world_event).norm() < 5e-3, !depth);
  }
}

TEST(Tracker, TakesNoPoseThatLooksLikeTheViewButThatDepthOfAMomentAgoRulesOut) {
  for (const bool with_depth : {false, true}) {
    const auto tracker = Moving();
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 30; ++k) {
      const std::int64_t before_ns = kNow_ns + (k - 1) * kPeriod_ns, now_ns = kNow_ns + k * kPeriod_ns;
      if (with_depth) tracker->AddDepthPose(ByDepth(before_ns, TrueAt(before_ns)));
      // What a corridor shows that repeats itself.
      pose = tracker->Track(Seen(now_ns, TrueAt(now_ns) * Rigid3::Rotation(ExpSO3({0, 0.2, 0}))));
    }
    ASSERT_TRUE(pose);
    EXPECT_EQ(ErrorOf(*pose) < 0.05, with_depth) << ErrorOf(*pose);
  }
}

TEST(Tracker, IsMovedByDepthAsFarAsThatIsBetterKnown) {
  const auto tracker = Moving(), alone = Moving();
  const Rigid3 off = Rigid3::Translation({0.002, 0, 0});
  tracker->AddDepthPose(ByDepth(kNow_ns - kPeriod_ns, TrueAt(kNow_ns - kPeriod_ns) * off));
  const std::int64_t next_ns = kNow_ns + kPeriod_ns;
  const auto moved = tracker->Track(Seen(next_ns, TrueAt(next_ns))),
             unmoved = alone->Track(Seen(next_ns, TrueAt(next_ns)));
  const Vector6d difference = Log(unmoved->T_world_event.inverse() * moved->T_world_event);
  EXPECT_GT(difference.x(), 1e-5);
  EXPECT_LT(difference.norm(), 2e-3);
  EXPECT_LT((tracker->SurfaceVelocity() - alone->SurfaceVelocity()).norm(), 0.02) << "a correction is no velocity";
}

TEST(Tracker, GoesOnByDepthWhereEventsAreMissing) {
  const auto tracker = Moving();
  Vector6d back = -2 * Twist();  // no prediction knows that
  const auto at = [&](int k) { return TrueAt(kNow_ns) * Exp(back * SecondsFromNs(k * kPeriod_ns)); };
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 60; ++k) {
    if (k > 4 && k % 3 == 0) tracker->AddDepthPose(ByDepth(kNow_ns + (k - 3) * kPeriod_ns, at(k - 3)));
    pose = tracker->Track(Still(kNow_ns + k * kPeriod_ns, 0));
    ASSERT_NE(pose->state, TrackingState::kLost) << k;
  }
  EXPECT_LT(Log(at(60).inverse() * pose->T_world_event).norm(), 0.03);
  EXPECT_GT(Log(TrueAt(kNow_ns).inverse() * at(60)).norm(), 0.3);
}

TEST(Tracker, GoesOnByDepthForAsLongAsEventsAreMissing) {
  const auto tracker = Moving();
  const auto at = [&](int k) { return TrueAt(kNow_ns + k * kPeriod_ns); };
  for (int k = 1; k <= 200; ++k) {
    if (k > 4 && k % 3 == 0) tracker->AddDepthPose(ByDepth(kNow_ns + (k - 3) * kPeriod_ns, at(k - 3)));
    const auto pose = tracker->Track(Still(kNow_ns + k * kPeriod_ns, 0));
    ASSERT_LT(Log(at(k).inverse() * pose->T_world_event).norm(), 0.01) << k;
    ASSERT_LT((tracker->SurfaceVelocity() - Twist()).norm(), 0.2) << k;
  }
}

TEST(Tracker, IsNotHeldWhileAGyroscopeSeesItTurnAndDepthAgreesBeItInPart) {
  const auto turn_error = [](bool with_depth) {
    Tracker tracker(TestCamera(), OdometryOptions());
    tracker.SetMap(Map());
    std::optional<PoseEstimate> pose;
    for (int k = 1; k <= 280; ++k) {
      const std::int64_t t_ns = k * kPeriod_ns, image_ns = t_ns - 2 * kPeriod_ns;
      AddReadings(Read, t_ns, &tracker);
      Surface surface = k <= 100 ? Seen(t_ns, TrueAt(t_ns)) : Still(t_ns, 0.1);
      // In the end as few as noise makes: no sudden end.
      surface.activity_hz = k <= 100 ? std::max(0.2, 0.1 * (100 - k)) : 0.1;
      DepthPose depth = ByDepth(image_ns, TrueAt(image_ns));
      depth.information(0, 0) = 0;
      if (with_depth && k > 10 && k % 3 == 0) tracker.AddDepthPose(depth);
      pose = tracker.Track(surface);
    }
    return RotationAngle(pose->T_world_event.inverse() * TrueAt(pose->t_ns));
  };
  EXPECT_LT(turn_error(true), 0.01);
  EXPECT_GT(turn_error(false), 0.1) << "where it is meanwhile nothing would tell: it is held";
}

TEST(Tracker, IsNotHeldBeforeAWallWithoutEdgesWhileAGyroscopeSeesItTurn) {
  const auto turn_alone = [](std::int64_t t_ns) {
    ImuSample sample = Read(t_ns);
    sample.linear_acceleration.setConstant(std::nan(""));
    return sample;
  };
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 150; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(turn_alone, t_ns, &tracker);
    // The map, with edges that are not there, says that the motion would show.
    Surface surface = k <= 100 ? Seen(t_ns, TrueAt(t_ns)) : Still(t_ns, 0.1);
    surface.activity_hz = k <= 100 ? std::max(0.2, std::min(5.0, 0.3 * (100 - k))) : 0.1;
    pose = tracker.Track(surface);
  }
  EXPECT_LT(RotationAngle(pose->T_world_event.inverse() * TrueAt(pose->t_ns)), 0.02);
  EXPECT_FALSE(pose->inertial_fit.left_out) << "nor is the sensor taken to be wrong";
}

TEST(Tracker, LeavesAnInertialSensorsPoseInAGapOfTheEventsOnlyForManyDepthImages) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  const auto track = [&tracker](int k, const Surface& surface) {
    AddReadings(Read, k * kPeriod_ns, &tracker);
    return tracker.Track(surface).value();
  };
  const Rigid3 off = Rigid3::Translation({0.03, 0, 0});
  const auto see = [&tracker, &off](int k) {
    tracker.AddDepthPose(ByDepth(k * kPeriod_ns, TrueAt(k * kPeriod_ns) * off));
  };
  PoseEstimate pose;
  for (int k = 1; k <= 60; ++k) pose = track(k, Seen(k * kPeriod_ns, TrueAt(k * kPeriod_ns)));
  for (int k = 61; k <= 64; ++k) pose = track(k, Still(k * kPeriod_ns, 0));
  see(62);
  see(63);
  pose = track(65, Still(65 * kPeriod_ns, 0));
  EXPECT_LT(ErrorOf(pose), 5e-3);
  for (int k = 66; k <= 100; ++k) {
    see(k - 2);
    pose = track(k, Still(k * kPeriod_ns, 0));
  }
  EXPECT_LT(Log((TrueAt(pose.t_ns) * off).inverse() * pose.T_world_event).norm(), 5e-3);
}

TEST(Tracker, HoldsThePoseInAStandstillWhateverDepthsNoiseButNotAgainstAMotionThatItShows) {
  const auto tracker = Moving();
  std::optional<PoseEstimate> pose;
  std::int64_t t_ns = kNow_ns;
  for (int k = 0; k < 200; ++k) pose = tracker->Track(Still(t_ns += kPeriod_ns));
  const Rigid3 held = pose->T_world_event;
  for (int k = 0; k < 20; ++k) {
    tracker->AddDepthPose(ByDepth(t_ns, held * Rigid3::Translation({k % 2 ? 0.001 : -0.001, 0, 0})));
    pose = tracker->Track(Still(t_ns += kPeriod_ns));
  }
  EXPECT_LT(Log(held.inverse() * pose->T_world_event).norm(), 1e-9);
  for (int k = 1; k <= 10; ++k) {
    tracker->AddDepthPose(ByDepth(t_ns, held * Rigid3::Translation({0.02 * k, 0, 0})));
    for (int i = 0; i < 3; ++i) pose = tracker->Track(Still(t_ns += kPeriod_ns));
  }
  EXPECT_NEAR((held.inverse() * pose->T_world_event).translation().x(), 0.2, 0.03);
}

TEST(Tracker, EndsAStandstillAtOnceWhereDepthHasSeenMotionSinceItBegan) {
  const auto moved = [](bool seen_before) {
    const auto tracker = Moving();
    std::int64_t t_ns = kNow_ns;
    std::optional<PoseEstimate> pose;
    for (int k = 0; k < 100; ++k) pose = tracker->Track(Still(t_ns += kPeriod_ns));
    const Rigid3 held = pose->T_world_event;
    if (seen_before) tracker->AddDepthPose(ByDepth(t_ns, held));
    for (int k = 0; k < 20; ++k) tracker->Track(Still(t_ns += kPeriod_ns));
    tracker->AddDepthPose(ByDepth(t_ns, held * Rigid3::Translation({0.03, 0, 0})));
    pose = tracker->Track(Still(t_ns += kPeriod_ns));
    return (held.inverse() * pose->T_world_event).translation().x();
  };
  EXPECT_NEAR(moved(true), 0.03, 0.01);
  EXPECT_NEAR(moved(false), 0, 1e-9) << "one image alone may be wrong";
}

TEST(Tracker, IsToldOfItsVelocityByDepthThatComesLate) {
  // Nothing but depth knows of the motion: what matches is too little.
  const auto tracker = Moving();
  const Vector6d velocity = 1.5 * Twist();
  const auto at = [&](int k) { return TrueAt(kNow_ns) * Exp(velocity * SecondsFromNs(k * kPeriod_ns)); };
  for (int k = 1; k <= 45; ++k) {
    if (k > 6 && k % 3 == 0) tracker->AddDepthPose(ByDepth(kNow_ns + (k - 6) * kPeriod_ns, at(k - 6)));
    tracker->Track(Still(kNow_ns + k * kPeriod_ns, 0));
  }
  EXPECT_LT((tracker->SurfaceVelocity() - velocity).norm(), 0.1);
}

TEST(Tracker, TakesNoVelocityInAStandstillFromADepthImageOfBefore) {
  const auto tracker = Moving();
  const Rigid3 off = Rigid3::Translation({0.05, 0, 0}), stopped = TrueAt(kNow_ns);
  tracker->AddDepthPose(ByDepth(kNow_ns - 10 * kPeriod_ns, TrueAt(kNow_ns - 10 * kPeriod_ns) * off));
  std::int64_t t_ns = kNow_ns;
  for (const double activity_hz : {3.0, 1.5, 0.5, 0.2}) {
    Surface slow = Seen(t_ns += kPeriod_ns, stopped);
    slow.activity_hz = activity_hz;
    tracker->Track(slow);
  }
  std::optional<PoseEstimate> pose;
  for (int k = 0; k < 6; ++k) pose = tracker->Track(Still(t_ns += kPeriod_ns));
  tracker->AddDepthPose(ByDepth(t_ns, stopped * off));
  for (int k = 0; k < 40; ++k) pose = tracker->Track(Still(t_ns += kPeriod_ns));
  EXPECT_LT(Log((stopped * off).inverse() * pose->T_world_event).norm(), 0.01);
}

TEST(Tracker, GoesOnWithTheVelocityThatFewDepthImagesShowWhereAStandstillWasNone) {
  // A slow motion in the dark: its events end, but depth, five times a second, shows that it goes on.
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  const auto at = [](std::int64_t t_ns) { return Rigid3::Translation({0.08 * SecondsFromNs(t_ns), 0, 0}); };
  std::int64_t t_ns = 0;
  std::optional<PoseEstimate> pose;
  const auto track = [&](Surface surface) {
    surface.t_edges_ns = surface.t_ns - 2 * kPeriod_ns;  // the mean time of its events
    pose = tracker.Track(surface);
  };
  for (int k = 0; k < 50; ++k) {
    t_ns += kPeriod_ns;
    Surface slow = Seen(t_ns, at(t_ns - 2 * kPeriod_ns));
    slow.activity_hz = 0.2;
    track(slow);
  }
  const std::int64_t first_ns = t_ns - kPeriod_ns / 10;  // hardly before the last events
  for (int k = 1; k <= 41; ++k) {
    track(Still(t_ns += kPeriod_ns));
    const std::int64_t image_ns = first_ns + (k - 2) / 20 * 20 * kPeriod_ns;
    if (k % 20 == 2) tracker.AddDepthPose(ByDepth(image_ns, at(image_ns)));
  }
  EXPECT_LT(Log(at(t_ns).inverse() * pose->T_world_event).norm(), 0.007) << "held, it would be 16 mm behind";
}

TEST(Tracker, BelievesDepthWhereSurfacesMatchNextToNothing) {
  const auto tracker = Moving();
  // The motion turns round where the map has nothing.
  const auto at = [&](int k) { return TrueAt(kNow_ns) * Exp(-3 * Twist() * SecondsFromNs(k * kPeriod_ns)); };
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 19; ++k) {
    if (k > 4 && k % 3 == 0) tracker->AddDepthPose(ByDepth(kNow_ns + (k - 3) * kPeriod_ns, at(k - 3)));
    pose = tracker->Track(SeenElsewhere(kNow_ns + k * kPeriod_ns));
    ASSERT_TRUE(pose);
  }
  EXPECT_NE(pose->state, TrackingState::kLost);
  EXPECT_LT((at(19).inverse() * pose->T_world_event).translation().norm(), 0.025);  // 0.14 without
}

TEST(Tracker, IsNotLostWhereEventsMatchNothingButDepthAgreesWithWhereAnInertialSensorLeads) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  for (int k = 1; k <= 280; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    AddReadings(Read, t_ns, &tracker);
    const auto pose = tracker.Track(k <= 60 ? Seen(t_ns, TrueAt(t_ns)) : SeenElsewhere(t_ns));
    ASSERT_TRUE(pose);
    if (k > 200 && k <= 240 && k % 3 == 0) {
      DepthPose depth = ByDepth(t_ns, TrueAt(t_ns));
      depth.confirmed = true;
      tracker.AddDepthPose(depth);
    }
    if (k == 200 || k == 280) {
      EXPECT_EQ(pose->state, TrackingState::kLost) << k;
    }
    if (k < 210 || k > 240) continue;
    EXPECT_EQ(pose->state, TrackingState::kDegraded) << k;
    EXPECT_LT(ErrorOf(*pose), 5e-3) << k;
  }
}

TEST(Tracker, TakesTheEndOfTheEventsOfASlowCameraForAStop) {
  Tracker tracker(TestCamera(), OdometryOptions());
  tracker.SetMap(Map());
  const auto at = [](int k) { return Rigid3::Translation({3e-4 * k, 0, 0}); };  // 0.03 m/s
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 50; ++k) pose = tracker.Track(Seen(k * kPeriod_ns, at(k)));
  for (int k = 51; k <= 150; ++k) {
    pose = tracker.Track(Still(k * kPeriod_ns));
    ASSERT_NE(pose->state, TrackingState::kLost) << k;
  }
  EXPECT_LT(Log(at(50).inverse() * pose->T_world_event).norm(), 6e-3);
}

TEST(Tracker, IsBroughtBackByDepthFromAPoseThatIsWrong) {
  OdometryOptions options;
  options.tracking.ideas.search = false;
  Tracker tracker(TestCamera(), options);
  tracker.SetMap(Map());
  for (int k = 1; k <= 50; ++k) tracker.Track(Seen(k * kPeriod_ns, Rigid3()));
  const Rigid3 jumped = Exp((Vector6d() << 0.05, 0.05, 0, 0.1, -0.1, 0.2).finished());
  for (int k = 51; k <= 60; ++k) tracker.Track(Seen(k * kPeriod_ns, jumped));
  auto pose = tracker.Track(Seen(61 * kPeriod_ns, jumped));
  ASSERT_GT(Log(jumped.inverse() * pose->T_world_event).norm(), 0.05);
  tracker.AddDepthPose(ByDepth(61 * kPeriod_ns, jumped));
  tracker.AddDepthPose(ByDepth(61 * kPeriod_ns + 1, jumped));
  for (int k = 62; k <= 66; ++k) pose = tracker.Track(Seen(k * kPeriod_ns, jumped));
  EXPECT_LT(Log(jumped.inverse() * pose->T_world_event).norm(), 2e-3);
}

TEST(Tracker, KeepsItsVelocityWhereDepthImagesThatFindItAstrayLieFarApart) {
  const auto tracker = Moving();
  const Vector6d other = (Vector6d() << -0.5, 0.4, 0, 0.5, 1.5, 0).finished();
  for (int k = 1; k <= 60; ++k) {
    const std::int64_t t_ns = kNow_ns + k * kPeriod_ns;
    tracker->Track(Seen(t_ns, TrueAt(t_ns)));
    if (k % 20 != 0) continue;
    DepthPose depth = ByDepth(t_ns, TrueAt(kNow_ns) * Exp(other * SecondsFromNs(t_ns - kNow_ns)));
    depth.confirmed = true;
    tracker->AddDepthPose(depth);
  }
  tracker->Track(Blank(kNow_ns + 61 * kPeriod_ns));
  EXPECT_GT((tracker->SurfaceVelocity() - other).norm(), 0.5 * (other - Twist()).norm());
}

/// A camera that stands while its events show another motion, 50 ms after the last of ten depth images that tell.
PoseEstimate LedByFalseEvents(bool doubt_events, bool inertial) {
  OdometryOptions options;
  options.tracking.ideas.doubt_events = doubt_events;
  options.tracking.ideas.search = false;
  Tracker tracker(TestCamera(), options);
  tracker.SetMap(Map());
  std::optional<PoseEstimate> pose;
  for (int k = 1; k <= 35; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    if (inertial) AddReadings([](std::int64_t t) { return ReadAlongX(t, 0); }, t_ns, &tracker);
    pose = tracker.Track(Seen(t_ns, Exp((k % 6 - 3) * (Vector6d() << 0.01, -0.008, 0, 0.005, 0.006, 0).finished())));
    if (k % 3 != 0 || k > 30) continue;
    DepthPose depth = ByDepth(t_ns, Rigid3());
    depth.confirmed = true;
    tracker.AddDepthPose(depth);
  }
  return *pose;
}

TEST(Tracker, FollowsEventsLessAndIsLessSureWhereDepthFindsThemFalseUnlessThatIsSwitchedOff) {
  const PoseEstimate doubted = LedByFalseEvents(true, false), believed = LedByFalseEvents(false, false);
  EXPECT_LT(Log(doubted.T_world_event).norm(), 0.5 * Log(believed.T_world_event).norm());
  EXPECT_GT(doubted.covariance_event.diagonal().head<3>().sum(),
            2 * believed.covariance_event.diagonal().head<3>().sum());
  EXPECT_LT(
      Log(LedByFalseEvents(true, true).T_world_event.inverse() * LedByFalseEvents(false, true).T_world_event).norm(),
      1e-9)
      << "an inertial sensor has its own say";
}

TEST(Tracker, TakesItsVelocityFromDepthWhereItGoesAstrayAgainAndAgain) {
  const auto tracker = Moving();
  const Vector6d other = (Vector6d() << -0.5, 0.4, 0, 0.5, 1.5, 0).finished();
  const auto at = [&](std::int64_t t_ns) { return TrueAt(kNow_ns) * Exp(other * SecondsFromNs(t_ns - kNow_ns)); };
  // Events that show another motion than the camera's.
  for (int k = 1; k <= 9; ++k) {
    const std::int64_t t_ns = kNow_ns + k * kPeriod_ns;
    tracker->Track(Seen(t_ns, TrueAt(t_ns)));
    if (k % 3 != 0) continue;
    DepthPose depth = ByDepth(t_ns, at(t_ns));
    depth.confirmed = true;
    tracker->AddDepthPose(depth);
  }
  EXPECT_LT((tracker->SurfaceVelocity() - other).norm(), 0.1);
}

}  // namespace
}  // namespace devo
