// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/rest_detector.h"

#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kStep_ns = 10'000'000;
using Eigen::Vector3d;

/// What an inertial sensor with a bias reads in a camera that turns by so much about x.
InertialMean Reading(double turn_rad_s = 0, double push_m_s2 = 0) {
  return {Vector3d(turn_rad_s + 0.04, -0.02, 0), Vector3d(push_m_s2, -9.7, 1.2), Vector3d::Zero()};
}

/// At rest from 1 s to 1.4 s.
RestDetector Rested() {
  RestDetector detector;
  detector.Start(100 * kStep_ns);
  for (int k = 101; k <= 140; ++k) detector.Note(k * kStep_ns, true, Reading());
  return detector;
}

TEST(RestDetector, KnowsARestOfFewEventsAndSteadyReadingsUntilAMomentBefore) {
  const auto rest = Rested().last_rest();
  ASSERT_TRUE(rest);
  EXPECT_EQ(rest->begin_ns, 100 * kStep_ns);
  EXPECT_EQ(rest->end_ns, 130 * kStep_ns);
}

TEST(RestDetector, StillKnowsItWhenTheCameraHasMovedOn) {
  RestDetector detector = Rested();
  for (int k = 141; k <= 200; ++k) detector.Note(k * kStep_ns, false, Reading(0.01 * (k - 140), 1));
  const auto rest = detector.last_rest();
  ASSERT_TRUE(rest);
  EXPECT_EQ(rest->end_ns, 130 * kStep_ns);
}

TEST(RestDetector, NeedsBothFewEventsAndSteadyReadings) {
  RestDetector busy, turning, pushed, blind, no_accelerometer;
  for (RestDetector* detector : {&busy, &turning, &pushed, &blind, &no_accelerometer}) detector->Start(0);
  for (int k = 1; k <= 100; ++k) {
    busy.Note(k * kStep_ns, false, Reading());
    turning.Note(k * kStep_ns, true, Reading(0.005 * k));
    pushed.Note(k * kStep_ns, true, Reading(0, 0.05 * k));
    blind.Note(k * kStep_ns, true, std::nullopt);
    no_accelerometer.Note(k * kStep_ns, true, InertialMean{Vector3d::Zero(), std::nullopt, Vector3d::Zero()});
  }
  for (const RestDetector* detector : {&busy, &turning, &pushed, &blind, &no_accelerometer}) {
    EXPECT_FALSE(detector->last_rest());
  }
}

/// Adds a second of readings from 2 s on that scatter by so much about those of a turn.
void AddScattering(double scatter_rad_s, double scatter_m_s2, double turn_rad_s, RestDetector* detector) {
  detector->Note(200 * kStep_ns, false, Reading(0.5, 1));
  for (int k = 201; k <= 300; ++k) {
    const int sign = k % 2 == 0 ? 1 : -1;
    detector->Note(k * kStep_ns, true, Reading(turn_rad_s + sign * scatter_rad_s, sign * scatter_m_s2));
  }
}

TEST(RestDetector, TellsASlowMotionInTheDarkFromARestByTheirScatter) {
  RestDetector detector = Rested();
  AddScattering(0.001, 0.1, 0.02, &detector);
  ASSERT_TRUE(detector.last_rest());
  EXPECT_EQ(detector.last_rest()->end_ns, 130 * kStep_ns);
}

TEST(RestDetector, TakesAnotherRestWithTheNoiseOfAGoodSensorAndMeasuresIt) {
  RestDetector detector = Rested();  // without noise
  AddScattering(0.001, 0.02, 0, &detector);
  ASSERT_TRUE(detector.last_rest());
  EXPECT_EQ(detector.last_rest()->end_ns, 290 * kStep_ns);
  // All of it along one of three axes.
  EXPECT_NEAR(detector.last_rest()->scatter.turn_rad_s, 0.001 / std::sqrt(3.0), 2e-5);
  EXPECT_NEAR(detector.last_rest()->scatter.force_m_s2, 0.02 / std::sqrt(3.0), 4e-4);
}

TEST(RestDetector, BeginsAnewAfterAMotionAndWhenItIsCleared) {
  RestDetector detector = Rested();
  detector.Note(141 * kStep_ns, false, Reading());
  for (int k = 142; k <= 180; ++k) detector.Note(k * kStep_ns, true, Reading());
  EXPECT_EQ(detector.last_rest()->begin_ns, 141 * kStep_ns);
  detector.Clear();
  EXPECT_FALSE(detector.started());
  EXPECT_FALSE(detector.last_rest());
}

}  // namespace
}  // namespace devo
