// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_alignment.h"

#include <stdexcept>
#include <string>

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

#include "depth_scene.h"

namespace devo {
namespace {

const Rigid3& Moved() {
  static const Rigid3 T = [] {
    Vector6d xi;
    xi << 0.03, -0.02, 0.04, 0.02, -0.03, 0.015;
    return Exp(xi);
  }();
  return T;
}

TEST(DepthAlignment, FindsAMotionOfCentimetresAndDegreesInNoisyImagesToAMillimetre) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3(), 0.005)),
                   now = aligner.Reduce(DepthSeen(Moved(), 0.005, DepthScene::kRoom, 2));
  const auto result = aligner.Align(ref, now, Rigid3());
  ASSERT_TRUE(result);
  const Vector6d error = Log(Moved().inverse() * result->T_ref_depth);
  EXPECT_LT(error.head<3>().norm(), 1e-3);
  EXPECT_LT(error.tail<3>().norm(), 1e-3);
  EXPECT_GT(result->overlap, 0.8);
  EXPECT_LT(result->sigma_m, 0.005) << "cells average the noise of their readings";
}

TEST(DepthAlignment, IsExactWithoutNoiseFromAnyStartNearBy) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3())), now = aligner.Reduce(DepthSeen(Moved()));
  for (int axis = 0; axis < 6; ++axis) {
    for (const double step : {-0.03, 0.03}) {
      const auto result = aligner.Align(ref, now, Moved() * Exp(step * Vector6d::Unit(axis)));
      ASSERT_TRUE(result) << axis;
      EXPECT_LT(Log(Moved().inverse() * result->T_ref_depth).norm(), 5e-4) << axis << " " << step;
    }
  }
}

// What shows where it is are the few cells on the box, many of them on its edges.
TEST(DepthAlignment, IsNotLedAstrayByTheCreasesOfTheOneThingOnAFloor) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3(), 0, DepthScene::kBoxOnFloor), 0, 4);
  for (const double moved_m : {0.01, 0.02, 0.03, 0.04}) {
    const Rigid3 T_ref_now = Exp((Vector6d() << moved_m, 0, -moved_m, 0, 0.2 * moved_m, 0).finished());
    const DepthCells now = aligner.Reduce(DepthSeen(T_ref_now, 0, DepthScene::kBoxOnFloor), 0, 4);
    for (const double start_m : {-0.005, 0.0, 0.005}) {
      const auto result = aligner.Align(ref, now, T_ref_now * Rigid3::Translation({start_m, 0, start_m}));
      ASSERT_TRUE(result);
      const Vector6d error = Log(T_ref_now.inverse() * result->T_ref_depth);
      EXPECT_LT(error.tail<5>().norm(), 1e-3) << moved_m << " from " << start_m;
      EXPECT_LT(std::abs(error[0]), std::abs(start_m) + 2e-4) << "two columns of cells on its side may leave this open";
    }
  }
}

TEST(DepthAlignment, StartsFromDecimetresAwayWhereItIsToldToReachSoFar) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3(), 0.004, DepthScene::kRoom, 1));
  const DepthCells now = aligner.Reduce(DepthSeen(Moved(), 0.004, DepthScene::kRoom, 2));
  for (const double side : {-1, 1}) {
    const Rigid3 start = Moved() * Exp(side * (Vector6d() << 0.05, 0.02, 0.15, 0.01, 0.02, 0.02).finished());
    const auto error = [&](DepthAligner::Reach reach) {
      const auto result = aligner.Align(ref, now, start, reach);
      return result ? Log(Moved().inverse() * result->T_ref_depth).norm() : 1;
    };
    EXPECT_LT(error(DepthAligner::Reach::kFar), 3e-3) << side;
    EXPECT_GT(error(DepthAligner::Reach::kNear), 3e-2) << side;
  }
}

TEST(DepthAlignment, LeavesWhatAWallDoesNotShowAtTheStartAndSaysSo) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3(), 0.002, DepthScene::kWall));
  Vector6d xi = Vector6d::Zero();
  xi << 0.02, -0.01, 0.03, 0.01, 0.02, 0.01;
  const DepthCells now = aligner.Reduce(DepthSeen(Exp(xi), 0.002, DepthScene::kWall, 2));
  const auto result = aligner.Align(ref, now, Rigid3());
  ASSERT_TRUE(result);
  EXPECT_NEAR(result->T_ref_depth.translation().z(), Exp(xi).translation().z(), 1e-3);
  EXPECT_LT(result->T_ref_depth.translation().head<2>().norm(), 2e-3);
  EXPECT_LT(std::abs(LogSO3(result->T_ref_depth.rotation()).z()), 2e-3);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(result->information);
  EXPECT_LT(eigen.eigenvalues()(2), 1e-2 * eigen.eigenvalues()(3)) << eigen.eigenvalues().transpose();
}

TEST(DepthAlignment, IsNotPulledByAThingThatMoves) {
  const DepthAligner aligner(DepthSceneCamera());
  cv::Mat1f before = DepthSeen(Rigid3(), 0.003), after = DepthSeen(Moved(), 0.003, DepthScene::kRoom, 2);
  before(cv::Rect(30, 60, 90, 90)).setTo(1.0F);
  after(cv::Rect(60, 70, 90, 90)).setTo(0.95F);
  const auto result = aligner.Align(aligner.Reduce(before), aligner.Reduce(after), Rigid3());
  ASSERT_TRUE(result);
  EXPECT_LT(Log(Moved().inverse() * result->T_ref_depth).norm(), 3e-3);
}

TEST(DepthAlignment, IsEmptyWhereTheImagesHaveNothingInCommon) {
  const DepthAligner aligner(DepthSceneCamera());
  const DepthCells ref = aligner.Reduce(DepthSeen(Rigid3())), nothing = aligner.Reduce(cv::Mat1f(240, 320, 0.0F));
  EXPECT_FALSE(aligner.Align(ref, nothing, Rigid3()));
  EXPECT_FALSE(aligner.Align(nothing, ref, Rigid3()));
  EXPECT_FALSE(aligner.Align(ref, ref, Rigid3::Translation({0, 0, -5})));
  EXPECT_EQ(nothing.median_m, 0);
}

TEST(DepthAlignment, RefusesAnImageOfAnotherSizeAndNamesBoth) {
  try {
    DepthAligner(DepthSceneCamera()).Reduce(cv::Mat1f(100, 200, 1.0F));
    FAIL() << "expected std::invalid_argument";
  } catch (const std::invalid_argument& error) {
    EXPECT_EQ(std::string(error.what()), "depth image of 200x100; expected the depth camera's 320x240");
  }
}

}  // namespace
}  // namespace devo
