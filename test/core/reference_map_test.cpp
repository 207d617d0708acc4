// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/reference_map.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/core/nearest_edge_field.h"

namespace devo {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

Camera TestCamera() { return {160, 120, 120, 120, 79.5, 59.5, "", {}}; }

/// The point that a camera at the reference sees at a pixel, on an upright edge.
MapPoint PointAt(double u, double v, double z_m) {
  MapPoint point;
  point.p_ref = (z_m * *TestCamera().Unproject({u, v})).cast<float>();
  point.normal_ref = {1, 0, 0};
  return point;
}

/// One edge per (u, v), upright.
Surface SurfaceWith(const std::vector<Eigen::Vector2f>& at) {
  Surface surface;
  surface.image = cv::Mat1b(120, 160, std::uint8_t{0});
  surface.window_s = 0.02;
  for (const auto& u : at) surface.edges.push_back({u.x(), u.y(), 1, 0, 5, 0});
  surface.nearest_edge = cv::Mat1i(120, 160);
  BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
  return surface;
}

ReferenceMap MapOf(std::vector<MapPoint> points, int max_points = 2000, const MappingIdeas& ideas = {}) {
  MappingOptions options;
  options.max_points = max_points;
  options.ideas = ideas;
  ReferenceMap map(TestCamera(), options);
  map.Add(1, Rigid3(), std::move(points));
  return map;
}

TEST(ReferenceMap, ProjectsItsPointsIntoAView) {
  const ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  const auto visible = map.Project(Rigid3::Translation({0.1, 0, 0}), nullptr);
  ASSERT_THAT(visible, SizeIs(1));
  EXPECT_NEAR(visible[0].u, 50 - 120 * 0.1 / 2, 1e-3);
  EXPECT_NEAR(visible[0].v, 40, 1e-3);
  EXPECT_NEAR(visible[0].p_event.z(), 2, 1e-5);
  EXPECT_NEAR(std::abs(visible[0].normal_x), 1, 1e-5);
}

TEST(ReferenceMap, LeavesOutWhatIsOutsideTheImageOrBehindTheCamera) {
  const ReferenceMap map = MapOf({PointAt(50, 40, 2), PointAt(1, 40, 2), PointAt(50, 118.5, 2)});
  EXPECT_THAT(map.Project(Rigid3(), nullptr), SizeIs(1));
  EXPECT_THAT(map.Project(Rigid3::Translation({0, 0, 3}), nullptr), IsEmpty());
  EXPECT_THAT(map.Project(Rigid3::Rotation(ExpSO3({0, M_PI, 0})), nullptr), IsEmpty());
  EXPECT_THAT(map.Project(Rigid3::Translation({20, 0, 0}), nullptr), IsEmpty());
}

TEST(ReferenceMap, HidesPointsBehindTheOccluderOnly) {
  const ReferenceMap map = MapOf({PointAt(20, 40, 2), PointAt(60, 40, 2), PointAt(100, 40, 2), PointAt(140, 40, 2)});
  ReferenceMap::Occluder occluder{Rigid3(), cv::Mat1f(30, 40, 0.0F), 4};
  occluder.nearest_depth_m.colRange(0, 10).setTo(1);       // in front of the first
  occluder.nearest_depth_m.colRange(10, 20).setTo(1.97F);  // the second's own surface, measured a little short
  occluder.nearest_depth_m.colRange(20, 30).setTo(3);      // behind the third; nothing known at the fourth
  const auto visible = map.Project(Rigid3(), &occluder);
  ASSERT_THAT(visible, SizeIs(3));
  EXPECT_NEAR(visible[0].u, 60, 1e-3);
  EXPECT_NEAR(visible[1].u, 100, 1e-3);
  EXPECT_NEAR(visible[2].u, 140, 1e-3);
}

TEST(ReferenceMap, LooksThroughTheOccluderFromItsOwnPose) {
  // From the occluder's pose the point lies 6 pixels further left, where the near surface is.
  const ReferenceMap map = MapOf({PointAt(42, 40, 2)});
  ReferenceMap::Occluder occluder{Rigid3::Translation({0.1, 0, 0}), cv::Mat1f(30, 40, 0.0F), 4};
  occluder.nearest_depth_m.colRange(0, 10).setTo(1);
  EXPECT_THAT(map.Project(Rigid3(), &occluder), IsEmpty());
  occluder.T_world_event = Rigid3();
  EXPECT_THAT(map.Project(Rigid3(), &occluder), SizeIs(1));
}

TEST(ReferenceMap, ExplainsEdgesNearAPointAndOfItsDirection) {
  const ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  Surface surface = SurfaceWith({{50, 40}, {51.8F, 38.4F}, {50, 40}, {50, 40}, {50, 40}, {50, 40}, {55, 40}, {50, 45}});
  const auto turn = [&](int edge, double angle) {
    surface.edges[edge].nx = static_cast<float>(std::cos(angle));
    surface.edges[edge].ny = static_cast<float>(std::sin(angle));
  };
  turn(2, M_PI);                                  // the same direction
  turn(3, 0.35);                                  // 20 degrees
  turn(4, M_PI / 2);                              // across
  surface.edges[5].nx = surface.edges[5].ny = 0;  // unknown
  EXPECT_THAT(map.ExplainedEdges(surface, map.Project(Rigid3(), nullptr)),
              ElementsAre(true, true, true, true, false, true, false, false));
}

TEST(ReferenceMap, ExplainsNothingWhenItIsEmpty) {
  const ReferenceMap map(TestCamera(), MappingOptions());
  EXPECT_TRUE(map.empty());
  EXPECT_THAT(map.ExplainedEdges(SurfaceWith({{50, 40}, {60, 40}}), map.Project(Rigid3(), nullptr)), Each(false));
  EXPECT_THAT(map.AllPoints(), IsEmpty());
}

/// Moving sideways: 1.2 px across upright edges 2 m away in a surface's 20 ms.
Vector6d Sideways() { return Vector6d::Unit(0); }

void Observe(ReferenceMap* map, const Surface& surface, const Vector6d& velocity_event) {
  map->Observe(surface, map->Project(Rigid3(), nullptr), {Rigid3(), velocity_event, 0, false});
  map->DropUnproven();
}

TEST(ReferenceMap, DropsAPointThatMeetsNoEdgeAndKeepsOneThatDoes) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2), PointAt(100, 40, 2)});
  const Surface surface = SurfaceWith({{50.5F, 40}});
  for (int k = 0; k < 5; ++k) Observe(&map, surface, Sideways());
  EXPECT_THAT(map.AllPoints(), SizeIs(2));  // too early to judge
  for (int k = 0; k < 5; ++k) Observe(&map, surface, Sideways());
  ASSERT_THAT(map.AllPoints(), SizeIs(1));
  EXPECT_NEAR(map.Project(Rigid3(), nullptr)[0].u, 50, 1e-3);
}

TEST(ReferenceMap, LetsGoOfReferencesThatLostAllTheirPointsButTheLast) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  const int last = map.Add(0, Rigid3(), {PointAt(100, 40, 2)});
  for (int k = 0; k < 20; ++k) Observe(&map, SurfaceWith({}), Sideways());
  EXPECT_THAT(map.AllPoints(), IsEmpty());
  ASSERT_EQ(map.references().size(), 1U);
  EXPECT_EQ(map.references()[0].id, last);
  EXPECT_FALSE(map.empty());
}

TEST(ReferenceMap, KeepsPointsThatMeetNoEdgeWhenDroppingThemIsSwitchedOff) {
  MappingIdeas ideas;
  ideas.drop_points = false;
  ReferenceMap map = MapOf({PointAt(50, 40, 2), PointAt(100, 40, 2)}, 2000, ideas);
  for (int k = 0; k < 20; ++k) {
    Observe(&map, SurfaceWith({{50.5F, 40}}), Sideways());
  }
  EXPECT_THAT(map.AllPoints(), SizeIs(2));
}

TEST(ReferenceMap, MovesAPointTowardsTheEdgeThatItMeetsInNewViewsOnly) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  const auto see = [&map](bool new_view) {
    map.Observe(SurfaceWith({{50.8F, 40}}), map.Project(Rigid3(), nullptr), {Rigid3(), Sideways(), 0, new_view});
    return map.Project(Rigid3(), nullptr)[0].u;
  };
  const float sigma_px = map.AllPoints()[0].sigma_px;
  EXPECT_NEAR(see(false), 50, 1e-3);
  EXPECT_GT(see(true), 50.05);
  EXPECT_LT(map.AllPoints()[0].sigma_px, sigma_px);
  for (int k = 0; k < 20; ++k) see(true);
  EXPECT_NEAR(map.Project(Rigid3(), nullptr)[0].u, 50.8, 0.15);
}

TEST(ReferenceMap, LeavesPointsWhereTheyAreWhenRefiningThemIsSwitchedOff) {
  MappingIdeas ideas;
  ideas.refine_points = false;
  ReferenceMap map = MapOf({PointAt(50, 40, 2)}, 2000, ideas);
  map.Observe(SurfaceWith({{50.8F, 40}}), map.Project(Rigid3(), nullptr), {Rigid3(), Sideways(), 0, true});
  EXPECT_NEAR(map.Project(Rigid3(), nullptr)[0].u, 50, 1e-3);
}

TEST(ReferenceMap, DoesNotJudgePointsWhoseMotionMakesNoEvents) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2), PointAt(100, 40, 2)});
  for (int k = 0; k < 50; ++k) {
    Observe(&map, SurfaceWith({}), Vector6d::Unit(1));  // along the edges
    Observe(&map, SurfaceWith({}), Vector6d::Zero());
  }
  EXPECT_THAT(map.AllPoints(), SizeIs(2));
}

/// A crowd of points in one corner and one point every 16 pixels elsewhere.
std::vector<MapPoint> CrowdAndSpread() {
  std::vector<MapPoint> points;
  for (int k = 0; k < 3000; ++k) points.push_back(PointAt(3 + k % 25, 3 + k / 25 % 25, 2));
  for (int v = 40; v < 116; v += 16) {
    for (int u = 40; u < 156; u += 16) points.push_back(PointAt(u, v, 2));
  }
  return points;
}

TEST(ReferenceMap, LetsGoOfTheMemoryOfPointsThatItDrops) {
  std::vector<MapPoint> points;
  for (int row = 0; row < 16; ++row) {
    for (int column = 0; column < 25; ++column) points.push_back(PointAt(35 + 2 * column, 35 + 3 * row, 2));
  }
  points.reserve(1000);
  ReferenceMap map = MapOf(points, 1000);
  EXPECT_EQ(map.references()[0].points.capacity(), points.size());
  const std::vector<Eigen::Vector2f> seen = {{35, 35}, {37, 35}, {39, 35}};
  for (int k = 0; k < 10; ++k) Observe(&map, SurfaceWith(seen), Sideways());
  const auto& reference = map.references()[0];
  ASSERT_LT(reference.points.size(), 10U);
  EXPECT_LT(reference.points.capacity(), 20U);
  EXPECT_LT(reference.evidence.capacity(), 20U);
}

TEST(ReferenceMap, SelectsNoMorePointsThanAllowedAndTakesThemFromTheCrowd) {
  const ReferenceMap map = MapOf(CrowdAndSpread(), 200);
  const auto selected = map.Select(map.Project(Rigid3(), nullptr), Rigid3());
  EXPECT_LE(selected.size(), 200U);
  EXPECT_GE(selected.size(), 150U);
  const auto elsewhere = std::count_if(selected.begin(), selected.end(), [](const MapPoint& point) {
    return TestCamera().Project(point.p_ref.cast<double>())->x() > 35;
  });
  EXPECT_EQ(elsewhere, 40);  // all that there are
}

TEST(ReferenceMap, SelectsMostlyFromTheCrowdWhenSpreadingIsSwitchedOff) {
  MappingIdeas ideas;
  ideas.spread_points = false;
  const ReferenceMap map = MapOf(CrowdAndSpread(), 200, ideas);
  const auto selected = map.Select(map.Project(Rigid3(), nullptr), Rigid3());
  EXPECT_EQ(selected.size(), 200U);
  const auto elsewhere = std::count_if(selected.begin(), selected.end(), [](const MapPoint& point) {
    return TestCamera().Project(point.p_ref.cast<double>())->x() > 35;
  });
  EXPECT_LT(elsewhere, 15);  // their share of all points is 3 of 200
}

TEST(ReferenceMap, SelectsEverythingWhereThereIsNoCrowd) {
  auto points = CrowdAndSpread();
  points.erase(points.begin(), points.end() - 40);
  const ReferenceMap map = MapOf(points, 50);
  EXPECT_THAT(map.Select(map.Project(Rigid3(), nullptr), Rigid3()), SizeIs(40));
}

TEST(ReferenceMap, PrefersPointsThatProvedThemselves) {
  std::vector<MapPoint> points;
  for (int row = 0; row < 8; ++row) {
    for (int column = 0; column < 25; ++column) points.push_back(PointAt(35 + column, 35 + 3 * row, 2));
  }
  ReferenceMap map = MapOf(points, 100);
  std::vector<Eigen::Vector2f> seen;  // those of the left half
  for (const auto& point : map.Project(Rigid3(), nullptr)) {
    if (point.u < 44) seen.emplace_back(point.u, point.v);
  }
  for (int k = 0; k < 5; ++k) Observe(&map, SurfaceWith(seen), Sideways());
  const auto selected = map.Select(map.Project(Rigid3(), nullptr), Rigid3());
  const auto left = std::count_if(selected.begin(), selected.end(), [](const MapPoint& point) {
    return TestCamera().Project(point.p_ref.cast<double>())->x() < 46;
  });
  EXPECT_GE(left, static_cast<long>(0.7 * static_cast<double>(seen.size())));
}

TEST(ReferenceMap, GivesSelectedPointsInTheFrameOfTheViewAndAllPointsInWorld) {
  ReferenceMap map(TestCamera(), MappingOptions());
  const Rigid3 T_world_ref(ExpSO3({0.1, 0.2, -0.1}), {1, 2, 3}),
      T_world_view = T_world_ref * Exp(0.02 * Vector6d::Ones());
  const MapPoint point = PointAt(60, 50, 2);
  EXPECT_EQ(map.Add(7, T_world_ref, {point}), 0);
  EXPECT_EQ(map.Add(8, Rigid3(), {PointAt(70, 60, 1)}), 1);
  const Eigen::Vector3d in_world = T_world_ref * point.p_ref.cast<double>();
  const auto all = map.AllPoints();
  ASSERT_THAT(all, SizeIs(2));
  EXPECT_LT((all[0].p_ref.cast<double>() - in_world).norm(), 1e-5);
  EXPECT_LT((all[0].normal_ref.cast<double>() - T_world_ref.rotation() * Eigen::Vector3d(1, 0, 0)).norm(), 1e-5);
  EXPECT_EQ(all[0].reference, 0);
  EXPECT_EQ(all[1].reference, 1);

  const auto selected = map.Select(map.Project(T_world_view, nullptr), T_world_view);
  ASSERT_THAT(selected, SizeIs(1));
  EXPECT_LT((T_world_view * selected[0].p_ref.cast<double>() - in_world).norm(), 1e-5);
}

TEST(ReferenceMap, SaysOfAGuessedDepthHowFarItMayBeOffAndKeepsItOutOfTheGlobalMapUntilViewsHaveFoundIt) {
  ReferenceMap map = MapOf({PointAt(40, 40, 2)});
  const double truth_m = 2;
  map.AddGuessed(2, Rigid3(), {PointAt(100, 60, 3)});
  const auto guessed = [&map](const Rigid3& T_world_event) {
    for (const MapPoint& point : map.Select(map.Project(T_world_event, nullptr), Rigid3())) {
      if (!point.sigma_depth_ref.isZero()) return point;
    }
    return MapPoint();
  };
  EXPECT_GT(guessed(Rigid3()).sigma_depth_ref.norm(), 1);
  EXPECT_LT(guessed(Rigid3()).sigma_depth_ref.cross(guessed(Rigid3()).p_ref).norm(), 1e-5) << "along its ray";
  EXPECT_THAT(map.AllPoints(), SizeIs(1));
  for (int k = 1; k <= 40; ++k) {
    const Rigid3 T_world_event = Rigid3::Translation({0.01 * k, 0, 0});
    const auto at = *TestCamera().Project(T_world_event.inverse() * PointAt(100, 60, truth_m).p_ref.cast<double>());
    const auto known = *TestCamera().Project(T_world_event.inverse() * PointAt(40, 40, 2).p_ref.cast<double>());
    map.Observe(SurfaceWith({at.cast<float>(), known.cast<float>()}), map.Project(T_world_event, nullptr),
                {T_world_event, Sideways(), 0, true});
  }
  EXPECT_NEAR(guessed(Rigid3()).p_ref.z(), truth_m, 0.04);
  EXPECT_LT(guessed(Rigid3()).sigma_depth_ref.norm(), 0.1);
  EXPECT_THAT(map.AllPoints(), SizeIs(2));
}

TEST(ReferenceMap, GivesUpPointsOfGuessedDepthOnlyWhereOthersStandForThem) {
  MappingIdeas ideas;
  ideas.drop_points = false;  // which is another reason
  ReferenceMap map = MapOf({PointAt(40, 40, 2)}, 2000, ideas);
  map.AddGuessed(2, Rigid3(), {PointAt(60, 60, 3), PointAt(100, 60, 3)});
  auto visible = map.Project(Rigid3(), nullptr);
  map.LeaveGuessed([](const ReferenceMap::Visible& point) { return point.u < 80; }, &visible);
  EXPECT_THAT(visible, SizeIs(2));
  map.Observe(SurfaceWith({}), visible, {Rigid3(), Sideways(), 0, false});
  map.DropUnproven();
  EXPECT_THAT(map.Project(Rigid3(), nullptr), SizeIs(2));
  visible = map.Project(Rigid3(), nullptr);
  map.LeaveGuessed([](const ReferenceMap::Visible&) { return true; }, &visible);
  EXPECT_THAT(visible, SizeIs(1));
  map.Observe(SurfaceWith({}), visible, {Rigid3(), Sideways(), 0, false});
  map.DropUnproven();
  EXPECT_THAT(map.references(), SizeIs(1)) << "nothing is left of the other";
}

TEST(ReferenceMap, IsNoneTheLessAMapWhereItsLastReferenceWasGuessedAndNoPointIsLeft) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  map.AddGuessed(2, Rigid3(), {PointAt(60, 60, 3)});
  const Surface surface = SurfaceWith({{5, 5}});
  for (int k = 0; k < 200; ++k) Observe(&map, surface, Sideways());
  EXPECT_THAT(map.Project(Rigid3(), nullptr), IsEmpty());
  EXPECT_FALSE(map.empty());
}

TEST(ReferenceMap, SeesOnlyTheReferencesOfItsChapterAndKeepsTheOthers) {
  ReferenceMap map = MapOf({PointAt(50, 40, 2)});
  map.BeginChapter();
  EXPECT_TRUE(map.chapter_empty());
  EXPECT_THAT(map.Project(Rigid3(), nullptr), IsEmpty());
  map.Add(2, Rigid3(), {PointAt(90, 60, 2), PointAt(100, 60, 2)});
  EXPECT_THAT(map.Project(Rigid3(), nullptr), SizeIs(2));
  EXPECT_THAT(map.AllPoints(), SizeIs(3));
  map.ReturnTo(0);
  EXPECT_THAT(map.Project(Rigid3(), nullptr), SizeIs(1));
  map.BeginChapter();
  EXPECT_EQ(map.chapter(), 2);
}

TEST(ReferenceMap, ForgetsTheReferenceThatWasOutOfViewForLongestWhenItIsFull) {
  const Camera camera(100, 80, 100, 100, 49.5, 39.5, "", {});
  MappingOptions options;
  options.max_map_points = 1000;
  ReferenceMap map(camera, options);
  const auto points = [](float x) {
    MapPoint point;
    point.p_ref = {x, 0, 2};
    return std::vector<MapPoint>(400, point);
  };
  const int seen_again = map.Add(0, Rigid3(), points(0));
  const int forgotten = map.Add(1, Rigid3::Translation({10, 0, 0}), points(0));
  Surface surface;
  surface.image = cv::Mat1b(80, 100, std::uint8_t{0});
  surface.nearest_edge = cv::Mat1i(80, 100, std::int32_t{Surface::kNoEdge});
  Observe(&map, surface, Vector6d::Zero());
  const int newest = map.Add(2, Rigid3::Translation({20, 0, 0}), points(0));
  ASSERT_EQ(map.references().size(), 2U) << "without " << forgotten;
  EXPECT_EQ(map.references()[0].id, seen_again);
  EXPECT_EQ(map.references()[1].id, newest);
}

}  // namespace
}  // namespace devo
