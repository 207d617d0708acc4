// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_errors.h"

#include <optional>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "depth_scene.h"

namespace devo {
namespace {

constexpr double kSigma_m = 0.002;

/// Of a camera that moves by a few centimetres, its images with this much noise, and bent by as much as said from one
/// tenth of their width to the next, as a stereo matcher's are.
std::optional<DepthAligner::Residuals> ResidualsWith(double noise_m, double bent_m, unsigned seed,
                                                     DepthScene scene = DepthScene::kFurnishedRoom) {
  static const DepthAligner aligner(DepthSceneCamera());
  const Rigid3 T = Exp((Vector6d() << 0.04, -0.03, 0.06, 0.02, -0.03, 0.015).finished());
  cv::RNG random(seed + 1);
  const auto seen = [&](const Rigid3& T_world_depth, unsigned of_image) {
    cv::Mat1f depth_m = DepthSeen(T_world_depth, noise_m, scene, of_image), coarse(8, 10), bent;
    random.fill(coarse, cv::RNG::NORMAL, 0, bent_m);
    cv::resize(coarse, bent, depth_m.size(), 0, 0, cv::INTER_CUBIC);
    cv::add(depth_m, bent, depth_m, depth_m > 0);
    return aligner.Reduce(depth_m);
  };
  const DepthCells ref = seen(Rigid3(), 2 * seed), now = seen(T, 2 * seed + 1);
  const auto aligned = aligner.Align(ref, now, T);
  return aligned ? aligner.ResidualsOf(ref, now, *aligned) : std::nullopt;
}

DepthErrors Learnt(double noise_m, double bent_m) {
  DepthErrors errors;
  for (unsigned k = 0; k < 12; ++k) errors.Note(ResidualsWith(noise_m, bent_m, k).value());
  return errors;
}

TEST(DepthErrors, NoiseIsLittleMoreInPatchesThanInCells) {
  double of_cells = 0, of_patches = 0;
  for (unsigned seed = 0; seed < 8; ++seed) {
    const auto residuals = ResidualsWith(kSigma_m, 0, seed);
    ASSERT_TRUE(residuals);
    of_cells += residuals->of_cells / 8;
    of_patches += residuals->of_patches / 8;
  }
  EXPECT_NEAR(of_patches / of_cells, 1.3, 0.3) << "neighbours may meet the same cell of the reference";
  EXPECT_LT(of_cells, 1) << "outliers aside, cells err by less than their spread says";
}

TEST(DepthErrors, AlignmentsOfNoisyImagesErrByWhatTheirPatchesSay) {
  const DepthAligner aligner(DepthSceneCamera());
  double of_patches = 0, true_squares = 0;
  constexpr unsigned kImages = 24;
  for (unsigned seed = 0; seed < kImages; ++seed) {
    const auto seen = [&aligner](unsigned of_image) {
      return aligner.Reduce(DepthSeen(Rigid3(), kSigma_m, DepthScene::kFurnishedRoom, of_image));
    };
    const DepthCells ref = seen(2 * seed), now = seen(2 * seed + 1);
    const auto aligned = aligner.Align(ref, now, Rigid3());
    ASSERT_TRUE(aligned);
    const Vector6d error = Log(aligned->T_ref_depth);
    true_squares += error.dot(aligned->information * error) / 6 / kImages;
    of_patches += aligner.ResidualsOf(ref, now, *aligned).value().of_patches / kImages;
  }
  EXPECT_GT(true_squares, 0.5 * of_patches);
  EXPECT_LT(true_squares, 2 * of_patches);
}

TEST(DepthErrors, WhatIsAlikeInAPatchIsMoreInPatchesThanInCells) {
  const auto residuals = ResidualsWith(kSigma_m, 2 * kSigma_m, 1);
  ASSERT_TRUE(residuals);
  EXPECT_GT(residuals->of_patches, 4 * residuals->of_cells);
}

TEST(DepthErrors, AViewOfWhichLittleIsComparedTellsNothing) {
  EXPECT_FALSE(ResidualsWith(kSigma_m, 0, 1, DepthScene::kBoxOnFloor));
}

TEST(DepthErrors, OfANoisyCameraFewCellsAreAMeasurementAndTheNextImagesShareLittle) {
  const DepthErrors usual, noisy = Learnt(kSigma_m, 0);
  EXPECT_NEAR(usual.CellsPerMeasurement(), 10, 1e-9);
  EXPECT_LT(noisy.CellsPerMeasurement(), 0.5 * usual.CellsPerMeasurement());
  EXPECT_LT(noisy.SharedShare(), 0.5);
  EXPECT_LT(noisy.BiasShare(), usual.BiasShare());
}

TEST(DepthErrors, OfACameraThatErrsAlikeManyCellsAreAMeasurementAndTheNextImagesShareMost) {
  const DepthErrors usual, bent = Learnt(kSigma_m, 2 * kSigma_m);
  EXPECT_GT(bent.CellsPerMeasurement(), 2 * usual.CellsPerMeasurement());
  EXPECT_GT(bent.SharedShare(), 0.7);
  EXPECT_GT(bent.BiasShare(), 2 * usual.BiasShare());
}

TEST(DepthErrors, OfACameraThatIsPerfectMuchIsBelievedButNotAll) {
  DepthErrors errors;
  for (int k = 0; k < 100; ++k) errors.Note({0, 0, 1e-4});
  EXPECT_GT(errors.CellsPerMeasurement(), 0.5);
  EXPECT_LT(errors.CellsPerMeasurement(), 1);
  EXPECT_GE(errors.BiasShare(), 5e-5);
  EXPECT_GE(errors.SharedShare(), 0);
}

}  // namespace
}  // namespace devo
