// SPDX-License-Identifier: BSD-3-Clause
//
// A real Prophesee recording, EVT 3.0, against the counts that its authors' own decoder gives.
#include <gtest/gtest.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>

#include "devo/ros/bag_file.h"
#include "devo/ros/message_conversion.h"
#include "io/shared_data.h"

namespace devo {
namespace {

TEST(EventPackets, HaveTheMd5OfTheDriversMessage) {
  EXPECT_STREQ(ros::message_traits::MD5Sum<EventPacket>::value(), "8a6101b351a64529ac77bd8b71074e52");
  EXPECT_STREQ(ros::message_traits::MD5Sum<EventArray>::value(), "5e8beee5a6c107e504c2e78903c224b8");
}

TEST(EventPackets, OfARealCameraDecodeToThePublishedCounts) {
  const std::string path = SharedData("event_packet/evt3.bag");
  if (path.empty()) GTEST_SKIP() << MissingSharedData("event_packet/evt3.bag");
  BagFile bag(path);
  ASSERT_EQ(bag.topics().size(), 1U);
  EXPECT_EQ(bag.defect(), "");
  EXPECT_EQ(bag.entries().size(), 517U);
  EvtDecoder decoder("evt3");
  EventPacketConverter converter;
  std::vector<Event> sensor_events, host_events;
  std::int64_t first_stamp_ns = 0;
  for (const BagEntry& entry : bag.entries()) {
    const ByteSpan bytes = bag.Read(entry);
    ros::serialization::IStream stream(const_cast<std::uint8_t*>(bytes.data), static_cast<std::uint32_t>(bytes.size));
    EventPacket packet;
    ros::serialization::deserialize(stream, packet);
    if (first_stamp_ns == 0) first_stamp_ns = static_cast<std::int64_t>(packet.header.stamp.toNSec());
    decoder.Decode(packet.events.data(), packet.events.size(), &sensor_events);
    converter.Append(packet, &host_events);
  }
  EXPECT_EQ(sensor_events.size(), 343474U);
  std::size_t on = 0, outside = 0, falling = 0;
  for (std::size_t i = 0; i < sensor_events.size(); ++i) {
    const Event& event = sensor_events[i];
    on += event.polarity;
    outside += event.x >= 640 || event.y >= 480;
    falling += i > 0 && event.t_ns < sensor_events[i - 1].t_ns;
  }
  EXPECT_EQ(on, 125183U);
  EXPECT_EQ(outside, 0U);
  EXPECT_EQ(falling, 0U);
  EXPECT_EQ(sensor_events.front().t_ns, 7139845000);
  EXPECT_EQ(decoder.triggers(), 4157U);
  EXPECT_EQ(host_events.front().t_ns, first_stamp_ns);
  EXPECT_EQ(host_events.back().t_ns - host_events.front().t_ns, sensor_events.back().t_ns - sensor_events.front().t_ns);
}

}  // namespace
}  // namespace devo
