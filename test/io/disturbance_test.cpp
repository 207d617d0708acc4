// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/disturbance.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

/// One second of events, one each 10 us, at one pixel.
std::vector<Event> OneSecond() {
  std::vector<Event> events(100000);
  for (std::size_t i = 0; i < events.size(); ++i)
    events[i] = {5000000000LL + 10000LL * static_cast<std::int64_t>(i), 3, 2, 1};
  return events;
}

std::vector<Event> Disturbed(const std::string& text) {
  DisturbanceOptions options;
  options.Add(text);
  Disturbance disturbance(options, 100, 80);
  const std::vector<Event> events = OneSecond();
  std::vector<Event> out;
  for (std::size_t i = 0; i < events.size(); i += 1000) {
    const EventSpan left = disturbance.Apply({events.data() + i, 1000});
    out.insert(out.end(), left.begin(), left.end());
  }
  return out;
}

TEST(Disturbance, LosesTheAskedShareOfTheEvents) { EXPECT_NEAR(Disturbed("event_loss=0.3").size(), 70000, 700); }

TEST(Disturbance, LeavesNoEventInAGapAndAllOthers) {
  const auto events = Disturbed("event_gap=0.2:0.5");
  EXPECT_EQ(events.size(), 70000U);
  for (const Event& event : events) {
    const double t_s = 1e-9 * static_cast<double>(event.t_ns - 5000000000LL);
    EXPECT_TRUE(t_s < 0.2 || t_s >= 0.5) << t_s;
  }
}

TEST(Disturbance, ShakesAnInertialSensorByTheAskedNoise) {
  DisturbanceOptions options;
  options.Add("imu_noise=2:0.5");
  EXPECT_TRUE(options.any());
  Disturbance disturbance(options, 100, 80);
  const Eigen::Vector3d turn(1, 2, 3), force(0, 0, 9.8);
  Eigen::Vector3d turn_square = Eigen::Vector3d::Zero(), force_square = Eigen::Vector3d::Zero();
  const int count = 4000;
  for (int k = 0; k < count; ++k) {
    const ImuSample read = disturbance.Apply(ImuSample{k, turn, force, {0.1, 0, 0}});
    EXPECT_EQ(read.t_ns, k);
    turn_square += (read.angular_velocity - turn).cwiseAbs2() / count;
    force_square += (read.linear_acceleration - force).cwiseAbs2() / count;
  }
  const double sigma_rad_s = 2 * M_PI / 180;
  EXPECT_LT((turn_square / (sigma_rad_s * sigma_rad_s) - Eigen::Vector3d::Ones()).norm(), 0.15);
  EXPECT_LT((force_square / 0.25 - Eigen::Vector3d::Ones()).norm(), 0.15);
}

TEST(Disturbance, AddsHotPixelsInTheOrderOfTime) {
  const auto events = Disturbed("hot_pixels=0.01");
  std::set<std::pair<int, int>> pixels;
  std::size_t hot = 0;
  for (const Event& event : events) {
    if (event.x == 3 && event.y == 2) continue;
    ++hot;
    pixels.insert({event.x, event.y});
    EXPECT_LT(event.x, 100);
    EXPECT_LT(event.y, 80);
  }
  EXPECT_NEAR(pixels.size(), 80, 30);  // 1 % of 8000
  EXPECT_NEAR(hot, 100.0 * pixels.size(), 400);
  EXPECT_TRUE(std::is_sorted(events.begin(), events.end(), IsEarlier));
}

TEST(Disturbance, AddsTheEventsOfLampsInTheOrderOfTimeAndNoneInAGap) {
  DisturbanceOptions options;
  for (const char* text : {"flicker=0.5", "light=0.3:2", "event_gap=0.6:0.8"}) options.Add(text);
  EXPECT_TRUE(options.any());
  Disturbance disturbance(options, 100, 80);
  const std::vector<Event> own = OneSecond();
  const EventSpan left = disturbance.Apply(own);
  EXPECT_GT(left.size, 0.8 * own.size() + 0.5 * 8000 * 200 * 0.8 * 0.8);
  EXPECT_TRUE(std::is_sorted(left.begin(), left.end(), IsEarlier));
  EXPECT_TRUE(std::none_of(left.begin(), left.end(),
                           [](const Event& event) { return event.t_ns >= 5600000000LL && event.t_ns < 5800000000LL; }));
}

TEST(Disturbance, LosesTheDepthOfAGapCountedFromTheFirstEvent) {
  DisturbanceOptions options;
  options.Add("depth_gap=1:4");
  Disturbance disturbance(options, 100, 80);
  EXPECT_FALSE(disturbance.LosesDepth(0));
  const std::vector<Event> events = OneSecond();
  disturbance.Apply(events);
  EXPECT_FALSE(disturbance.LosesDepth(5999000000LL));
  EXPECT_TRUE(disturbance.LosesDepth(6000000000LL));
  EXPECT_TRUE(disturbance.LosesDepth(8999000000LL));
  EXPECT_FALSE(disturbance.LosesDepth(9000000000LL));
}

TEST(Disturbance, RefusesWhatItDoesNotKnow) {
  DisturbanceOptions options;
  EXPECT_THAT([&] { options.Add("rain=0.3"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("rain=0.3")));
  EXPECT_THAT([&] { options.Add("event_loss=2"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("from 0 to 1")));
  EXPECT_THAT([&] { options.Add("event_gap=2:1"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("FROM below TO")));
  EXPECT_THAT([&] { options.Add("imu_noise=2"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("DEG_S:M_S2")));
  EXPECT_THAT([&] { options.Add("depth_gap=2"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("FROM:TO")));
  EXPECT_THAT([&] { options.Add("flicker=-1"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("from 0 to 1")));
  EXPECT_THAT([&] { options.Add("light=2:0"); }, ThrowsMessage<std::invalid_argument>(HasSubstr("AT:FACTOR")));
  EXPECT_FALSE(options.any());
}

}  // namespace
}  // namespace devo
