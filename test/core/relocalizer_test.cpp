// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/relocalizer.h"

#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include <utility>

#include <gtest/gtest.h>

#include "devo/core/nearest_edge_field.h"
#include "segment_scene.h"

namespace devo {
namespace {

Camera TestCamera() { return SegmentCamera(); }

/// Segments 1.5 to 3 m from a view at `T_world_ref`; another `place`, others.
LocalMapPtr Map(int place, const Rigid3& T_world_ref = {}) {
  auto map = std::make_shared<LocalMap>();
  map->id = place;
  map->T_world_ref = T_world_ref;
  map->points = SegmentScene(static_cast<unsigned>(place), 1.5, 6);
  return map;
}

/// What a camera at the pose sees of the map.
Surface Seen(const LocalMap& map, const Rigid3& T_world_event) {
  return SegmentsSeen(map.points, T_world_event.inverse() * map.T_world_ref);
}

Rigid3 Pose(double x, double y, double z, double pitch, double yaw, double roll) {
  Vector6d xi;
  xi << x, y, z, pitch, yaw, roll;
  return Exp(xi);
}

constexpr double kMinShare = 0.6;

void ExpectFound(const std::optional<Relocalizer::Found>& found, const LocalMapPtr& map, const Rigid3& truth) {
  ASSERT_TRUE(found);
  EXPECT_EQ(found->map, map);
  EXPECT_GE(found->alignment.inlier_share, kMinShare);
  const Vector6d error = Log(truth.inverse() * found->T_world_event);
  EXPECT_LT(error.head<3>().norm(), 2e-3);
  EXPECT_LT(error.tail<3>().norm(), 2e-3);
}

/// Known to about so many metres and radians.
Relocalizer::Expectation From(std::vector<Rigid3> starts, double sigma = 1e3) {
  return {std::move(starts), sigma * sigma * Matrix6d::Identity(), 0};
}

/// Places far from the origin and from each other.
Rigid3 PlaceView(int place) { return Pose(2.0 * place, 0.3, 0, 0, 0.5 * place, 0); }

TEST(Relocalizer, FindsAPoseThatIsFartherOffThanTheTrackerReaches) {
  const auto map = Map(1, Pose(1, 2, 3, 0.1, 0.2, 0.3));
  for (const Rigid3& off : {Pose(0.03, -0.04, 0.05, 0.02, -0.01, 0.04), Pose(-0.05, 0.02, -0.04, -0.02, 0.02, 0)}) {
    const Rigid3 truth = map->T_world_ref * off;
    Relocalizer relocalizer(TestCamera(), {});
    ExpectFound(relocalizer.Search(Seen(*map, truth), map, From({map->T_world_ref}), false, kMinShare), map, truth);
  }
}

TEST(Relocalizer, FindsAPoseAcrossAGapInWhichTheCameraTurned) {
  const auto map = Map(2);
  for (const Rigid3& truth :
       {Pose(0.02, 0, 0, 0, 0.25, 0), Pose(0, 0.02, 0, -0.2, 0.1, 0.02), Pose(0, 0, 0.02, 0.15, -0.2, -0.02)}) {
    Relocalizer relocalizer(TestCamera(), {});
    ExpectFound(relocalizer.Search(Seen(*map, truth), map, From({Rigid3()}), false, kMinShare), map, truth);
  }
}

TEST(Relocalizer, TakesTheBestOfItsHypotheses) {
  const auto map = Map(3);
  const Rigid3 truth = Pose(0.8, 0, -0.3, 0, -0.3, 0.5);
  const Surface surface = Seen(*map, truth);
  Relocalizer relocalizer(TestCamera(), {});
  const Rigid3 wrong = Pose(-0.5, 0.5, 0, 0.5, 0.5, -0.5), near = truth * Pose(0.02, 0.02, 0, 0.02, 0.01, 0.02);
  EXPECT_FALSE(relocalizer.Search(surface, map, From({wrong}), false, kMinShare));
  ExpectFound(relocalizer.Search(surface, map, From({wrong, near}), false, kMinShare), map, truth);
  ExpectFound(relocalizer.Search(surface, map, From({near, wrong}), false, kMinShare), map, truth);
}

TEST(Relocalizer, FindsNothingInASurfaceWithoutEdgesOrOfAnotherPlace) {
  const auto map = Map(4);
  Relocalizer relocalizer(TestCamera(), {});
  EXPECT_FALSE(relocalizer.Search(Surface(), map, From({Rigid3()}), true, 0));
  EXPECT_FALSE(relocalizer.Search(Seen(*Map(5), Rigid3()), map, From({Rigid3()}), true, kMinShare));
}

TEST(Relocalizer, FindsNothingWhenLessThanTheNeededShareMatches) {
  const auto map = Map(6);
  Surface half = Seen(*map, Rigid3());
  half.edges.resize(half.edges.size() / 2);
  BuildNearestEdgeField(half.edges, 4, &half.nearest_edge);
  Relocalizer relocalizer(TestCamera(), {});
  EXPECT_FALSE(relocalizer.Search(half, map, From({Rigid3()}), false, 0.9));
  EXPECT_TRUE(relocalizer.Search(half, map, From({Rigid3()}), false, 0.4));
}

TEST(Relocalizer, TakesNoPoseThatTooFewPointsHoldHoweverLargeTheirShare) {
  const auto whole = Map(12);
  const Rigid3 truth = Pose(0.03, -0.04, 0.05, 0.02, -0.01, 0.04);
  Relocalizer relocalizer(TestCamera(), {});
  for (const std::size_t points : {60U, 240U}) {
    auto map = std::make_shared<LocalMap>(*whole);
    const std::size_t every = whole->points.size() / points;
    map->points.clear();
    for (std::size_t i = 0; i < points; ++i) map->points.push_back(whole->points[i * every]);
    const auto found = relocalizer.Search(Seen(*whole, truth), map, From({truth}), false, kMinShare);
    EXPECT_EQ(found.has_value(), points > 100);
  }
}

TEST(Relocalizer, ReturnsToARememberedPlaceOnlyWhenAskedTo) {
  const auto map = Map(7), place = Map(8, PlaceView(8));
  const Rigid3 truth = place->T_world_ref * Pose(0.03, 0.02, -0.02, 0.01, 0.02, -0.02);
  const Surface surface = Seen(*place, truth);
  Relocalizer relocalizer(TestCamera(), {});
  EXPECT_FALSE(relocalizer.Search(surface, map, From({Rigid3()}), true, kMinShare));
  relocalizer.Remember(place);
  EXPECT_FALSE(relocalizer.Search(surface, map, From({Rigid3()}), false, kMinShare));
  ExpectFound(relocalizer.Search(surface, map, From({Rigid3()}), true, kMinShare), place, truth);
}

TEST(Relocalizer, TakesNoViewThatIsTooFarFromWhereTheCameraCanBeUnlessItIsOfAnotherChapter) {
  const auto map = Map(7);
  auto place = std::make_shared<LocalMap>(*Map(8, PlaceView(2)));
  for (const int chapter : {0, 1}) {
    place->chapter = chapter;
    Relocalizer relocalizer(TestCamera(), {});
    relocalizer.Remember(place);
    const Surface surface = Seen(*place, place->T_world_ref);
    EXPECT_EQ(relocalizer.Search(surface, map, From({Rigid3()}, 0.1), true, kMinShare).has_value(), chapter == 1);
    EXPECT_TRUE(relocalizer.Search(surface, map, From({Rigid3()}, 2), true, kMinShare));
  }
}

TEST(Relocalizer, FindsAPoseNoFartherFromWhereItIsExpectedThanItIsAskedTo) {
  const auto map = Map(1);
  const Rigid3 truth = Pose(0.03, -0.04, 0.05, 0.02, -0.01, 0.04);
  const Surface surface = Seen(*map, truth);
  Relocalizer relocalizer(TestCamera(), {});
  Relocalizer::Expectation four_sigmas_off = From({Rigid3()}, Log(truth).norm() / 4);
  ExpectFound(relocalizer.Search(surface, map, four_sigmas_off, false, kMinShare), map, truth);
  four_sigmas_off.most_square = 9;
  EXPECT_FALSE(relocalizer.Search(surface, map, four_sigmas_off, false, kMinShare));
}

TEST(Relocalizer, TriesEveryPlaceWithinAFewSearches) {
  const auto map = Map(9);
  for (int wanted = 10; wanted < 18; wanted += 3) {
    Relocalizer relocalizer(TestCamera(), {});
    for (int place = 10; place < 18; ++place) relocalizer.Remember(Map(place, PlaceView(place)));
    const Surface surface = Seen(*Map(wanted, PlaceView(wanted)), PlaceView(wanted));
    bool found = false;
    for (int search = 0; search < 8 && !found; ++search) {
      const auto result = relocalizer.Search(surface, map, From({Rigid3()}), true, kMinShare);
      found = result && result->map->id == wanted;
    }
    EXPECT_TRUE(found) << "place " << wanted;
  }
}

TEST(Relocalizer, KeepsTheNewerOfTwoMapsOfNearlyTheSameView) {
  const Rigid3 view = PlaceView(18), same = view * Pose(0.02, 0, 0, 0, 0.02, 0);
  const auto older = Map(18, view), newer = Map(19, same);
  Relocalizer relocalizer(TestCamera(), {});
  relocalizer.Remember(older);
  relocalizer.Remember(newer);
  EXPECT_FALSE(relocalizer.Search(Seen(*older, view), Map(20), From({Rigid3()}), true, kMinShare));
  ExpectFound(relocalizer.Search(Seen(*newer, same), Map(20), From({Rigid3()}), true, kMinShare), newer, same);
}

TEST(Relocalizer, ForgetsItsPlacesWhenCleared) {
  const auto place = Map(21, PlaceView(21));
  const Surface surface = Seen(*place, place->T_world_ref);
  Relocalizer relocalizer(TestCamera(), {});
  relocalizer.Remember(place);
  relocalizer.Clear();
  EXPECT_FALSE(relocalizer.Search(surface, Map(22), From({Rigid3()}), true, kMinShare));
}

TEST(Relocalizer, DoesNotTakeTheMapSeenFromAfarForTheFewEdgesThatASurfaceHas) {
  // What is left of the events at the begin of a standstill: some short edges.
  Relocalizer relocalizer(TestCamera(), {});
  for (int seed = 1; seed <= 40; ++seed) {
    const auto map = Map(seed);
    LocalMap left = *map;
    left.points.resize(60);
    const auto found = relocalizer.Search(Seen(left, Rigid3()), map, From({Pose(0.1, 0, 0, 0, 0, 0)}), false, 0);
    if (found) {
      EXPECT_LT(found->T_world_event.translation().norm(), 3) << seed;
    }
  }
}

}  // namespace
}  // namespace devo
