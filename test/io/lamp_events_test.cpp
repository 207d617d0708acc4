// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/lamp_events.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr int kWidth = 100, kHeight = 80, kPixels = kWidth * kHeight;
constexpr std::int64_t kBegin_ns = 5'000'000'000, kSecond_ns = 1'000'000'000;

/// Of one second, in steps of 7 ms.
std::vector<Event> OneSecond(const LampOptions& options) {
  LampEvents lamps(options, kWidth, kHeight, kBegin_ns);
  std::vector<Event> events;
  for (std::int64_t t_ns = kBegin_ns; t_ns < kBegin_ns + kSecond_ns; t_ns += 7'000'000) {
    lamps.AppendUntil(t_ns, &events);
    EXPECT_TRUE(events.empty() || events.back().t_ns < t_ns);
  }
  lamps.AppendUntil(kBegin_ns + kSecond_ns, &events);
  EXPECT_TRUE(std::is_sorted(events.begin(), events.end(), IsEarlier));
  return events;
}

TEST(LampEvents, OfALampThatFlickersAreBrighterAndDarkerAHundredTimesASecondOverItsShareOfTheImage) {
  LampOptions options;
  options.flicker_share = 0.2;
  const std::vector<Event> events = OneSecond(options);
  EXPECT_NEAR(events.size(), 0.2 * kPixels * 200, 0.12 * 0.2 * kPixels * 200);
  std::size_t in_half = 0;
  for (const Event& event : events) in_half += (event.t_ns % 10'000'000 < 5'000'000) == (event.polarity == 1);
  EXPECT_EQ(in_half, events.size());
}

TEST(LampEvents, OfALampThatIsSwitchedOnAreAsManyAsTheContrastHasThresholdsFromThenOn) {
  LampOptions options;
  options.switches = {{0.5, 4}};
  const std::vector<Event> events = OneSecond(options);
  EXPECT_NEAR(events.size(), std::log(4.0) / 0.25 * kPixels, 0.05 * 5 * kPixels);
  for (const Event& event : events) {
    EXPECT_EQ(event.polarity, 1);
    EXPECT_GE(event.t_ns, kBegin_ns + kSecond_ns / 2);
  }
}

TEST(LampEvents, OfALampThatIsSwitchedOffAreDarker) {
  LampOptions options;
  options.switches = {{0.5, 0.25}};
  const std::vector<Event> events = OneSecond(options);
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.front().polarity, 0);
}

}  // namespace
}  // namespace devo
