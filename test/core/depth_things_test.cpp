// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_things.h"

#include <set>

#include <gtest/gtest.h>

#include "depth_scene.h"
#include "devo/core/depth_alignment.h"

namespace devo {
namespace {

DepthCells Seen(DepthScene scene, const Rigid3& T_world_depth = Rigid3()) {
  return DepthAligner(DepthSceneCamera()).Reduce(DepthSeen(T_world_depth, 0.003, scene));
}

TEST(FindThings, ABoxIsOneThingAndTheFloorThatItStandsOnIsNone) {
  const DepthCells cells = Seen(DepthScene::kBoxBeforeWall);
  EXPECT_EQ(cells.things, 1);
  int on_box = 0, on_floor = 0, floor = 0;
  for (const DepthCells::Cell& cell : cells.cells) {
    if (cell.n.isZero()) continue;
    const bool is_floor = cell.p.y() > 0.88F, is_box = cell.p.y() < 0.8F && cell.p.z() < 2;
    floor += is_floor ? 1 : 0;
    on_floor += is_floor && cell.thing >= 0 ? 1 : 0;
    if (is_box) {
      EXPECT_EQ(cell.thing, 0) << cell.p.transpose();
      ++on_box;
    }
  }
  EXPECT_GT(on_box, 50);
  EXPECT_LT(on_floor, 0.02 * floor);
}

TEST(FindThings, ThingsThatStandApartAreTold) {
  const DepthCells cells = Seen(DepthScene::kFurnishedRoom);
  EXPECT_GE(cells.things, 3);
  std::set<int> seen;
  for (const DepthCells::Cell& cell : cells.cells) {
    ASSERT_LT(cell.thing, cells.things);
    seen.insert(cell.thing);
  }
  EXPECT_EQ(seen.size(), static_cast<std::size_t>(cells.things) + 1) << "each has cells, and so has the room";
}

TEST(FindThings, AnImageWithoutDepthHasNone) {
  DepthCells cells;
  cells.columns = 8;
  cells.cells.resize(64);
  FindThings(&cells);
  EXPECT_EQ(cells.things, 0);
  EXPECT_EQ(cells.cells[0].thing, -1);
}

DepthAligner::CellMask Alone(const DepthCells& cells) {
  const DepthAligner aligner(DepthSceneCamera());
  const auto result = aligner.Align(cells, cells, Rigid3());
  return result ? aligner.OnWhatAloneHolds(cells, cells, *result) : DepthAligner::CellMask{1};
}

TEST(OnWhatAloneHolds, IsTheOneBoxThatShowsASidewaysMotionOverAFloor) {
  const DepthCells cells = Seen(DepthScene::kBoxBeforeWall);
  const auto mask = Alone(cells);
  ASSERT_EQ(mask.size(), cells.cells.size());
  for (std::size_t i = 0; i < mask.size(); ++i) EXPECT_EQ(mask[i] != 0, cells.cells[i].thing == 0) << i;
}

TEST(OnWhatAloneHolds, IsNothingWhereWallsAndFloorTellAllDirections) {
  const Rigid3 to_the_left = Rigid3::Rotation(ExpSO3({0, -0.6, 0}));
  EXPECT_TRUE(Alone(Seen(DepthScene::kRoom, to_the_left)).empty());
}

}  // namespace
}  // namespace devo
