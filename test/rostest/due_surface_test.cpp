// SPDX-License-Identifier: BSD-3-Clause
//
// When the nodelet renders a surface: with the message that completes its events, not later.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nodelet/loader.h>
#include <ros/ros.h>

#include <memory>
#include <vector>

#include <boost/make_shared.hpp>

#include "devo/EventArray.h"
#include "devo/ros/core_messages.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 10'000'000, kBegin_ns = 1'000'000'000;

/// A hundred events of a 32x24 image; the last one comes `gap_ns` before the end of period `step`.
EventArrayPtr EventsOf(int step, std::int64_t gap_ns) {
  auto message = boost::make_shared<EventArray>();
  message->width = 32;
  message->height = 24;
  for (int i = 0; i < 100; ++i) {
    RawEvent event;
    event.x = static_cast<std::uint16_t>((step + i / 10) % 32);
    event.y = static_cast<std::uint16_t>(i % 24);
    event.ts.fromNSec(static_cast<std::uint64_t>(kBegin_ns + kPeriod_ns * (step + 1) - gap_ns - 50'000 * (99 - i)));
    event.polarity = 1;
    message->events.push_back(event);
  }
  return message;
}

class DueSurface : public testing::Test {
 protected:
  DueSurface() {
    ros::param::set("/due_surface/config", ros::param::param<std::string>("~config", ""));
    ros::param::set("/due_surface/max_queued_kevents", 10);
    ros::param::set("/due_surface/max_backlog_s", 10.0);
    loaded_ = loader_.load("/due_surface", "devo/TimeSurface", {}, {});
    subscriber_ = nh_.subscribe<Surface>(topics::kSurface, 2000,
                                         boost::function<void(const boost::shared_ptr<const Surface>&)>(
                                             [this](const boost::shared_ptr<const Surface>& surface) {
                                               surface_times_ns_.push_back(surface->t_ns);
                                               event_rates_hz_.push_back(surface->event_rate_hz);
                                             }));
    publisher_ = nh_.advertise<EventArray>("/events", 2000);
    SpinUntil([&] { return publisher_.getNumSubscribers() > 0 && subscriber_.getNumPublishers() > 0; }, 10);
  }
  ~DueSurface() override { loader_.clear(); }

  template <typename Condition>
  bool SpinUntil(const Condition& done, double timeout_s) {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(timeout_s);
    while (!done() && ros::WallTime::now() < end) {
      ros::spinOnce();
      ros::WallDuration(0.002).sleep();
    }
    return done();
  }

  /// The camera's size is known a moment after the start; events before are dropped.
  int StepAfterStart(std::int64_t gap_ns) {
    for (int step = 0; step < 100; ++step) {
      publisher_.publish(EventsOf(step, gap_ns));
      if (SpinUntil([&] { return !surface_times_ns_.empty(); }, 0.2)) return step + 1;
    }
    return -1;
  }

  ros::NodeHandle nh_;
  nodelet::Loader loader_{false};
  bool loaded_ = false;
  ros::Subscriber subscriber_;
  ros::Publisher publisher_;
  std::vector<std::int64_t> surface_times_ns_;
  std::vector<double> event_rates_hz_;
};

TEST_F(DueSurface, ComesWithTheMessageThatEndsJustBeforeItsTime) {
  ASSERT_TRUE(loaded_);
  const int step = StepAfterStart(20'000);
  ASSERT_GT(step, 0);
  for (int next = step; next < step + 5; ++next) {
    publisher_.publish(EventsOf(next, 20'000));
    const std::int64_t end_ns = kBegin_ns + kPeriod_ns * (next + 1);
    ASSERT_TRUE(SpinUntil([&] { return surface_times_ns_.back() == end_ns; }, 3)) << "period " << next;
  }
}

TEST_F(DueSurface, OutOfAFullQueueTheOldestMessagesGoAndTheNewestStays) {
  ASSERT_TRUE(loaded_);
  const int step = StepAfterStart(20'000);
  ASSERT_GT(step, 0);
  surface_times_ns_.clear();
  event_rates_hz_.clear();
  // Without tracking, each of the first surfaces waits for the pose of the one before; the queue holds 100 messages.
  constexpr int kMessages = 1000;
  for (int next = step; next < step + kMessages; ++next) publisher_.publish(EventsOf(next, 20'000));
  const std::int64_t end_ns = kBegin_ns + kPeriod_ns * (step + kMessages);
  ASSERT_TRUE(SpinUntil([&] { return !surface_times_ns_.empty() && surface_times_ns_.back() == end_ns; }, 20));
  EXPECT_THAT(surface_times_ns_.size(), testing::AllOf(testing::Ge(50U), testing::Lt(kMessages)));
  EXPECT_THAT(event_rates_hz_, testing::Each(testing::Ge(5e3)));  // 10 kHz: a loss is no silence
}

TEST_F(DueSurface, WaitsForTheNextMessageWhenMoreEventsMayCome) {
  ASSERT_TRUE(loaded_);
  const int step = StepAfterStart(1'000'000);
  ASSERT_GT(step, 0);
  publisher_.publish(EventsOf(step, 1'000'000));
  const std::int64_t end_ns = kBegin_ns + kPeriod_ns * (step + 1);
  EXPECT_FALSE(SpinUntil([&] { return surface_times_ns_.back() == end_ns; }, 0.5));
  publisher_.publish(EventsOf(step + 1, 1'000'000));
  EXPECT_TRUE(SpinUntil([&] { return surface_times_ns_.back() == end_ns; }, 3));
}

}  // namespace
}  // namespace devo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "due_surface_test");
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
