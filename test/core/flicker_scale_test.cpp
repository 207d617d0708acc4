// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/flicker_scale.h"

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr int kWidth = 160, kHeight = 96;
constexpr std::int64_t kMs = 1'000'000, kBegin_ns = 5'000'000'000;

Event At(std::int64_t t_ns, int x, int y, bool brighter) {
  return {t_ns, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::uint8_t>(brighter)};
}

void Sort(std::vector<Event>* events) { std::sort(events->begin(), events->end(), IsEarlier); }

/// The columns from `first` to `end` at once, within 1.5 ms.
std::vector<Event> Burst(std::int64_t t_ns, int first, int end, bool brighter) {
  std::mt19937 random(static_cast<unsigned>(t_ns / kMs));
  std::uniform_int_distribution<std::int64_t> late_ns(0, 3 * kMs / 2);
  std::vector<Event> events;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = first; x < end; ++x) events.push_back(At(t_ns + late_ns(random), x, y, brighter));
  }
  Sort(&events);
  return events;
}

struct Lamp {
  FlickerScale scale{kWidth, kHeight, 4, 0.3};

  double ShareFound(const std::vector<Event>& events) {
    scale.Look(events);
    const auto found =
        std::count_if(events.begin(), events.end(), [this](const Event& event) { return scale.IsOfLamp(event); });
    return static_cast<double>(found) / static_cast<double>(events.size());
  }
};

TEST(FlickerScale, FindsWhatGetsDarkerAgainAtOnceWhereverItIs) {
  Lamp lamp;
  EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns, 0, 60, true)), 0);
  EXPECT_FALSE(lamp.scale.found());
  EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 5 * kMs, 0, 60, false)), 1);
  EXPECT_TRUE(lamp.scale.found());
  // And on, at 1000 px/s.
  for (int k = 1; k < 20; ++k) {
    EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 5 * (k + 1) * kMs, 5 * k, 5 * k + 60, k % 2 == 1)), 1) << k;
  }
}

TEST(FlickerScale, LeavesWhatFiresTheOtherWayMeanwhileAndElsewhere) {
  Lamp lamp;
  lamp.scale.Look(Burst(kBegin_ns, 0, 60, true));
  std::vector<Event> events = Burst(kBegin_ns + 5 * kMs, 0, 60, false);
  const Event within = At(kBegin_ns + 6 * kMs, 20, 30, true), beside = At(kBegin_ns + 6 * kMs, 120, 30, false);
  events.insert(events.end(), {within, beside});
  Sort(&events);
  lamp.scale.Look(events);
  EXPECT_FALSE(lamp.scale.IsOfLamp(within));
  EXPECT_FALSE(lamp.scale.IsOfLamp(beside));
  EXPECT_TRUE(lamp.scale.IsOfLamp(At(within.t_ns, 20, 30, false)));
}

TEST(FlickerScale, IsTheSameHoweverTheEventsAreCut) {
  std::vector<Event> all;
  for (int k = 0; k < 6; ++k) {
    const std::vector<Event> burst = Burst(kBegin_ns + 5 * k * kMs, 0, 80, k % 2 == 0);
    all.insert(all.end(), burst.begin(), burst.end());
  }
  Lamp whole, cut;
  whole.scale.Look(all);
  for (std::size_t i = 0; i < all.size(); i += 400) {
    cut.scale.Look({all.data() + i, std::min<std::size_t>(400, all.size() - i)});
  }
  for (const Event& event : all) EXPECT_EQ(whole.scale.IsOfLamp(event), cut.scale.IsOfLamp(event));
}

TEST(FlickerScale, TakesNoLightThatIsSwitchedOnForALamp) {
  Lamp lamp;
  for (int k = 0; k < 10; ++k) EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 2 * k * kMs, 0, kWidth, true)), 0);
}

TEST(FlickerScale, TakesNoEdgeAndNoTextureThatMovesFastForALamp) {
  // Stripes of 8 px brighten and darken each pixel 250 times a second, of 40 px the area that is looked at 50 times.
  constexpr double kSpeed = 4000;
  for (const int stripe_px : {8, 20, 40, 1000}) {
    Lamp lamp;
    std::vector<Event> events;
    for (int x = 0; x < kWidth; ++x) {
      for (int k = 0; k * stripe_px < 400; ++k) {
        const auto t_ns = kBegin_ns + static_cast<std::int64_t>(1e9 * (x + k * stripe_px) / kSpeed);
        // A strong edge fires each pixel several times.
        for (int i = 0; i < 4 * kHeight; ++i) events.push_back(At(t_ns + i, x, i / 4, k % 2 == 0));
      }
    }
    Sort(&events);
    EXPECT_EQ(lamp.ShareFound(events), 0) << stripe_px;
  }
}

TEST(FlickerScale, KnowsNoLampAfterAPauseAndAfterClearing) {
  Lamp lamp;
  lamp.scale.Look(Burst(kBegin_ns, 0, 60, true));
  EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 500 * kMs, 0, 60, false)), 0);
  EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 505 * kMs, 0, 60, true)), 1);
  lamp.scale.Clear();
  EXPECT_FALSE(lamp.scale.found());
  EXPECT_EQ(lamp.ShareFound(Burst(kBegin_ns + 510 * kMs, 0, 60, false)), 0);
}

TEST(FlickerScale, TellsNothingOfEventsLongAgoAndOfThoseOutsideTheImage) {
  Lamp lamp;
  lamp.scale.Look(Burst(kBegin_ns, 0, 60, true));
  const std::vector<Event> darker = Burst(kBegin_ns + 5 * kMs, 0, 60, false);
  EXPECT_EQ(lamp.ShareFound(darker), 1);
  lamp.scale.Look(std::vector<Event>{At(kBegin_ns + 90 * kMs, 10, 10, true), At(kBegin_ns + 91 * kMs, kWidth, 0, true),
                                     At(kBegin_ns + 91 * kMs, 0, 60000, true)});
  EXPECT_FALSE(lamp.scale.IsOfLamp(darker.front()));
}

TEST(FlickerScale, TellsNothingOfEventsThatItHasNotLookedAt) {
  Lamp lamp;
  lamp.scale.Look(Burst(kBegin_ns, 0, 60, true));
  const std::vector<Event> darker = Burst(kBegin_ns + 5 * kMs, 0, 60, false);
  EXPECT_EQ(lamp.ShareFound(darker), 1);
  for (std::int64_t later = 1; later < 3 * FlickerScale::kSlots; ++later) {
    EXPECT_FALSE(lamp.scale.IsOfLamp(At(darker.back().t_ns + later * kMs, 10, 10, false)));
  }
}

}  // namespace
}  // namespace devo
