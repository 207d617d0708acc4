// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/sensor_delays.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

void ExpectDelays(const SensorDelays& delays, double event_s, double depth_s, double inertial_s) {
  EXPECT_NEAR(delays.event_s, event_s, 1e-12);
  EXPECT_NEAR(delays.depth_s, depth_s, 1e-12);
  EXPECT_NEAR(delays.inertial_s, inertial_s, 1e-12);
}

TEST(SensorDelays, AreOfTheEventsWhereTheOthersAgree) { ExpectDelays(DelaysOf(0.005, 0.005), 0.005, 0, 0); }

TEST(SensorDelays, AreOfTheInertialSensorWhereDepthComesWhenEventsDo) {
  ExpectDelays(DelaysOf(0.01, 0), 0, 0, 0.01);
  ExpectDelays(DelaysOf(0.01, 0.001), 0.001, 0, 0.009);
}

TEST(SensorDelays, AreOfDepthWhereTheOthersAgree) {
  ExpectDelays(DelaysOf(0, 0.02), 0, 0.02, 0);
  ExpectDelays(DelaysOf(0.002, 0.02), 0.002, 0.018, 0);
  ExpectDelays(DelaysOf(0, -0.02), 0, -0.02, 0);
}

TEST(SensorDelays, AreNeverOfEventsThatAreEarly) {
  ExpectDelays(DelaysOf(-0.01, -0.01), 0, -0.01, -0.01);
  ExpectDelays(DelaysOf(-0.01, 0.003), 0, 0.003, -0.01);
}

}  // namespace
}  // namespace devo
