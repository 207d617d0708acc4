// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/message_conversion.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/serialization.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::vector<Event> SomeEvents() {
  std::vector<Event> events(3);
  for (std::size_t i = 0; i < events.size(); ++i) {
    events[i].t_ns = 1700000000123456789 + static_cast<std::int64_t>(i) * 1000;
    events[i].x = static_cast<std::uint16_t>(300 + i);
    events[i].y = static_cast<std::uint16_t>(1 + i);
    events[i].polarity = i % 2;
  }
  return events;
}

void ExpectEqual(const std::vector<Event>& a, const std::vector<Event>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].t_ns, b[i].t_ns);
    EXPECT_EQ(a[i].x, b[i].x);
    EXPECT_EQ(a[i].y, b[i].y);
    EXPECT_EQ(a[i].polarity, b[i].polarity);
  }
}

TEST(DropStrayEvents, KeepsWhatLiesTogether) {
  std::vector<Event> events = SomeEvents();
  EXPECT_EQ(DropStrayEvents(10, &events), 0U);
  const std::vector<Event> expected = events;
  events.insert(events.begin(), Event());  // 1970
  Event later = events.back();
  later.t_ns += 11'000'000'000;
  events.push_back(later);
  EXPECT_EQ(DropStrayEvents(10, &events), 2U);
  ASSERT_EQ(events.size(), expected.size());
  EXPECT_EQ(events.front().t_ns, expected.front().t_ns);
  EXPECT_EQ(events.back().t_ns, expected.back().t_ns);
  std::vector<Event> none;
  EXPECT_EQ(DropStrayEvents(10, &none), 0U);
}

TEST(EventArrays, SurviveTheWayThroughAMessageAndItsBytes) {
  const std::vector<Event> events = SomeEvents();
  const EventArray message = ToEventArrayMsg(events, 640, 480, "event_optical");
  EXPECT_EQ(message.header.stamp, message.events.back().ts);
  std::vector<Event> from_message, from_bytes;
  AppendEvents(message, &from_message);
  ExpectEqual(events, from_message);
  const ros::SerializedMessage bytes = ros::serialization::serializeMessage(message);
  // serializeMessage puts the length in front, as it goes over the wire.
  EXPECT_EQ(AppendSerializedEvents(bytes.buf.get() + 4, bytes.num_bytes - 4, &from_bytes), "event_optical");
  ExpectEqual(events, from_bytes);
  EXPECT_THAT([&] { AppendSerializedEvents(bytes.buf.get() + 4, bytes.num_bytes - 5, &from_bytes); },
              ThrowsMessage<std::runtime_error>(HasSubstr("end early")));
}

TEST(EventPackets, ArePutOnTheHostsClockOnceAndAnewAfterARestart) {
  EventPacket packet;
  packet.encoding = "evt2";
  packet.header.stamp = ros::Time(50, 0);
  packet.seq = 7;
  const auto word = [&](std::uint32_t w) {
    for (int i = 0; i < 4; ++i) packet.events.push_back(static_cast<std::uint8_t>(w >> (8 * i)));
  };
  word(0x80000010U);
  word(0x10000000U);
  word(0x10000000U | 5U << 22);
  EventPacketConverter converter;
  std::vector<Event> events;
  converter.Append(packet, &events);
  packet.seq = 8;
  packet.header.stamp = ros::Time(60, 0);  // later arrival does not move the clock
  converter.Append(packet, &events);
  ASSERT_EQ(events.size(), 4U);
  EXPECT_EQ(events[0].t_ns, 50000000000);
  EXPECT_EQ(events[1].t_ns, 50000005000);
  EXPECT_EQ(events[2].t_ns, 50000000000);
  packet.seq = 0;
  converter.Append(packet, &events);
  EXPECT_EQ(events[4].t_ns, 60000000000);
  packet.is_bigendian = true;
  EXPECT_THAT([&] { converter.Append(packet, &events); }, ThrowsMessage<std::runtime_error>(HasSubstr("big-endian")));
  EventPacket unknown;
  unknown.encoding = "mono";
  EXPECT_THAT([&] { EventPacketConverter().Append(unknown, &events); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("'mono'")));
}

TEST(EventPackets, GoOnInTimeAfterAGapInWhichTheSensorsCounterWrapped) {
  constexpr std::int64_t kWrap_us = 1 << 24;
  for (const double gap_s : {1.0, 9.0, 12.0, 16.7, 20.0, 30.0, 100.0}) {
    EventPacketConverter converter;
    std::vector<Event> events;
    for (const double t_s : {10.0, 10.0 + gap_s}) {
      const std::int64_t sensor_us = std::llround(1e6 * t_s) % kWrap_us;
      EventPacket packet;
      packet.encoding = "evt3";
      packet.header.stamp = ros::Time(1000 + t_s + 0.003);  // the host is late by some milliseconds
      for (const std::int64_t word :
           {std::int64_t{0x8000} | sensor_us >> 12, std::int64_t{0x6000} | (sensor_us & 0xFFF), std::int64_t{5},
            std::int64_t{0x2007}}) {
        packet.events.push_back(static_cast<std::uint8_t>(word));
        packet.events.push_back(static_cast<std::uint8_t>(word >> 8));
      }
      converter.Append(packet, &events);
    }
    ASSERT_EQ(events.size(), 2U);
    EXPECT_NEAR(1e-9 * static_cast<double>(events[1].t_ns - events[0].t_ns), gap_s, 1e-5);
  }
}

TEST(EventPackets, HaveNoEventOfATimeBeforePacketsThatAreMissing) {
  constexpr std::int64_t kWrap_us = 1 << 24;
  for (const double gap_s : {0.5, 9.0, 10.0, 12.0, 26.0}) {
    EventPacketConverter converter;
    std::vector<Event> events;
    std::uint64_t seq = 1;
    for (const double t_s : {15.0, 15.0 + gap_s}) {
      const std::int64_t sensor_us = std::llround(1e6 * t_s) % kWrap_us;
      EventPacket packet;
      packet.encoding = "evt3";
      packet.seq = std::exchange(seq, seq + 100);
      packet.header.stamp = ros::Time(1000 + t_s + 0.003);
      // Begins with an event whose time was in a packet before.
      for (const std::int64_t word :
           {std::int64_t{5}, std::int64_t{0x2007}, std::int64_t{0x8000} | sensor_us >> 12,
            std::int64_t{0x6000} | (sensor_us & 0xFFF), std::int64_t{5}, std::int64_t{0x2007}}) {
        packet.events.push_back(static_cast<std::uint8_t>(word));
        packet.events.push_back(static_cast<std::uint8_t>(word >> 8));
      }
      converter.Append(packet, &events);
    }
    ASSERT_EQ(events.size(), 2U) << gap_s;
    EXPECT_NEAR(1e-9 * static_cast<double>(events[1].t_ns - events[0].t_ns), gap_s, 1e-5);
  }
}

template <typename T>
sensor_msgs::Image ImageOf(const std::vector<T>& pixels, const std::string& encoding, std::uint32_t padding = 0) {
  sensor_msgs::Image image;
  image.header.stamp = ros::Time(3, 500);
  image.encoding = encoding;
  image.width = 2;
  image.height = static_cast<std::uint32_t>(pixels.size() / 2);
  image.step = static_cast<std::uint32_t>(2 * sizeof(T)) + padding;
  image.data.resize(image.step * image.height, 0xEE);
  for (std::uint32_t y = 0; y < image.height; ++y) {
    std::memcpy(image.data.data() + y * image.step, pixels.data() + 2 * y, 2 * sizeof(T));
  }
  return image;
}

TEST(DepthImages, InMillimetresAreReadWithPaddedRowsScaleAndOffset) {
  const DepthImage depth = ToDepthImage(ImageOf<std::uint16_t>({1000, 0, 65535, 250}, "16UC1", 6), 1.5, 1000);
  EXPECT_EQ(depth.t_ns, 3000001500);
  EXPECT_FLOAT_EQ(depth.depth_m(0, 0), 1.5F);
  EXPECT_EQ(depth.depth_m(0, 1), 0);
  EXPECT_FLOAT_EQ(depth.depth_m(1, 0), 65.535F * 1.5F);
  EXPECT_FLOAT_EQ(depth.depth_m(1, 1), 0.375F);
}

TEST(DepthImages, InMetresHaveNoMeasurementWhereRep117SaysSo) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const DepthImage depth = ToDepthImage(ImageOf<float>({nan, inf, -inf, 2.5F, -1, 0}, "32FC1"));
  EXPECT_EQ(depth.depth_m(0, 0), 0);
  EXPECT_EQ(depth.depth_m(0, 1), 0);
  EXPECT_EQ(depth.depth_m(1, 0), 0);
  EXPECT_EQ(depth.depth_m(1, 1), 2.5F);
  EXPECT_EQ(depth.depth_m(2, 0), 0);
}

TEST(DepthImages, OfTheOtherEndianAreTurnedAround) {
  sensor_msgs::Image millimetres = ImageOf<std::uint16_t>({0xE803, 0, 0, 0}, "16UC1");  // 1000 with its bytes swapped
  millimetres.is_bigendian = 1;
  EXPECT_FLOAT_EQ(ToDepthImage(millimetres).depth_m(0, 0), 1.0F);
  sensor_msgs::Image metres = ImageOf<float>({1.5F, 0, 0, 0}, "32FC1");
  std::swap(metres.data[0], metres.data[3]);
  std::swap(metres.data[1], metres.data[2]);
  metres.is_bigendian = 1;
  EXPECT_EQ(ToDepthImage(metres).depth_m(0, 0), 1.5F);
}

TEST(DepthImages, ThatDoNotHoldWhatTheySayAreRefused) {
  EXPECT_THAT(
      [] {
        ToDepthImage(ImageOf<std::uint16_t>({1, 2}, "mono16"));
      },
      ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("'mono16'"), HasSubstr("expected 16UC1"))));
  sensor_msgs::Image cut = ImageOf<std::uint16_t>({1, 2, 3, 4}, "16UC1");
  cut.data.pop_back();
  EXPECT_THAT([&] { ToDepthImage(cut); }, ThrowsMessage<std::runtime_error>(HasSubstr("7 bytes")));
  sensor_msgs::Image narrow = ImageOf<float>({1, 2, 3, 4}, "32FC1");
  narrow.step = 4;
  EXPECT_THAT([&] { ToDepthImage(narrow); }, ThrowsMessage<std::runtime_error>(HasSubstr("step 4")));
  EXPECT_THAT([] { ToDepthImage(ImageOf<float>({}, "32FC1")); }, ThrowsMessage<std::runtime_error>(HasSubstr("empty")));
}

sensor_msgs::CameraInfo Info() {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {0.1, -0.2, 0.01, 0.02, 0.05};
  info.K = {520, 0, 319.5, 0, 510, 239.5, 0, 0, 1};
  return info;
}

/// The ray that a full-resolution pixel has must be the ray of the same place in the published image.
void ExpectSameRay(const Camera& published, const Eigen::Vector2d& u, const Eigen::Vector2d& u_full) {
  const auto expected = ToCamera(Info()).Unproject(u_full), ray = published.Unproject(u);
  ASSERT_TRUE(ray && expected);
  EXPECT_LT((*ray - *expected).norm(), 1e-9);
}

TEST(CameraInfos, AreReadWithBinning) {
  sensor_msgs::CameraInfo info = Info();
  info.binning_x = info.binning_y = 2;
  const Camera camera = ToCamera(info);
  EXPECT_EQ(camera.width(), 320);
  EXPECT_EQ(camera.height(), 240);
  // The centre of binned pixel (10, 20) is the corner between full pixels 20, 21 and 40, 41.
  ExpectSameRay(camera, {10, 20}, {20.5, 40.5});
}

TEST(CameraInfos, AreReadWithARegionOfInterest) {
  sensor_msgs::CameraInfo info = Info();
  info.roi.x_offset = 100;
  info.roi.y_offset = 50;
  info.roi.width = 200;
  info.roi.height = 150;
  const Camera camera = ToCamera(info);
  EXPECT_EQ(camera.width(), 200);
  EXPECT_EQ(camera.height(), 150);
  ExpectSameRay(camera, {7, 9}, {107, 59});
  info.roi.do_rectify = true;
  EXPECT_THAT([&] { ToCamera(info); }, ThrowsMessage<std::invalid_argument>(HasSubstr("roi.do_rectify")));
}

TEST(CameraInfos, WithoutCalibrationAreRefused) {
  sensor_msgs::CameraInfo info = Info();
  info.K.fill(0);
  EXPECT_THAT([&] { ToCamera(info); }, ThrowsMessage<std::invalid_argument>(HasSubstr("is the camera calibrated?")));
}

}  // namespace
}  // namespace devo
