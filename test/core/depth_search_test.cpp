// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_search.h"

#include <gtest/gtest.h>

#include "depth_scene.h"

namespace devo {
namespace {

std::optional<Rigid3> PlaceOf(const Rigid3& T_world_depth, const std::vector<Rigid3>& starts,
                              DepthScene scene = DepthScene::kFurnishedRoom) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3(), 0.004, scene, 1));
  return SearchPlace(aligner, ref, aligner.Reduce(DepthSeen(T_world_depth, 0.004, scene, 2)), starts);
}

TEST(DepthSearch, FindsAPlaceHalfAMetreFromWhereItIsThoughtToBe) {
  const Rigid3 truth = Exp((Vector6d() << 0.1, 0.05, -0.1, 0.05, -0.1, 0.02).finished());
  for (const Eigen::Vector3d& off : {Eigen::Vector3d(0.5, 0, 0), Eigen::Vector3d(-0.3, -0.2, 0.3)}) {
    const auto place = PlaceOf(truth, ShiftedStarts(truth * Rigid3::Translation(off), 0.25));
    ASSERT_TRUE(place) << off.transpose();
    EXPECT_LT(Log(truth.inverse() * *place).norm(), 0.03) << off.transpose();
  }
}

TEST(DepthSearch, FindsAPlaceThatNothingWasThoughtOfByTheReferencesOwn) {
  for (const double turn_rad : {-0.4, -0.2, 0.2, 0.3}) {
    const Rigid3 truth = Rigid3(Eigen::Quaterniond(ExpSO3({0.1, turn_rad, 0.05})), {0.1, -0.05, 0.1});
    const auto place = PlaceOf(truth, TurnedStarts());
    ASSERT_TRUE(place) << turn_rad;
    EXPECT_LT(Log(truth.inverse() * *place).norm(), 0.03) << turn_rad;
  }
}

TEST(DepthSearch, IsEmptyWhereOtherPlacesFitAboutAsWell) {
  EXPECT_FALSE(PlaceOf(Rigid3::Translation({0.3, 0.1, 0}), ShiftedStarts(Rigid3(), 0.2), DepthScene::kWall));
}

TEST(DepthSearch, IsEmptyWhereNoStartOverlaps) {
  EXPECT_FALSE(PlaceOf(Rigid3::Rotation(ExpSO3({0, 3, 0})), TurnedStarts()));
  EXPECT_FALSE(PlaceOf(Rigid3(), {}));
}

}  // namespace
}  // namespace devo
