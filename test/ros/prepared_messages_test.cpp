// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/prepared_messages.h"

#include <gtest/gtest.h>

#include "devo/ros/conversions.h"

namespace devo {
namespace {

TEST(PreparedMessages, AreThoseOfTheSequenceWithLaterStamps) {
  sim::SequenceOptions options;
  options.sensor = "davis240";
  options.duration_s = 0.15;
  options.rest_s = 0;
  options.start_s = 999.95;  // so that events lie on both sides of a full second
  options.lidar = true;
  options.depth = sim::SequenceOptions::Depth::kRegistered;
  sim::Sequence sequence(options);
  PreparedMessages prepared(sequence.rig());
  std::vector<SensorMessages> direct;
  for (sim::Chunk chunk; sequence.Next(&chunk);) {
    prepared.Add(chunk);
    direct.push_back(ToMessages(chunk, sequence.rig()));
  }
  ASSERT_EQ(prepared.chunks(), direct.size());
  constexpr std::int64_t kLater_ns = 7'300'000'000;
  const auto later = [](const ros::Time& t) { return ToRosTime(FromRosTime(t) + kLater_ns); };
  std::size_t events = 0, images = 0, scans = 0;
  for (std::size_t i = 0; i < direct.size(); ++i) {
    const SensorMessages moved = prepared.At(i, kLater_ns);
    EXPECT_EQ(moved.begin_ns, direct[i].begin_ns + kLater_ns);
    ASSERT_EQ(moved.event_count(), direct[i].event_count());
    for (std::size_t k = 0; k < moved.event_count(); ++k) {
      const auto &a = moved.events->events[k], &b = direct[i].events->events[k];
      ASSERT_TRUE(a.x == b.x && a.y == b.y && a.polarity == b.polarity && a.ts == later(b.ts)) << i << ' ' << k;
    }
    ASSERT_EQ(moved.depth.size(), direct[i].depth.size());
    for (std::size_t k = 0; k < moved.depth.size(); ++k) {
      EXPECT_EQ(moved.depth[k]->data, direct[i].depth[k]->data);
      EXPECT_EQ(moved.depth[k]->header.stamp, later(direct[i].depth[k]->header.stamp));
    }
    ASSERT_EQ(moved.truth.size(), direct[i].truth.size());
    for (std::size_t k = 0; k < moved.truth.size(); ++k)
      EXPECT_EQ(moved.truth[k]->header.stamp, later(direct[i].truth[k]->header.stamp));
    EXPECT_EQ(moved.imu.size(), direct[i].imu.size());
    events += moved.event_count();
    images += moved.frames.size();
    scans += moved.scans.size();
  }
  EXPECT_EQ(events, prepared.events());
  EXPECT_GT(events, 1000U);
  EXPECT_GT(images, 0U);
  EXPECT_GT(scans, 0U);
}

}  // namespace
}  // namespace devo
