// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/evt_decoder.h"

#include <cstdint>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

template <typename Word>
std::vector<Event> Decode(EvtDecoder* decoder, const std::vector<Word>& words) {
  std::vector<std::uint8_t> bytes;
  for (const Word word : words) {
    for (std::size_t i = 0; i < sizeof(Word); ++i) bytes.push_back(static_cast<std::uint8_t>(word >> (8 * i)));
  }
  std::vector<Event> events;
  decoder->Decode(bytes.data(), bytes.size(), &events);
  return events;
}

std::uint16_t TimeHigh(unsigned v) { return static_cast<std::uint16_t>(0x8000 | v); }
std::uint16_t TimeLow(unsigned v) { return static_cast<std::uint16_t>(0x6000 | v); }
std::uint16_t Row(unsigned v) { return static_cast<std::uint16_t>(v); }
std::uint16_t Column(unsigned v, bool on) { return static_cast<std::uint16_t>(0x2000 | (on ? 0x800 : 0) | v); }
std::uint16_t Base(unsigned v, bool on) { return static_cast<std::uint16_t>(0x3000 | (on ? 0x800 : 0) | v); }

TEST(Evt3, ReadsTimeRowColumnAndPolarity) {
  EvtDecoder decoder("evt3");
  const auto events = Decode<std::uint16_t>(
      &decoder, {TimeHigh(2), TimeLow(5), Row(100), Column(300, true), TimeLow(7), Column(301, false)});
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0].t_ns, (2 * 4096 + 5) * 1000);
  EXPECT_EQ(events[0].x, 300);
  EXPECT_EQ(events[0].y, 100);
  EXPECT_EQ(events[0].polarity, 1);
  EXPECT_EQ(events[1].t_ns, (2 * 4096 + 7) * 1000);
  EXPECT_EQ(events[1].polarity, 0);
}

TEST(Evt3, SpreadsVectorsFromTheirBaseOn) {
  EvtDecoder decoder("evt3");
  const auto events =
      Decode<std::uint16_t>(&decoder, {TimeHigh(0), TimeLow(1), Row(3), Base(10, true), 0x4801, 0x5081});
  ASSERT_EQ(events.size(), 4U);
  EXPECT_EQ(events[0].x, 10);
  EXPECT_EQ(events[1].x, 21);
  EXPECT_EQ(events[2].x, 22) << "the vector of 8 follows the vector of 12";
  EXPECT_EQ(events[3].x, 29);
  for (const Event& event : events) EXPECT_EQ(event.polarity, 1);
}

TEST(Evt3, GoesOnOverTheWrapOfItsCounter) {
  EvtDecoder decoder("evt3");
  const auto events = Decode<std::uint16_t>(
      &decoder, {TimeHigh(4095), TimeLow(4095), Row(0), Column(1, true), TimeHigh(0), TimeLow(0), Column(2, true)});
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0].t_ns, ((1LL << 24) - 1) * 1000);
  EXPECT_EQ(events[1].t_ns, (1LL << 24) * 1000);
}

TEST(Evt3, DoesNotTakeASmallStepBackForAWrap) {
  EvtDecoder decoder("evt3");
  const auto events = Decode<std::uint16_t>(
      &decoder, {TimeHigh(10), TimeLow(0), Row(0), Column(1, true), TimeHigh(9), TimeLow(0), Column(2, true)});
  EXPECT_EQ(events[1].t_ns, 9 * 4096 * 1000);
}

TEST(Evt3, KeepsItsStateFromPacketToPacket) {
  EvtDecoder decoder("evt3");
  EXPECT_TRUE(Decode<std::uint16_t>(&decoder, {TimeHigh(1), TimeLow(2), Row(7)}).empty());
  const auto events = Decode<std::uint16_t>(&decoder, {Column(5, true)});
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].t_ns, (4096 + 2) * 1000);
  EXPECT_EQ(events[0].y, 7);
}

TEST(Evt3, SkipsWhatComesBeforeTheFirstTime) {
  EvtDecoder decoder("evt3");
  EXPECT_TRUE(
      Decode<std::uint16_t>(&decoder, {Row(7), Column(5, true), TimeLow(3), Column(6, true), Base(0, true), 0x4001})
          .empty());
  EXPECT_EQ(decoder.skipped_words(), 3U);
}

TEST(Evt3, CountsTriggersAndDropsHalfAWord) {
  EvtDecoder decoder("evt3");
  Decode<std::uint16_t>(&decoder, {0xA601, 0xA600});
  EXPECT_EQ(decoder.triggers(), 2U);
  std::vector<Event> events;
  const std::uint8_t half = 0x20;
  decoder.Decode(&half, 1, &events);
  EXPECT_TRUE(events.empty());
}

TEST(Evt2, ReadsTimeRowColumnAndPolarity) {
  EvtDecoder decoder("evt2");
  const auto events = Decode<std::uint32_t>(&decoder, {0x80000003U, 0x10000000U | 5U << 22 | 600U << 11 | 400U,
                                                       0x00000000U | 63U << 22 | 1U << 11 | 2U, 0xA0000001U});
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0].t_ns, (3 * 64 + 5) * 1000);
  EXPECT_EQ(events[0].x, 600);
  EXPECT_EQ(events[0].y, 400);
  EXPECT_EQ(events[0].polarity, 1);
  EXPECT_EQ(events[1].t_ns, (3 * 64 + 63) * 1000);
  EXPECT_EQ(events[1].polarity, 0);
  EXPECT_EQ(decoder.triggers(), 1U);
}

TEST(Evt2, GoesOnOverTheWrapOfItsCounter) {
  EvtDecoder decoder("evt2");
  const auto events = Decode<std::uint32_t>(&decoder, {0x8FFFFFFFU, 0x10000000U, 0x80000000U, 0x10000000U});
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[1].t_ns - events[0].t_ns, 64000);
}

TEST(EvtDecoder, NamesAnEncodingThatItDoesNotKnow) {
  EXPECT_THAT([] { EvtDecoder("mono"); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("'mono' is not known, expected evt3 or evt2")));
}

}  // namespace
}  // namespace devo
