// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/evaluation.h"

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/shared_data.h"
#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

constexpr double kDegreesPerRadian = 57.29577951308232;

Rigid3 TruthAt(double t) {
  return {ExpSO3({0.2 * std::sin(t), 0.3 * t, 0.1 * std::cos(2 * t)}),
          {std::sin(t), 0.5 * std::cos(3 * t), 0.2 * t * t}};
}

template <typename PoseOfTime>
Trajectory Sample(double begin_s, double end_s, double step_s, PoseOfTime&& pose) {
  Trajectory trajectory;
  for (int i = 0; begin_s + i * step_s <= end_s + 1e-9; ++i) {
    const double t = begin_s + i * step_s;
    trajectory.push_back({std::llround(1e9 * t), pose(t)});
  }
  return trajectory;
}

TEST(Evaluation, FindsNoErrorInARigidlyMovedTruth) {
  const Rigid3 T_other_world(ExpSO3({1, -2, 0.5}), {3, 4, 5});
  const Trajectory truth = Sample(0, 4, 0.005, TruthAt);
  const Trajectory moved = Sample(0, 4, 0.01, [&](double t) { return T_other_world * TruthAt(t); });
  const Evaluation e = Evaluate(truth, moved);
  EXPECT_EQ(e.pairs, moved.size());
  EXPECT_LT(e.ate_rmse_m, 1e-9);
  EXPECT_LT(e.rpe_rotation_rmse_deg, 1e-6);
  EXPECT_LT(e.rpe_translation_rmse_cm, 1e-7);
  EXPECT_NEAR(e.coverage, 1, 1e-9);
  EXPECT_LT((e.T_truth_estimate.matrix() - T_other_world.inverse().matrix()).norm(), 1e-9);
}

TEST(Evaluation, FindsCovariancesHonestThatTheErrorsWereDrawnFrom) {
  const Trajectory truth = Sample(0, 40, 0.01, TruthAt);
  Vector6d sigma;
  sigma << 0.002, 0.001, 0.003, 0.001, 0.002, 0.001;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  Trajectory estimate = truth;
  for (StampedPose& pose : estimate) {
    Vector6d xi;
    for (int k = 0; k < 6; ++k) xi[k] = sigma[k] * normal(random);
    pose.T_world_body = pose.T_world_body * Exp(xi);
  }
  const Matrix6d C = sigma.cwiseAbs2().asDiagonal();
  EXPECT_NEAR(Evaluate(truth, estimate, {}, std::vector<Matrix6d>(estimate.size(), C)).nees, 1, 0.05);
  EXPECT_NEAR(Evaluate(truth, estimate, {}, std::vector<Matrix6d>(estimate.size(), 4 * C)).nees, 0.25, 0.02);
  EXPECT_THAT([&] { Evaluate(truth, estimate, {}, {C}); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("one for each")));
}

TEST(Evaluation, MeasuresTheDriftWithinAStandstillOnly) {
  const auto stops = [](double t) { return Rigid3::Translation({std::min(t, 1.0) + std::max(t - 3, 0.0), 0, 0}); };
  const auto creeps = [&](double t) { return stops(t) * Rigid3::Translation({0, 0.001 * t, 0}); };
  const Evaluation e = Evaluate(Sample(0, 4, 0.01, stops), Sample(0, 4, 0.01, creeps));
  EXPECT_NEAR(e.still_s, 2, 0.03);
  EXPECT_NEAR(e.still_drift_m, 0.002, 3e-5);
  EXPECT_NEAR(e.still_drift_deg, 0, 1e-9);
}

TEST(Evaluation, CountsScaleAsError) {
  const auto line = [](double t) { return Rigid3::Translation({t, 0, 0}); };
  const auto longer = [](double t) { return Rigid3::Translation({1.1 * t, 0, 0}); };
  const Evaluation e = Evaluate(Sample(0, 2, 0.01, line), Sample(0, 2, 0.01, longer));
  // Errors are 0.1 (t - 1), uniform over [-0.1, 0.1]: RMSE 0.1 / sqrt(3).
  EXPECT_NEAR(e.ate_rmse_m, 0.1 / std::sqrt(3.0), 5e-4);
  EXPECT_NEAR(e.path_length_m, 2, 1e-9);
  ASSERT_TRUE(e.drift_percent);
  EXPECT_NEAR(*e.drift_percent, 100 * e.ate_rmse_m / 2, 1e-9);
  EXPECT_EQ(DriftText(e, 1), "2.9 % of 2.0 m");
  EXPECT_NEAR(e.rpe_translation_rmse_cm, 10, 1e-6);
}

TEST(Evaluation, MeasuresAConstantDriftAsItsRelativeErrorPerInterval) {
  const double rate_rad_s = 0.02;
  const auto drifting = [&](double t) { return Rigid3::Rotation(ExpSO3({0, 0, rate_rad_s * t})); };
  const auto still = [](double) { return Rigid3(); };
  EvaluationOptions options;
  options.rpe_interval_s = 0.5;
  const Evaluation e = Evaluate(Sample(0, 3, 0.01, still), Sample(0, 3, 0.01, drifting), options);
  EXPECT_NEAR(e.rpe_rotation_rmse_deg, rate_rad_s * 0.5 * kDegreesPerRadian, 1e-6);
  EXPECT_NEAR(e.final_rotation_deg, rate_rad_s * 3 * kDegreesPerRadian, 1e-6);
}

TEST(Evaluation, TakesTheRelativeErrorInTheOrderOfThePaper) {
  // (Q_i^-1 Q_j)^-1 (P_i^-1 P_j): the true motion is a turn by 90 deg about z, the estimate adds a step of 1 along its
  // x.
  const Trajectory truth = {
      {0, Rigid3()}, {500000000, Rigid3()}, {1000000000, Rigid3::Rotation(ExpSO3({0, 0, M_PI / 2}))}};
  Trajectory estimate = truth;
  estimate[2].T_world_body = Rigid3(ExpSO3({0, 0, M_PI / 2}), {1, 0, 0});
  EvaluationOptions options;
  options.max_gap_s = 1;
  options.rpe_interval_s = 1;
  const Evaluation e = Evaluate(truth, estimate, options);
  EXPECT_NEAR(e.final_translation_m, 1, 1e-12);
  EXPECT_NEAR(e.final_rotation_deg, 0, 1e-9);
}

TEST(Evaluation, LeavesOutPosesInGapsOfTheTruth) {
  Trajectory truth = Sample(0, 1, 0.01, TruthAt);
  const Trajectory later = Sample(1.5, 2, 0.01, TruthAt);
  truth.insert(truth.end(), later.begin(), later.end());
  const Trajectory estimate = Sample(0, 2, 0.01, TruthAt);
  const Evaluation e = Evaluate(truth, estimate);
  EXPECT_EQ(e.pairs, 152U);
  EXPECT_NEAR(e.coverage, 0.75, 0.01);
}

TEST(Evaluation, NamesBothSpansWhenTheyDoNotMeet) {
  const Trajectory truth = Sample(0, 1, 0.1, TruthAt), estimate = Sample(5, 6, 0.1, TruthAt);
  EXPECT_THAT([&] { Evaluate(truth, estimate); },
              ThrowsMessage<std::runtime_error>(HasSubstr("ground truth has 11 poses from 0.000 s to 1.000 s")));
  EXPECT_THAT([&] { Evaluate(truth, {}); }, ThrowsMessage<std::runtime_error>(HasSubstr("estimate is empty")));
}

TEST(Evaluation, SaysNothingOfTheRelativeErrorOfARecordingShorterThanTheInterval) {
  const Evaluation e = Evaluate(Sample(0, 0.5, 0.01, TruthAt), Sample(0, 0.5, 0.01, TruthAt));
  EXPECT_EQ(e.rpe_pairs, 0U);
  EXPECT_THAT(ToJson(e), HasSubstr("\"rpe_rotation_rmse_deg\": null"));
}

TEST(Evaluation, GivesNoShareOfAPathThatIsNone) {
  const auto turns = [](double t) { return Rigid3::Rotation(ExpSO3({0, 0, t})); };
  const auto wavers = [&](double t) { return turns(t) * Rigid3::Translation({0.01 * std::sin(9 * t), 0, 0}); };
  const Evaluation e = Evaluate(Sample(0, 2, 0.01, turns), Sample(0, 2, 0.01, wavers));
  EXPECT_GT(e.ate_rmse_m, 0.001);
  EXPECT_FALSE(e.drift_percent);
  EXPECT_THAT(ToJson(e), HasSubstr("\"drift_percent\": null"));
  EXPECT_EQ(DriftText(e, 2), "a path of 0.00 m");
}

TEST(Evaluation, DoesNotCallARelativeErrorZeroThatWasNeverMeasured) {
  Evaluation e;
  EXPECT_THAT(RpeText(e), HasSubstr("no RPE"));
  e.rpe_pairs = 1;
  e.rpe_rotation_rmse_deg = 0.25;
  EXPECT_EQ(RpeText(e), "RPE over 1 s 0.25 deg 0.00 cm");
}

TEST(AlignPoints, NeverReflects) {
  Eigen::Matrix3Xd points(3, 4), mirrored(3, 4);
  points << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  mirrored = points;
  mirrored.row(2) *= -1;
  EXPECT_NEAR(AlignPoints(points, mirrored).rotation().toRotationMatrix().determinant(), 1, 1e-9);
}

TEST(Evaluation, AgreesWithOtherToolsOnAPublishedTrajectory) {
  const std::string truth = SharedData("trajectories/freiburg1_xyz-groundtruth.txt");
  if (truth.empty()) GTEST_SKIP() << MissingSharedData("trajectories/freiburg1_xyz-groundtruth.txt");
  const Evaluation e = Evaluate(ReadTum(truth), ReadTum(SharedData("trajectories/freiburg1_xyz-rgbdslam.txt")));
  // evo 0.013470 m (785 pairs), TUM 0.013473 m, RPE 0.934 deg and 2.15 cm; they take the nearest pose of the truth.
  EXPECT_EQ(e.pairs, 785U);
  EXPECT_NEAR(e.ate_rmse_m, 0.01347, 2e-5);
  EXPECT_NEAR(e.rpe_rotation_rmse_deg, 0.934, 0.01);
  EXPECT_NEAR(e.rpe_translation_rmse_cm, 2.15, 0.02);
}

}  // namespace
}  // namespace devo
