// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/mapper.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "depth_scene.h"
#include "devo/core/nearest_edge_field.h"
#include "devo/core/time.h"

namespace devo {
namespace {

using ::testing::SizeIs;

// A wall 2 m away, depth registered to an event image without distortion.
Rig TestRig() {
  Rig rig;
  rig.event_camera = rig.depth_camera = Camera(160, 120, 120, 120, 79.5, 59.5, "", {});
  rig.depth_registered = true;
  return rig;
}

DepthImage Wall(std::int64_t t_ns, float z_m = 2) { return {t_ns, cv::Mat1f(120, 160, z_m)}; }

/// Upright edge points on a grid: `count` of them from the column `u0` on.
std::vector<EdgePoint> Edges(int count, float u0) {
  std::vector<EdgePoint> edges;
  for (int k = 0; k < count; ++k) {
    const int column = k / 50, row = k % 50;
    edges.push_back({u0 + static_cast<float>(8 * column), static_cast<float>(10 + 2 * row), 1, 0, 5, 0});
  }
  return edges;
}

SurfacePtr SurfaceAt(std::int64_t t_ns, const std::vector<EdgePoint>& edges, std::uint64_t epoch = 0) {
  auto surface = std::make_shared<Surface>();
  surface->t_ns = surface->t_edges_ns = t_ns;
  surface->epoch = epoch;
  surface->window_s = 0.01;
  surface->image = cv::Mat1b(120, 160, std::uint8_t{0});
  surface->edges = edges;
  surface->nearest_edge = cv::Mat1i(120, 160);
  BuildNearestEdgeField(edges, 4, &surface->nearest_edge);
  return surface;
}

PoseEstimate PoseAt(std::int64_t t_ns, const Rigid3& T_world_event = Rigid3()) {
  PoseEstimate pose;
  pose.t_ns = pose.t_edges_ns = t_ns;
  pose.T_world_event = pose.T_world_event_edges = T_world_event;
  pose.state = TrackingState::kTracking;
  return pose;
}

PoseEstimate LostAt(std::int64_t t_ns, const Rigid3& T_world_event = Rigid3(), bool needs_map = false) {
  PoseEstimate pose = PoseAt(t_ns, T_world_event);
  pose.state = TrackingState::kLost;
  pose.needs_map = needs_map;
  return pose;
}

constexpr std::int64_t kMs = 1'000'000;

/// A mapper with its first reference: 400 edges in columns 16 to 72, at the time 100 ms and the identity.
Mapper WithFirstReference(const OdometryOptions& options = OdometryOptions()) {
  Mapper mapper(TestRig(), options);
  mapper.AddSurface(SurfaceAt(100 * kMs, Edges(400, 16)));
  mapper.AddDepth(Wall(100 * kMs));
  EXPECT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 1U);
  return mapper;
}

TEST(Mapper, WaitsWithTheFirstReferenceForEnoughPoints) {
  Mapper mapper(TestRig(), OdometryOptions());
  mapper.AddSurface(SurfaceAt(100 * kMs, Edges(150, 16)));
  mapper.AddDepth(Wall(100 * kMs));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 0U);
  EXPECT_EQ(mapper.scene_depth().median_m, 2);  // known all the same
  mapper.AddSurface(SurfaceAt(130 * kMs, Edges(400, 16)));
  mapper.AddDepth(Wall(130 * kMs));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_THAT(map->points, SizeIs(400));
  EXPECT_EQ(map->t_ns, 130 * kMs);
  EXPECT_EQ(map->id, 0);
  EXPECT_LT(Log(map->T_world_ref).norm(), 1e-12);
}

TEST(Mapper, BeginsWithNoSurfaceThatMayBeNoise) {
  Mapper mapper(TestRig(), OdometryOptions());
  auto noise = std::make_shared<Surface>(*SurfaceAt(100 * kMs, Edges(400, 16)));
  noise->maybe_noise = true;
  mapper.AddSurface(noise);
  mapper.AddDepth(Wall(100 * kMs));
  EXPECT_FALSE(mapper.Update());
  mapper.AddSurface(SurfaceAt(130 * kMs, Edges(400, 16)));
  mapper.AddDepth(Wall(130 * kMs));
  EXPECT_TRUE(mapper.Update());
}

TEST(Mapper, PutsPointsWhereTheirEdgesAndDepthAre) {
  Mapper mapper = WithFirstReference();
  const auto points = mapper.GlobalMap();
  ASSERT_THAT(points, SizeIs(400));
  EXPECT_NEAR(points[0].p_ref.x(), 2 * (16 - 79.5) / 120, 1e-3);
  EXPECT_NEAR(points[0].p_ref.y(), 2 * (10 - 59.5) / 120, 1e-3);
  EXPECT_NEAR(points[0].p_ref.z(), 2, 1e-3);
}

TEST(Mapper, DoesNothingWithoutDepthOrWithoutSurfaces) {
  Mapper only_surfaces(TestRig(), OdometryOptions()), only_depth(TestRig(), OdometryOptions());
  for (int k = 0; k < 50; ++k) {
    only_surfaces.AddSurface(SurfaceAt(10 * k * kMs, Edges(400, 16)));
    EXPECT_FALSE(only_surfaces.Update());
    only_depth.AddDepth(Wall(10 * k * kMs));
    EXPECT_FALSE(only_depth.Update());
  }
  EXPECT_EQ(only_depth.counters().depth_in, 50U);
  EXPECT_EQ(only_depth.counters().depth_used, 0U);
}

SurfacePtr SurfaceWithActivity(std::int64_t t_ns, const std::vector<EdgePoint>& edges, double activity_hz) {
  auto surface = std::make_shared<Surface>(*SurfaceAt(t_ns, edges));
  surface->activity_hz = activity_hz;
  surface->still = activity_hz < SurfaceOptions().still_activity_hz;
  return surface;
}

/// Surfaces from 100 ms to 400 ms, of which those after 300 ms show a motion, and one image of the beginning; the time
/// of the first map.
std::optional<std::int64_t> FirstMapAfterARest(const OdometryOptions& options) {
  Mapper mapper(TestRig(), options);
  mapper.AddDepth(Wall(100 * kMs));
  for (std::int64_t t_ns = 100 * kMs; t_ns <= 400 * kMs; t_ns += 10 * kMs) {
    const bool moves = t_ns > 300 * kMs;
    mapper.AddSurface(SurfaceWithActivity(t_ns, Edges(moves ? 400 : 0, 16), moves ? 2.0 : 0.0));
    if (const auto map = mapper.Update()) {
      EXPECT_THAT(mapper.GlobalMap(), SizeIs(400));
      EXPECT_EQ(mapper.counters().depth_used, 1U);
      return map->t_ns;
    }
  }
  return std::nullopt;
}

TEST(Mapper, BeginsWithTheDepthOfARestWhenTheCameraMovesUnlessThatIsSwitchedOff) {
  OdometryOptions options;
  // 2 Hz of 19200 pixels are 384 events in 10 ms, about one for each edge.
  EXPECT_EQ(FirstMapAfterARest(options), 330 * kMs);
  options.mapping.ideas.depth_of_rest = false;
  EXPECT_EQ(FirstMapAfterARest(options), std::nullopt);
}

TEST(Mapper, MakesNoNewReferenceOfWhatTheMapExplains) {
  Mapper mapper = WithFirstReference();
  for (int k = 2; k < 10; ++k) {
    mapper.AddSurface(SurfaceAt(100 * k * kMs, Edges(400, 16.5F)));
    mapper.AddPose(PoseAt(100 * k * kMs));
    mapper.AddDepth(Wall(100 * k * kMs));
    EXPECT_FALSE(mapper.Update());
  }
  EXPECT_EQ(mapper.counters().references, 1U);
  EXPECT_EQ(mapper.counters().depth_used, 9U);
}

TEST(Mapper, AddsOnlyTheUnexplainedEdgesAsANewReference) {
  Mapper mapper = WithFirstReference();
  std::vector<EdgePoint> edges = Edges(400, 16);
  const auto added = Edges(200, 100);
  edges.insert(edges.end(), added.begin(), added.end());
  mapper.AddSurface(SurfaceAt(200 * kMs, edges));
  mapper.AddPose(PoseAt(200 * kMs));
  mapper.AddDepth(Wall(200 * kMs));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(mapper.counters().references, 2U);
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(600));
  EXPECT_THAT(map->points, SizeIs(600));
}

/// Of the wall, the columns from here on have no reading.
DepthImage WallUpTo(std::int64_t t_ns, int column) {
  DepthImage wall = Wall(t_ns);
  wall.depth_m.colRange(column, wall.depth_m.cols).setTo(0);
  return wall;
}

std::vector<EdgePoint> EdgesOnBothSides() {
  std::vector<EdgePoint> edges = Edges(400, 16);
  const auto beside = Edges(200, 106);
  edges.insert(edges.end(), beside.begin(), beside.end());
  return edges;
}

std::size_t CountGuessed(const std::vector<MapPoint>& points) {
  return static_cast<std::size_t>(std::count_if(points.begin(), points.end(),
                                                [](const MapPoint& point) { return !point.sigma_depth_ref.isZero(); }));
}

TEST(Mapper, GuessesTheDepthOfEdgesBesideTheMapAndTheDepthImageUntilOneReadsItUnlessThatIsSwitchedOff) {
  for (const bool guess : {true, false}) {
    OdometryOptions options;
    options.mapping.ideas.guess_depth = guess;
    Mapper mapper = WithFirstReference(options);
    mapper.AddSurface(SurfaceAt(200 * kMs, EdgesOnBothSides()));
    mapper.AddPose(PoseAt(200 * kMs));
    mapper.AddDepth(WallUpTo(200 * kMs, 90));
    const auto map = mapper.Update();
    ASSERT_EQ(map != nullptr, guess);
    EXPECT_THAT(mapper.GlobalMap(), SizeIs(400));
    if (!guess) continue;
    EXPECT_THAT(map->points, SizeIs(600));
    EXPECT_EQ(CountGuessed(map->points), 200U);
    for (const MapPoint& point : map->points) EXPECT_NEAR(point.p_ref.z(), 2, 1e-3);
    mapper.AddSurface(SurfaceAt(300 * kMs, EdgesOnBothSides()));
    mapper.AddPose(PoseAt(300 * kMs));
    mapper.AddDepth(Wall(300 * kMs));
    const auto read = mapper.Update();
    ASSERT_TRUE(read);
    EXPECT_THAT(read->points, SizeIs(600));
    EXPECT_EQ(CountGuessed(read->points), 0U);
    EXPECT_THAT(mapper.GlobalMap(), SizeIs(600));
  }
}

TEST(Mapper, GuessesNothingFromAPoseThatIsNotSure) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, EdgesOnBothSides()));
  PoseEstimate pose = PoseAt(200 * kMs);
  pose.state = TrackingState::kDegraded;
  mapper.AddPose(pose);
  mapper.AddDepth(WallUpTo(200 * kMs, 90));
  EXPECT_FALSE(mapper.Update());
}

TEST(Mapper, GuessesNothingBeyondADepthCamerasRangeUntilTheWayIsKnownUnlessPosesAloneTellIt) {
  const auto guesses = [](int columns_read, double sigma_m, bool velocity_of_poses) {
    Mapper mapper = WithFirstReference();
    mapper.AddSurface(SurfaceAt(200 * kMs, EdgesOnBothSides()));
    PoseEstimate pose = PoseAt(200 * kMs);
    pose.covariance_in_chapter.diagonal().head<3>().setConstant(sigma_m * sigma_m);
    pose.velocity_of_poses = velocity_of_poses;
    mapper.AddPose(pose);
    mapper.AddDepth(WallUpTo(200 * kMs, columns_read));
    return mapper.Update() != nullptr;
  };
  const int quarter = 40, half = 90;
  EXPECT_FALSE(guesses(quarter, 0.02, false));
  EXPECT_TRUE(guesses(quarter, 0.002, false));
  EXPECT_TRUE(guesses(quarter, 0.02, true));
  EXPECT_TRUE(guesses(half, 0.02, false));
}

TEST(Mapper, MeasuresEdgesBesideTheMapWithTheLastDepthImageWhereNoOtherComes) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, EdgesOnBothSides()));
  mapper.AddPose(PoseAt(200 * kMs, Rigid3::Translation({0, 0, 0.5})));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(CountGuessed(map->points), 0U);
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(600));
  for (const MapPoint& point : mapper.GlobalMap()) EXPECT_NEAR(point.p_ref.z(), 2, 1e-2);
}

Rigid3 TurnedRight(double angle_rad) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitY())), Eigen::Vector3d::Zero()};
}

TEST(Mapper, LetsTheScenesDepthFollowTheViewBetweenDepthImagesUnlessThatIsSwitchedOff) {
  for (const bool follow : {true, false}) {
    OdometryOptions options;
    options.mapping.ideas.follow_scene = follow;
    Mapper mapper(TestRig(), options);
    mapper.AddSurface(SurfaceAt(100 * kMs, Edges(400, 16)));
    DepthImage near_on_the_right = Wall(100 * kMs);
    near_on_the_right.depth_m.colRange(112, 160).setTo(1);
    mapper.AddDepth(near_on_the_right);
    ASSERT_TRUE(mapper.Update());
    EXPECT_FLOAT_EQ(mapper.scene_depth().inverse_depth(3, 5), 0.5F);
    mapper.AddSurface(SurfaceAt(150 * kMs, Edges(400, 16)));
    mapper.AddPose(PoseAt(150 * kMs, TurnedRight(0.4)));  // by 50 px
    mapper.Update();
    const SceneDepth& after = mapper.scene_depth();
    EXPECT_EQ(after.t_ns, (follow ? 150 : 100) * kMs);
    EXPECT_NEAR(after.inverse_depth(3, 5), follow ? 0.9 : 0.5, 0.05);  // 1 m along the axis of before
  }
}

/// Points left of a map whose edges are not seen again for 150 ms, in which the camera turns that fast, and another
/// depth image comes.
std::size_t PointsLeftAfterTurning(double rad_s) {
  Mapper mapper = WithFirstReference();
  for (int k = 1; k <= 15; ++k) {
    PoseEstimate pose = PoseAt((100 + 10 * k) * kMs, TurnedRight(-0.01 * rad_s * k));
    pose.velocity_event << 1, 0, 0, 0, 0, 0;  // clear motion: their edges would show
    mapper.AddSurface(SurfaceAt(pose.t_ns, {}));
    mapper.AddPose(pose);
    mapper.Update();
  }
  mapper.AddDepth(Wall(250 * kMs));
  mapper.Update();
  return mapper.GlobalMap().size();
}

TEST(Mapper, ObservesTheMapFromEachOtherViewWhereDepthImagesComeSeldom) {
  EXPECT_EQ(PointsLeftAfterTurning(0.2), 400U);  // seen four times: too seldom to judge them
  EXPECT_LT(PointsLeftAfterTurning(2), 100U);
}

TEST(Mapper, WithoutReuseKeepsOnlyTheNewestReference) {
  OdometryOptions options;
  options.mapping.reuse_references = false;
  options.mapping.new_reference_distance_m = 0.1;
  Mapper mapper = WithFirstReference(options);
  for (const auto& [ms, x_m, references] : {std::tuple<int, double, unsigned>{200, 0.05, 1}, {300, 0.15, 2}}) {
    mapper.AddSurface(SurfaceAt(ms * kMs, Edges(300, 16)));
    mapper.AddPose(PoseAt(ms * kMs, Rigid3::Translation({x_m, 0, 0})));
    mapper.AddDepth(Wall(ms * kMs));
    mapper.Update();
    EXPECT_EQ(mapper.counters().references, references);
  }
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(300));
}

TEST(Mapper, CountsDepthImagesWithoutAValidPixel) {
  Mapper mapper(TestRig(), OdometryOptions());
  for (const float invalid : {0.0F, std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    mapper.AddSurface(SurfaceAt(100 * kMs, Edges(400, 16)));
    mapper.AddDepth(Wall(100 * kMs, invalid));
    EXPECT_FALSE(mapper.Update());
  }
  EXPECT_EQ(mapper.counters().depth_in, 3U);
  EXPECT_EQ(mapper.counters().depth_without_valid_pixel, 3U);
  EXPECT_EQ(mapper.counters().depth_used, 0U);
}

TEST(Mapper, MeetsADepthImageThatComesLateWithTheSurfaceAndPoseOfItsTime) {
  Mapper mapper = WithFirstReference();
  // 1 m/s to the right; the surface at 200 ms alone shows something new.
  for (int ms = 110; ms <= 300; ms += 10) {
    mapper.AddSurface(SurfaceAt(ms * kMs, ms == 200 ? Edges(200, 120) : Edges(100, 16)));
    PoseEstimate pose = PoseAt(ms * kMs, Rigid3::Translation({0.001 * (ms - 100), 0, 0}));
    pose.state = TrackingState::kDegraded;  // by such poses the map does not grow between depth images
    mapper.AddPose(pose);
    mapper.Update();
  }
  mapper.AddDepth(Wall(200 * kMs));
  ASSERT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 2U);
  const auto points = mapper.GlobalMap();
  ASSERT_GT(points.size(), 400U);
  EXPECT_NEAR(points[400].p_ref.x(), 0.1 + 2 * (120 - 79.5) / 120, 2e-3);
}

TEST(Mapper, KnowsThePoseOfADepthImageBetweenTheFirstMapAndTheFirstPose) {
  Mapper mapper = WithFirstReference();
  // To the right, faster and faster; tracking has the map, and with it all poses since, from 160 ms on.
  const auto at = [](int ms) { return Rigid3::Translation({1e-5 * (ms - 100) * (ms - 100), 0, 0}); };
  for (int ms = 110; ms <= 170; ms += 10) {
    mapper.AddSurface(SurfaceAt(ms * kMs, ms == 130 ? Edges(200, 120) : Edges(100, 16)));
    if (ms == 130) mapper.AddDepth(Wall(130 * kMs));
    PoseEstimate pose = PoseAt(ms * kMs, at(ms));
    for (int t = 100; ms == 160 && t < ms; t += 10) pose.earlier.push_back({t * kMs, at(t)});
    if (ms >= 160) mapper.AddPose(pose);
    mapper.Update();
  }
  EXPECT_EQ(mapper.counters().references, 2U);
  const auto points = mapper.GlobalMap();
  ASSERT_GT(points.size(), 400U);
  EXPECT_NEAR(points[400].p_ref.x(), 0.009 + 2 * (120 - 79.5) / 120, 2e-3);
}

TEST(Mapper, MeetsADepthImageThatComesLateAtAHighRateOfSurfacesToo) {
  OdometryOptions options;
  options.surface.rate_hz = 1000;
  Mapper mapper = WithFirstReference(options);
  for (int ms = 101; ms <= 350; ++ms) {
    mapper.AddSurface(SurfaceAt(ms * kMs, std::abs(ms - 200) <= 10 ? Edges(200, 120) : Edges(100, 16)));
    mapper.AddPose(PoseAt(ms * kMs, Rigid3::Translation({0.001 * (ms - 100), 0, 0})));
    mapper.Update();
  }
  mapper.AddDepth(Wall(200 * kMs));
  ASSERT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 2U);
  EXPECT_LE(std::abs(mapper.last_match().surface->t_ns - 200 * kMs), 10 * kMs);
}

/// A point of a reference made of a surface at 190 ms and a depth image 4 ms later, nearing the wall at 10 m/s.
double DepthOfMovedImage_m(const OdometryOptions& options) {
  Mapper mapper = WithFirstReference(options);
  for (const int ms : {190, 200}) {
    mapper.AddSurface(SurfaceAt(ms * kMs, Edges(200, 100)));
    mapper.AddPose(PoseAt(ms * kMs, Rigid3::Translation({0, 0, 0.01 * (ms - 190)})));
  }
  mapper.AddDepth(Wall(194 * kMs));
  EXPECT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 2U);
  return mapper.GlobalMap().back().p_ref.z();
}

TEST(Mapper, MovesADepthImageToTheTimeOfItsSurfaceUnlessThatIsSwitchedOff) {
  OdometryOptions options;
  EXPECT_NEAR(DepthOfMovedImage_m(options), 2.04, 5e-3);
  options.mapping.ideas.move_depth = false;
  EXPECT_NEAR(DepthOfMovedImage_m(options), 2, 5e-3);
}

TEST(Mapper, LeavesPointsThatADepthImageHidesOutOfTheLocalMapUnlessThatIsSwitchedOff) {
  for (const bool hide : {true, false}) {
    OdometryOptions options;
    options.mapping.ideas.hide_points = hide;
    Mapper mapper = WithFirstReference(options);
    mapper.AddSurface(SurfaceAt(200 * kMs, {}));
    mapper.AddPose(PoseAt(200 * kMs, Rigid3::Translation({0.05, 0, 0})));
    mapper.AddDepth(Wall(200 * kMs, 1));
    const auto map = mapper.Update();
    ASSERT_TRUE(map);
    EXPECT_EQ(map->points.empty(), hide);
  }
}

TEST(Mapper, WaitsForThePoseOfTheSurface) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(300, 100)));
  mapper.AddDepth(Wall(200 * kMs));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_used, 1U);
  mapper.AddPose(PoseAt(200 * kMs));
  EXPECT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_used, 2U);
}

TEST(Mapper, DropsADepthImageThatHasNoSurfaceNearby) {
  Mapper mapper(TestRig(), OdometryOptions());
  mapper.AddDepth(Wall(100 * kMs));
  mapper.AddSurface(SurfaceAt(500 * kMs, Edges(400, 16)));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_used, 0U);
  EXPECT_EQ(mapper.counters().depth_too_late, 0U) << "it is of before the first surface";
}

TEST(Mapper, CountsDepthThatComesWhenSurfacesOfItsTimeAreKeptNoLonger) {
  Mapper mapper(TestRig(), OdometryOptions());
  for (int k = 0; k <= 100; ++k) mapper.AddSurface(SurfaceAt((100 + 10 * k) * kMs, Edges(400, 16)));
  mapper.AddDepth(Wall(500 * kMs));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_too_late, 1U);
  mapper.AddDepth(Wall(1000 * kMs));
  EXPECT_TRUE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_too_late, 1U);
}

TEST(Mapper, IsNotHeldUpByADepthImageThatIsStampedFarAhead) {
  Mapper mapper = WithFirstReference();
  mapper.AddDepth(Wall(100'000 * kMs));
  mapper.AddDepth(Wall(200 * kMs));
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(400, 16)));
  mapper.AddPose(PoseAt(200 * kMs));
  mapper.Update();
  EXPECT_EQ(mapper.counters().depth_used, 2U);
}

TEST(Mapper, AddsNothingWhileTrackingIsLost) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(300, 100)));
  mapper.AddPose(LostAt(200 * kMs));
  mapper.AddDepth(Wall(200 * kMs));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().references, 1U);
}

TEST(Mapper, BeginsAChapterAtTheGuessedPoseWhenTrackingAsksForItAndReturnsWithIt) {
  Mapper mapper = WithFirstReference();
  const Rigid3 guess = Rigid3::Translation({0.5, 0, 0});
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(400, 80)));
  mapper.AddPose(LostAt(200 * kMs, guess, true));
  mapper.AddDepth(Wall(200 * kMs));
  const auto begun = mapper.Update();
  ASSERT_TRUE(begun);
  EXPECT_EQ(begun->chapter, 1);
  EXPECT_THAT(begun->points, SizeIs(400));
  EXPECT_LT(Log(guess.inverse() * begun->T_world_ref).norm(), 1e-9);
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(800));

  // Tracking found the first chapter again instead.
  mapper.AddSurface(SurfaceAt(300 * kMs, Edges(400, 16)));
  mapper.AddPose(PoseAt(300 * kMs));
  const auto returned = mapper.Update();
  ASSERT_TRUE(returned);
  EXPECT_EQ(returned->chapter, 0);
  EXPECT_THAT(returned->points, SizeIs(400));
}

TEST(Mapper, HidesAndMeasuresNothingByADepthImageThatCameWhileTrackingWasLost) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(400, 16)));
  mapper.AddPose(LostAt(200 * kMs, Rigid3::Translation({0.05, 0, 0})));
  mapper.AddDepth(Wall(200 * kMs, 1));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_used, 2U);
  mapper.AddSurface(SurfaceAt(210 * kMs, Edges(400, 16)));
  mapper.AddPose(PoseAt(210 * kMs, Rigid3::Translation({0.1, 0, 0})));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_GT(map->points.size(), 300U);
  for (const MapPoint& point : map->points) EXPECT_NEAR(point.p_ref.z(), 2, 1e-2);
}

TEST(Mapper, HidesAndMeasuresNothingByADepthImageOfBeforeALossThatEventsEnded) {
  Mapper mapper = WithFirstReference();
  // At a pose that had gone astray, a surface met this image.
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(400, 16)));
  mapper.AddPose(PoseAt(200 * kMs, Rigid3::Translation({0, 0, 0.9})));
  mapper.AddDepth(Wall(200 * kMs, 0.5F));
  mapper.Update();
  mapper.AddSurface(SurfaceAt(210 * kMs, Edges(400, 16)));
  mapper.AddPose(LostAt(210 * kMs, Rigid3::Translation({0, 0, 0.9})));
  mapper.Update();
  PoseEstimate found = PoseAt(300 * kMs);
  found.earlier = {{290 * kMs, Rigid3()}};
  mapper.AddSurface(SurfaceAt(300 * kMs, EdgesOnBothSides()));
  mapper.AddPose(found);
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  for (const MapPoint& point : mapper.GlobalMap()) EXPECT_GT(point.p_ref.z(), 1.3);
  EXPECT_FALSE(mapper.last_match().surface);
}

TEST(Mapper, WithoutReuseStaysInTheChapterThatItBegan) {
  OdometryOptions options;
  options.mapping.reuse_references = false;
  Mapper mapper = WithFirstReference(options);
  const auto map_at = [&mapper](const PoseEstimate& pose) {
    mapper.AddSurface(SurfaceAt(pose.t_ns, Edges(400, 16)));
    mapper.AddPose(pose);
    mapper.AddDepth(Wall(pose.t_ns));
    return mapper.Update();
  };
  PoseEstimate in_it = PoseAt(300 * kMs, Rigid3::Translation({0.7, 0, 0}));
  in_it.chapter = 1;
  const auto begun = map_at(LostAt(200 * kMs, Rigid3::Translation({0.5, 0, 0}), true)), next = map_at(in_it);
  ASSERT_TRUE(begun && next);
  EXPECT_EQ(begun->chapter, 1);
  EXPECT_EQ(next->chapter, 1);
  EXPECT_EQ(mapper.counters().references, 3U);
}

TEST(Mapper, ComposesTheLocalMapAnewWhenTheViewHasMovedOn) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(200 * kMs, Edges(400, 16)));
  mapper.AddPose(PoseAt(200 * kMs, Rigid3::Translation({0.01, 0, 0})));
  EXPECT_FALSE(mapper.Update());
  mapper.AddSurface(SurfaceAt(210 * kMs, Edges(400, 16)));
  const Rigid3 moved = Rigid3::Translation({0.1, 0, 0});
  mapper.AddPose(PoseAt(210 * kMs, moved));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(map->id, 1);
  EXPECT_LT(Log(moved.inverse() * map->T_world_ref).norm(), 1e-12);
  ASSERT_FALSE(map->points.empty());
  EXPECT_NEAR(map->points[0].p_ref.z(), 2, 1e-3);
}

TEST(Mapper, ComposesTheLocalMapAnewWithOtherOptionsAndKeepsItsReferences) {
  Mapper mapper = WithFirstReference();
  EXPECT_FALSE(mapper.Update());
  OdometryOptions fewer;
  fewer.mapping.max_points = 100;
  mapper.SetOptions(fewer);
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_LE(map->points.size(), 100U);
  EXPECT_GT(map->points.size(), 50U);
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(400));
  EXPECT_FALSE(mapper.Update()) << "once is enough";
}

TEST(Mapper, ForgetsItsMapWhenASurfaceOfANewEpochComes) {
  Mapper mapper = WithFirstReference();
  mapper.AddSurface(SurfaceAt(10 * kMs, Edges(300, 16), 1));
  EXPECT_THAT(mapper.GlobalMap(), SizeIs(0));
  mapper.AddDepth(Wall(10 * kMs));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(map->epoch, 1U);
  EXPECT_THAT(map->points, SizeIs(300));
}

/// With the depth camera that sees the corner of a room.
Rig RoomRig() {
  Rig rig = TestRig();
  rig.depth_registered = false;
  rig.depth_camera = DepthSceneCamera();
  return rig;
}

/// What a mapper that has seen nothing yet says of the last of five depth images of a room's corner, which is off its
/// predicted pose by this; the predicted ones are as `like`.
std::vector<DepthPose> LastByDepth(const Rigid3& off, const PoseEstimate& like, std::int64_t period_ns,
                                   Mapper* mapper) {
  std::vector<DepthPose> poses;
  for (int k = 1; k <= 5; ++k) {
    const std::int64_t t_ns = k * period_ns;
    mapper->AddSurface(SurfaceAt(t_ns, Edges(600, 16)));
    PoseEstimate predicted = like;
    predicted.t_ns = predicted.t_edges_ns = t_ns;
    if (k > 1) mapper->AddPose(predicted);
    mapper->AddDepth({t_ns, DepthSeen(k < 5 ? Rigid3() : off, 0.002, DepthScene::kRoom, k)});
    mapper->Update();
    poses = mapper->TakeDepthPoses();
  }
  EXPECT_TRUE(mapper->TakeDepthPoses().empty()) << "each is given once";
  return poses;
}

/// One image that is off is held back, as the depth camera may have begun to see otherwise: these believe it at once.
OdometryOptions BelievingJumps(OdometryOptions options) {
  options.mapping.ideas.depth_jumps = false;
  return options;
}

std::vector<DepthPose> PosesByDepth(const OdometryOptions& options, const Rigid3& off) {
  Mapper mapper(RoomRig(), BelievingJumps(options));
  auto poses = LastByDepth(off, PoseAt(0), 100 * kMs, &mapper);
  EXPECT_EQ(mapper.counters().depth_aligned, options.mapping.align_depth ? 3U : 0U);
  return poses;
}

TEST(Mapper, SaysWhereTheCameraWasByDepthUnlessThatIsSwitchedOff) {
  const Rigid3 off = Exp((Vector6d() << 0.01, -0.02, 0.01, 0.01, 0.01, -0.01).finished());
  OdometryOptions options;
  const auto poses = PosesByDepth(options, off);
  ASSERT_THAT(poses, SizeIs(1));
  EXPECT_EQ(poses[0].t_ns, 500 * kMs);
  EXPECT_LT(Log(off.inverse() * poses[0].T_world_event).norm(), 2e-3);
  options.mapping.align_depth = false;
  EXPECT_TRUE(PosesByDepth(options, off).empty());
}

TEST(Mapper, SaysWhereTheCameraWasBeforeItMapsTheDepthImageIfAskedTo) {
  Mapper at_once(RoomRig(), OdometryOptions()), first(RoomRig(), OdometryOptions());
  for (int k = 1; k <= 5; ++k) {
    for (Mapper* mapper : {&at_once, &first}) {
      mapper->AddSurface(SurfaceAt(100 * k * kMs, Edges(600, 16)));
      if (k > 1) mapper->AddPose(PoseAt(100 * k * kMs));
      mapper->AddDepth({100 * k * kMs, DepthSeen(Rigid3(), 0.002, DepthScene::kRoom, k)});
    }
    first.AlignDepth();
    const auto poses = first.TakeDepthPoses();
    first.Update();
    EXPECT_TRUE(first.TakeDepthPoses().empty()) << "each image is aligned once";
    at_once.Update();
    const auto expected = at_once.TakeDepthPoses();
    ASSERT_EQ(poses.size(), expected.size());
    ASSERT_EQ(poses.size(), k < 3 ? 0U : 1U);
    if (!poses.empty()) EXPECT_EQ(poses[0].T_world_event.translation(), expected[0].T_world_event.translation());
  }
  EXPECT_EQ(first.counters().depth_aligned, 3U);
  EXPECT_EQ(first.counters().depth_used, 5U);
  EXPECT_EQ(first.GlobalMap().size(), at_once.GlobalMap().size());
}

TEST(Mapper, AlignsTheImageThatTookThePlaceOfOneWithAWrongStamp) {
  Mapper mapper(RoomRig(), OdometryOptions());
  for (int k = 1; k <= 4; ++k) {
    mapper.AddSurface(SurfaceAt(100 * k * kMs, Edges(600, 16)));
    if (k > 1) mapper.AddPose(PoseAt(100 * k * kMs));
    if (k < 4) mapper.AddDepth({100 * k * kMs, DepthSeen(Rigid3(), 0.002, DepthScene::kRoom, k)});
    if (k < 4) mapper.Update();
  }
  mapper.TakeDepthPoses();
  mapper.AddDepth({400 * kMs, DepthSeen(Rigid3(), 0.002, DepthScene::kRoom, 4)});
  mapper.AlignDepth();
  EXPECT_THAT(mapper.TakeDepthPoses(), SizeIs(1));
  mapper.AddDepth({390 * kMs, DepthSeen(Rigid3(), 0.002, DepthScene::kRoom, 5)});
  mapper.Update();
  const auto poses = mapper.TakeDepthPoses();
  ASSERT_THAT(poses, SizeIs(1));
  EXPECT_EQ(poses[0].t_ns, 390 * kMs);
}

/// Whether a depth image is confirmed of which tracking, like this, is off by 17 mm.
bool IsConfirmed(const PoseEstimate& like, std::int64_t period_ns, bool doubt_events = true) {
  OdometryOptions options;
  options.tracking.ideas.doubt_events = doubt_events;
  Mapper mapper(RoomRig(), BelievingJumps(options));
  const auto poses = LastByDepth(Rigid3::Translation({-0.01, 0.01, -0.01}), like, period_ns, &mapper);
  EXPECT_THAT(poses, SizeIs(1));
  return !poses.empty() && poses[0].confirmed;
}

TEST(Mapper, ConfirmsDepthPosesThatMayContradictWithoutAnInertialSensorUnlessThatIsSwitchedOff) {
  PoseEstimate guided = PoseAt(0);
  guided.covariance_in_chapter = 4e-5 * Matrix6d::Identity();
  PoseEstimate alone = guided;
  alone.velocity_of_poses = true;
  EXPECT_FALSE(IsConfirmed(guided, 33 * kMs));
  EXPECT_TRUE(IsConfirmed(alone, 33 * kMs));
  EXPECT_FALSE(IsConfirmed(alone, 200 * kMs)) << "not in quick succession";
  EXPECT_FALSE(IsConfirmed(alone, 33 * kMs, false));
  PoseEstimate fits = alone;
  fits.covariance_in_chapter *= 30;
  PoseEstimate unsure = fits;
  unsure.state = TrackingState::kDegraded;
  EXPECT_FALSE(IsConfirmed(fits, 33 * kMs));
  EXPECT_TRUE(IsConfirmed(unsure, 33 * kMs));
  EXPECT_TRUE(IsConfirmed(unsure, 200 * kMs));
  EXPECT_FALSE(IsConfirmed(unsure, 33 * kMs, false));
}

TEST(Mapper, SaysWhereTheCameraWasByTheDepthImageOfTheFirstMapWhereMoreThanEventsTellsItsPose) {
  const Rigid3 off = Exp((Vector6d() << 0.01, -0.02, 0.01, 0.01, 0.01, -0.01).finished());
  for (const bool by_events : {false, true}) {
    Mapper mapper(RoomRig(), OdometryOptions());
    mapper.AddSurface(SurfaceAt(100 * kMs, Edges(600, 16)));
    mapper.AddDepth({100 * kMs, DepthSeen(Rigid3(), 0.002, DepthScene::kRoom, 1)});
    ASSERT_TRUE(mapper.Update());
    mapper.AddSurface(SurfaceAt(200 * kMs, Edges(600, 16)));
    PoseEstimate pose = PoseAt(200 * kMs);
    pose.earlier = {{100 * kMs, Rigid3()}};
    pose.velocity_of_poses = by_events;
    mapper.AddPose(pose);
    mapper.AddDepth({200 * kMs, DepthSeen(off, 0.002, DepthScene::kRoom, 2)});
    mapper.Update();
    const auto poses = mapper.TakeDepthPoses();
    ASSERT_THAT(poses, SizeIs(by_events ? 0 : 1));
    if (by_events) continue;
    EXPECT_LT(Log(off.inverse() * poses[0].T_world_event).norm(), 3e-3);
  }
}

TEST(Mapper, GoesOnWhereDepthFindsACameraThatIsLost) {
  Mapper mapper(RoomRig(), OdometryOptions());
  const auto add = [&](int k, const Rigid3& truth, const PoseEstimate& pose) {
    mapper.AddSurface(SurfaceAt(100 * k * kMs, Edges(600, 16)));
    if (k > 1) mapper.AddPose(pose);
    mapper.AddDepth({100 * k * kMs, DepthSeen(truth, 0.002, DepthScene::kRoom, k)});
    return mapper.Update();
  };
  for (int k = 1; k <= 3; ++k) add(k, Rigid3(), PoseAt(100 * k * kMs));
  const Rigid3 truth = Rigid3::Translation({0.05, 0.02, -0.05});
  PoseEstimate lost = LostAt(1000 * kMs, truth * Rigid3::Translation({0.4, 0, 0.2}));
  lost.velocity_of_poses = false;
  lost.covariance_in_chapter = std::pow(0.2, 2) * Matrix6d::Identity();
  const auto map = add(10, truth, lost);
  ASSERT_TRUE(map);
  EXPECT_TRUE(map->found_by_depth);
  EXPECT_EQ(map->chapter, 0);
  EXPECT_EQ(map->t_ns, 1000 * kMs);
  EXPECT_LT(Log(truth.inverse() * map->T_world_ref).norm(), 5e-3);
  const auto next = add(11, truth, PoseAt(1100 * kMs, truth * Rigid3::Translation({0.2, 0, 0})));
  ASSERT_TRUE(next);
  EXPECT_FALSE(next->found_by_depth);
}

TEST(Mapper, LeavesOutADepthImageThatComesAgainWithAnotherStamp) {
  Mapper mapper(RoomRig(), OdometryOptions());
  DepthImage depth;
  for (int k = 1; k <= 5; ++k) {
    const Rigid3 T_world_event = Rigid3::Translation({0.01 * (k - 1), 0, 0});
    mapper.AddSurface(SurfaceAt(100 * k * kMs, Edges(600, 16)));
    if (k > 1) mapper.AddPose(PoseAt(100 * k * kMs, T_world_event));
    if (k != 4) depth.depth_m = DepthSeen(T_world_event, 0.002, DepthScene::kRoom, k);
    depth.t_ns = 100 * k * kMs;
    mapper.AddDepth(depth);
    mapper.Update();
    EXPECT_EQ(mapper.TakeDepthPoses().empty(), k < 3 || k == 4) << k;
  }
  EXPECT_EQ(mapper.counters().depth_repeated, 1U);
  EXPECT_EQ(mapper.counters().depth_used, 4U);
}

TEST(Mapper, SaysWhereTheCameraWasByDepthAllThroughAGapOfTheEvents) {
  Mapper mapper(RoomRig(), OdometryOptions());
  const auto depth_at = [](std::int64_t t_ns) {
    return DepthImage{t_ns, DepthSeen(Rigid3(), 0, DepthScene::kRoom, 1)};
  };
  for (const std::int64_t t_ms : {100, 110}) {
    mapper.AddSurface(SurfaceAt(t_ms * kMs, Edges(600, 16)));
    if (t_ms > 100) mapper.AddPose(PoseAt(t_ms * kMs));
    mapper.AddDepth(depth_at(t_ms * kMs));
    mapper.Update();
  }
  // Without events there are no surfaces: they all come with the first event after the gap.
  constexpr std::int64_t kEnd_ms = 1400;
  for (std::int64_t t_ms = 133; t_ms < kEnd_ms; t_ms += 33) mapper.AddDepth(depth_at(t_ms * kMs));
  std::int64_t last_ms = 110, longest_ms = 0;
  for (std::int64_t t_ms = 120; t_ms <= kEnd_ms; t_ms += 10) {
    mapper.AddSurface(SurfaceAt(t_ms * kMs, {}));
    mapper.AddPose(PoseAt(t_ms * kMs));
    mapper.Update();
    for (const DepthPose& pose : mapper.TakeDepthPoses()) {
      longest_ms = std::max(longest_ms, pose.t_ns / kMs - last_ms);
      last_ms = pose.t_ns / kMs;
    }
  }
  EXPECT_LE(longest_ms, 66);
  EXPECT_GE(last_ms, kEnd_ms - 66);
}

/// A wall 2 m away as a LiDAR of 16 beams sees it in a tenth of a second, of which the camera sees the middle third.
LidarSweep WallSweep(std::int64_t end_ns) {
  LidarSweep sweep;
  sweep.end_ns = end_ns;
  for (int column = 0; column < 300; ++column) {
    for (int ring = 0; ring < 16; ++ring) {
      const double azimuth = (90 - 0.6 * column) * M_PI / 180, elevation = (2 * ring - 15) * M_PI / 180;
      if (std::abs(azimuth) > 1.4) continue;
      const Eigen::Vector3d p(2, 2 * std::tan(azimuth), 2 * std::tan(elevation) / std::cos(azimuth));
      sweep.points.push_back({p.cast<float>(), ring, end_ns - (299 - column) * kMs / 3});
    }
  }
  return sweep;
}

Rig LidarRig() {
  Rig rig = TestRig();
  rig.depth_registered = false;
  rig.depth_from_lidar = true;
  rig.T_event_depth = Rigid3::Rotation(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5).inverse());
  return rig;
}

/// A mapper with its first reference, of the wall, at the identity.
Mapper WithFirstSweep() {
  Mapper mapper(LidarRig(), OdometryOptions());
  mapper.AddSurface(SurfaceAt(50 * kMs, Edges(600, 16)));
  mapper.AddSurface(SurfaceAt(110 * kMs, Edges(600, 16)));
  mapper.AddSweep(WallSweep(100 * kMs));
  EXPECT_TRUE(mapper.Update());
  return mapper;
}

TEST(Mapper, BeginsWithOneSweepOfALidarAndTheSurfaceOfTheTimeInWhichItPassedTheView) {
  Mapper mapper(LidarRig(), OdometryOptions());
  for (int k = 0; k <= 10; ++k) mapper.AddSurface(SurfaceAt((100 + 10 * k) * kMs, Edges(600, 16)));
  mapper.AddSweep(WallSweep(210 * kMs));
  EXPECT_FALSE(mapper.Update()) << "the sweep ends after the last surface";
  mapper.AddSurface(SurfaceAt(210 * kMs, Edges(600, 16)));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(map->t_ns, 160 * kMs);
  EXPECT_GT(map->points.size(), 300U) << "thirty degrees of the height are measured";
  for (const MapPoint& point : map->points) EXPECT_NEAR(point.p_ref.z(), 2, 2e-3);
  EXPECT_EQ(mapper.scene_depth().median_m, mapper.lidar_depth().depth_m(60, 80));
  EXPECT_EQ(mapper.counters().depth_used, 1U);
}

TEST(Mapper, BeginsWithNoSweepWhoseSurfacesAreKeptNoLonger) {
  Mapper mapper(LidarRig(), OdometryOptions());
  for (int k = 0; k <= 100; ++k) mapper.AddSurface(SurfaceAt((100 + 10 * k) * kMs, Edges(600, 16)));
  mapper.AddSweep(WallSweep(600 * kMs));
  EXPECT_FALSE(mapper.Update());
  EXPECT_EQ(mapper.counters().depth_too_late, 1U);
  EXPECT_EQ(mapper.counters().depth_without_valid_pixel, 0U);
  mapper.AddSweep(WallSweep(1050 * kMs));
  EXPECT_TRUE(mapper.Update());
}

TEST(Mapper, UsesTheNewestSurfaceForASweepOnceThereArePoses) {
  Mapper mapper = WithFirstSweep();
  // Half a metre forward since: the wall, which the sweep finds 2 m away, is another one, and so are the edges.
  const Rigid3 T_world_event = Rigid3::Translation({0, 0, 0.5});
  for (int k = 11; k <= 22; ++k) {
    mapper.AddSurface(SurfaceAt(10 * k * kMs, Edges(600, 20)));
    mapper.AddPose(PoseAt(10 * k * kMs, T_world_event));
  }
  mapper.AddSweep(WallSweep(218 * kMs));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(mapper.lidar_depth().t_ns, 220 * kMs);
  EXPECT_EQ(map->t_ns, 220 * kMs);
  EXPECT_EQ(mapper.counters().references, 2U);
  EXPECT_NEAR(mapper.GlobalMap().back().p_ref.z(), 2.5, 2e-3);
}

TEST(Mapper, BeginsAChapterWithTheSweepOfANewViewNotWithThoseBefore) {
  Mapper mapper = WithFirstSweep();
  const Rigid3 turned_round = Rigid3::Rotation(ExpSO3({0, M_PI, 0}));
  for (int k = 12; k <= 22; ++k) {
    mapper.AddSurface(SurfaceAt(10 * k * kMs, Edges(600, 20)));
    mapper.AddPose(LostAt(10 * k * kMs, turned_round, true));
  }
  mapper.AddSweep(WallSweep(218 * kMs));
  const auto map = mapper.Update();
  ASSERT_TRUE(map);
  EXPECT_EQ(map->chapter, 1);
  EXPECT_GT(map->points.size(), 300U);
  for (const MapPoint& point : map->points) EXPECT_NEAR(point.p_ref.z(), 2, 2e-3);
}

}  // namespace
}  // namespace devo
