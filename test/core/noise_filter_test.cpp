// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;

Event At(std::int64_t t_ns, int x, int y) {
  return {t_ns, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1};
}

constexpr int kSide = 128;

/// Independent noise at `rate_hz` per pixel on the first `width` of kSide columns, `on_share` of it ON.
std::vector<Event> Noise(double rate_hz, double seconds, int width = kSide, double on_share = 0.5) {
  std::mt19937 random(3);
  std::exponential_distribution<double> wait_s(rate_hz * width * kSide);
  std::uniform_int_distribution<int> x(0, width - 1), y(0, kSide - 1);
  std::bernoulli_distribution on(on_share);
  std::vector<Event> events;
  for (double t_s = wait_s(random); t_s < seconds; t_s += wait_s(random)) {
    const int column = x(random);
    events.push_back(At(static_cast<std::int64_t>(1e9 * t_s), column, y(random)));
    events.back().polarity = on(random);
  }
  return events;
}

std::ptrdiff_t CountThatPass(const std::vector<Event>& events, NoiseFilter* filter) {
  return std::count_if(events.begin(), events.end(), [&](const Event& e) { return filter->Pass(e); });
}

double ShareThatPasses(const std::vector<Event>& events, NoiseFilter* filter) {
  return static_cast<double>(CountThatPass(events, filter)) / static_cast<double>(events.size());
}

/// A filter needs more neighbours until it knows the noise: these are the times by which and from which it does.
constexpr std::int64_t kKnown_ns = 300 * kMs;
constexpr double kKnown_s = 0.3;

/// Shows that there is no noise.
void WarmUpQuietly(NoiseFilter* filter) {
  filter->Pass(At(0, 0, 0));
  filter->Pass(At(kKnown_ns - 20 * kMs, 0, 0));
}

/// Of noise, those before (of the first 0.3 s) and those after the filter must know it.
struct Split {
  explicit Split(const std::vector<Event>& events) {
    for (const Event& event : events) (event.t_ns < kKnown_ns ? before : after).push_back(event);
  }
  std::vector<Event> before, after;
};

/// The chance that at least `count` of eight neighbours fired within the window.
double ChanceOf(int count, double rate_hz, double window_s) {
  const double p = 1 - std::exp(-rate_hz * window_s), q = 1 - p;
  const double chances[] = {std::pow(q, 8), 8 * p * std::pow(q, 7), 28 * p * p * std::pow(q, 6)};
  double chance = 1;
  for (int k = 0; k < count; ++k) chance -= chances[k];
  return chance;
}

void ExpectThatNeighboursSuffice(int min_neighbours, int needed, double rate_hz, double window_s) {
  NoiseFilter filter(kSide, kSide, window_s, min_neighbours, 0);
  const Split noise(Noise(rate_hz, 6));
  CountThatPass(noise.before, &filter);
  const double expected = ChanceOf(needed, rate_hz, window_s);
  EXPECT_NEAR(ShareThatPasses(noise.after, &filter), expected, 0.1 * expected)
      << min_neighbours << " neighbours asked for at " << rate_hz << " Hz";
}

TEST(NoiseFilter, LetsAsMuchThinNoisePassAsChanceBringsTogether) {
  ExpectThatNeighboursSuffice(1, 1, 0.5, 0.01);
  ExpectThatNeighboursSuffice(2, 2, 1, 0.03);
}

TEST(NoiseFilter, AsksOneNeighbourMoreWhereNoiseIsDense) {
  ExpectThatNeighboursSuffice(1, 2, 5, 0.005);
  ExpectThatNeighboursSuffice(1, 2, 5, 0.01);
  ExpectThatNeighboursSuffice(2, 3, 10, 0.01);
}

TEST(NoiseFilter, LetsHalfAnEventPerPixelAndSecondPassHoweverDenseTheNoiseAndWhateverItsPolarity) {
  for (const double rate_hz : {8, 12, 40}) {
    for (const double on_share : {0.5, 0.9, 1.0}) {
      NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
      const Split noise(Noise(rate_hz, 2, kSide, on_share));
      CountThatPass(noise.before, &filter);
      const double share = ShareThatPasses(noise.after, &filter);
      EXPECT_LT(share * rate_hz, 0.6) << rate_hz << " Hz, ON share " << on_share;
      // Not more is taken than need be: at 8 Hz it is enough to ask for the same polarity.
      EXPECT_GT(share * rate_hz, rate_hz > 10 ? 0.4 : 0.1) << rate_hz << " Hz, ON share " << on_share;
    }
  }
}

TEST(NoiseFilter, AsksForNeighboursOfTheSamePolarityWhereNoiseIsVeryDense) {
  for (const double rate_hz : {3, 10}) {
    NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
    CountThatPass(Noise(rate_hz, kKnown_s), &filter);
    const auto passes = [&](std::int64_t t_ns, std::uint8_t polarity) {
      for (const int x : {49, 51}) filter.Pass(At(t_ns, x, 50));  // ON
      Event event = At(t_ns + kMs / 10, 50, 50);
      event.polarity = polarity;
      return filter.Pass(event);
    };
    EXPECT_TRUE(passes(kKnown_ns + 20 * kMs, 1)) << rate_hz << " Hz";
    EXPECT_EQ(passes(kKnown_ns + 40 * kMs, 0), rate_hz < 5) << rate_hz << " Hz";
  }
}

TEST(NoiseFilter, LetsAnEdgeMovingInVeryDenseNoisePass) {
  std::vector<Event> events = Noise(20, 1);
  std::mt19937 random(4);
  std::uniform_int_distribution<std::int64_t> jitter_ns(0, kMs);
  for (int x = 1; x < kSide; ++x) {  // 500 px/s, vertical, from 0.3 s on
    for (int y = 0; y < kSide; ++y) events.push_back(At(kKnown_ns + 2 * x * kMs + jitter_ns(random), x, y));
  }
  const std::size_t edge = static_cast<std::size_t>(kSide - 1) * kSide;
  std::sort(events.begin(), events.end(), IsEarlier);
  const Split split(events);
  NoiseFilter with_edge(kSide, kSide, 0.01, 1, 0), without(kSide, kSide, 0.01, 1, 0);
  CountThatPass(split.before, &with_edge);
  const Split noise(Noise(20, 1));
  CountThatPass(noise.before, &without);
  const auto more = CountThatPass(split.after, &with_edge) - CountThatPass(noise.after, &without);
  EXPECT_GT(static_cast<double>(more), 0.8 * static_cast<double>(edge));
}

TEST(NoiseFilter, AsksOneNeighbourMoreUntilTheNoiseIsKnown) {
  const double expected = ChanceOf(2, 2, 0.01);
  NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
  EXPECT_EQ(filter.noise_hz(), 0);
  EXPECT_NEAR(ShareThatPasses(Noise(2, 0.249), &filter), expected, 0.3 * expected);  // some 80 events of 8000
}

TEST(NoiseFilter, AsksOneNeighbourAgainWhenDenseNoiseEnds) {
  NoiseFilter filter(kSide, kSide, 0.005, 1, 0);
  CountThatPass(Noise(10, kKnown_s), &filter);
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 10 * kMs, 50, 50)));
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 11 * kMs, 51, 50)));
  EXPECT_TRUE(filter.Pass(At(kKnown_ns + 12 * kMs, 50, 51)));
  filter.Pass(At(2 * kKnown_ns, 0, 0));
  filter.Pass(At(3 * kKnown_ns, 0, 0));  // a whole period without noise
  EXPECT_EQ(filter.noise_hz(), 0);
  EXPECT_FALSE(filter.Pass(At(3 * kKnown_ns + kMs, 50, 50)));
  EXPECT_TRUE(filter.Pass(At(3 * kKnown_ns + 2 * kMs, 51, 50)));
}

TEST(NoiseFilter, EstimatesUniformNoiseToATenth) {
  const double rate_hz = 10;
  NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
  CountThatPass(Noise(rate_hz, kKnown_s), &filter);
  EXPECT_NEAR(filter.noise_hz(), rate_hz, 0.1 * rate_hz);
}

TEST(NoiseFilter, EstimatesTheNoiseOfTheQuietestPartsNotTheActivityOfTheOthers) {
  auto events = Noise(10, kKnown_s);
  const auto busy = Noise(50, kKnown_s, kSide / 2);
  events.insert(events.end(), busy.begin(), busy.end());
  std::sort(events.begin(), events.end(), IsEarlier);
  NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
  CountThatPass(events, &filter);
  EXPECT_NEAR(filter.noise_hz(), 10, 1);
}

TEST(NoiseFilter, KnowsHowMuchNoisePasses) {
  const double rate_hz = 10, seconds = 2;
  for (const int neighbours : {0, 1}) {
    NoiseFilter filter(kSide, kSide, 0.01, neighbours, 0);
    const Split noise(Noise(rate_hz, kKnown_s + seconds));
    CountThatPass(noise.before, &filter);
    const double passing_hz = filter.passing_noise_hz();
    const double measured_hz = static_cast<double>(CountThatPass(noise.after, &filter)) / (kSide * kSide * seconds);
    EXPECT_NEAR(passing_hz, measured_hz, 0.1 * measured_hz) << neighbours << " neighbours";
  }
}

/// At so many Hz per pixel, and 3 Hz more in the left half, which sees less light.
std::vector<Event> NoiseThatDiffers(double seconds, double least_hz = 0.4) {
  auto events = Noise(least_hz, seconds);
  const auto darker = Noise(3, seconds, kSide / 2);
  events.insert(events.end(), darker.begin(), darker.end());
  std::sort(events.begin(), events.end(), IsEarlier);
  return events;
}

TEST(NoiseFilter, KnowsHowMuchNoisePassesThatDiffersBetweenPartsOfTheImage) {
  const double seconds = 2;
  for (const double least_hz : {0.4, 0.05}) {  // the latter where one half is dark, the other bright
    NoiseFilter filter(kSide, kSide, 0.01, 1, 0);
    const Split noise(NoiseThatDiffers(0.5 + seconds, least_hz));
    CountThatPass(noise.before, &filter);
    const double measured_hz =
        static_cast<double>(CountThatPass(noise.after, &filter)) / (kSide * kSide * (0.5 + seconds - kKnown_s));
    EXPECT_NEAR(filter.mean_passing_noise_hz(), measured_hz, 0.15 * measured_hz) << least_hz;
    EXPECT_LT(filter.passing_noise_hz(), 0.1 * measured_hz) << least_hz;  // of the quiet half
  }
}

TEST(NoiseFilter, TakesNoMovingEdgeForNoise) {
  auto events = NoiseThatDiffers(0.5);
  NoiseFilter without_edge(kSide, kSide, 0.01, 1, 0), with_edge(kSide, kSide, 0.01, 1, 0);
  CountThatPass(events, &without_edge);
  for (int x = 0; x < kSide; ++x) {  // 500 px/s, vertical, from 0.2 s on
    for (int y = 0; y < kSide; ++y) events.push_back(At((200 + 2 * x) * kMs + 1000 * y, x, y));
  }
  std::sort(events.begin(), events.end(), IsEarlier);
  CountThatPass(events, &with_edge);
  EXPECT_LT(with_edge.mean_passing_noise_hz(), 1.5 * without_edge.mean_passing_noise_hz());
}

TEST(NoiseFilter, WithoutNeededNeighboursLetsEverythingPass) {
  NoiseFilter filter(kSide, kSide, 0.005, 0, 0);
  EXPECT_EQ(ShareThatPasses(Noise(5, 0.5), &filter), 1);
}

/// A vertical edge that passes one column per millisecond from kKnown_ns on, its rows in random order.
std::vector<Event> Edge() {
  std::mt19937 random(4);
  std::uniform_int_distribution<int> jitter_us(0, 900);
  std::vector<Event> events;
  for (int x = 0; x < 100; ++x) {
    for (int y = 0; y < 100; ++y) events.push_back(At(kKnown_ns + x * kMs + 1000 * jitter_us(random), x, y));
  }
  std::sort(events.begin(), events.end(), IsEarlier);
  return events;
}

TEST(NoiseFilter, LetsAMovingEdgePass) {
  NoiseFilter filter(100, 100, 0.005, 2, 20);
  WarmUpQuietly(&filter);
  // The first column alone has too few predecessors.
  EXPECT_GT(ShareThatPasses(Edge(), &filter), 0.985);
}

TEST(NoiseFilter, ForgetsNeighboursThatFiredLongerAgoThanTheWindow) {
  NoiseFilter filter(10, 10, 0.005, 1, 0);
  WarmUpQuietly(&filter);
  EXPECT_FALSE(filter.Pass(At(kKnown_ns, 4, 4)));
  EXPECT_TRUE(filter.Pass(At(kKnown_ns + 4 * kMs, 5, 5)));
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 10 * kMs, 4, 5)));
}

TEST(NoiseFilter, DoesNotTakeAPixelForItsOwnNeighbour) {
  NoiseFilter filter(10, 10, 0.005, 1, 0);
  WarmUpQuietly(&filter);
  for (int k = 0; k < 5; ++k) EXPECT_FALSE(filter.Pass(At(kKnown_ns + k * kMs, 4, 4)));
}

TEST(NoiseFilter, DoesNotTakeAPixelOfLongAgoForRecentWhateverTheTimeBetween) {
  for (const double window_s : {0.005, 0.016, 0.5}) {
    NoiseFilter filter(10, 10, window_s, 1, 0);
    WarmUpQuietly(&filter);
    // Counters of 16 bits come round after 65.536 ms or a multiple of it, of 32 bits after 72 minutes.
    std::int64_t t_ns = kKnown_ns;
    for (const std::int64_t silence_ns :
         {65'536'000L, 2 * 65'536'000L, 98'304'000L, 64 * 65'536'000L, 4'294'967'296'000L, 1'000'000'000L}) {
      filter.Pass(At(t_ns, 4, 4));
      const bool recent = silence_ns <= static_cast<std::int64_t>(1e9 * window_s);
      EXPECT_EQ(filter.Pass(At(t_ns + silence_ns, 5, 5)), recent) << silence_ns << " ns, window " << window_s << " s";
      t_ns += silence_ns + NsFromSeconds(1.5);
    }
  }
}

TEST(NoiseFilter, GivesTheSameWhereverAStreamIsCut) {
  const std::vector<Event> events = Noise(30, 1);
  NoiseFilter one_by_one(kSide, kSide, 0.01, 1, 5), in_spans(kSide, kSide, 0.01, 1, 5);
  std::vector<std::uint32_t> expected, found, passed(events.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    if (one_by_one.Pass(events[i])) expected.push_back(static_cast<std::uint32_t>(i));
  }
  std::mt19937 random(5);
  for (std::size_t i = 0; i < events.size();) {
    const std::size_t size = std::min<std::size_t>(random() % 100000, events.size() - i);
    const std::size_t count = in_spans.Pass({events.data() + i, size}, passed.data());
    for (std::size_t k = 0; k < count; ++k) found.push_back(static_cast<std::uint32_t>(i) + passed[k]);
    i += size;
  }
  EXPECT_GT(expected.size(), events.size() / 50);
  EXPECT_EQ(found, expected);
  EXPECT_EQ(in_spans.hot_pixels(), one_by_one.hot_pixels());
}

TEST(NoiseFilter, KnowsNoNeighboursBeyondTheBorders) {
  NoiseFilter filter(10, 8, 0.005, 1, 0);
  WarmUpQuietly(&filter);
  EXPECT_FALSE(filter.Pass(At(kKnown_ns, 9, 3)));  // the end of a row is no neighbour of the next row's begin
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 1, 0, 4)));
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 2, 0, 0)));
  EXPECT_FALSE(filter.Pass(At(kKnown_ns + 3, 9, 7)));
}

/// `period_ms` between the events of each of `pixels`, up to `until_ms`; true for those after the first
/// 300 ms that pass.
int PassLate(NoiseFilter* filter, const std::vector<std::pair<int, int>>& pixels, int until_ms) {
  int passed = 0;
  for (int ms = 0; ms < until_ms; ms += 2) {
    for (const auto& [x, y] : pixels) passed += filter->Pass(At(ms * kMs, x, y)) && ms >= 300;
  }
  return passed;
}

TEST(NoiseFilter, DropsAHotPixelAndKeepsItsNeighbour) {
  NoiseFilter filter(20, 20, 0.005, 0, 20);
  EXPECT_EQ(PassLate(&filter, {{7, 7}}, 400), 0);
  EXPECT_EQ(filter.hot_pixels(), 1);
  EXPECT_TRUE(filter.Pass(At(400 * kMs, 8, 7)));
  EXPECT_FALSE(filter.Pass(At(401 * kMs, 7, 7)));
}

TEST(NoiseFilter, DropsTwoHotPixelsSideBySide) {
  NoiseFilter filter(20, 20, 0.005, 0, 20);
  EXPECT_EQ(PassLate(&filter, {{7, 7}, {8, 7}}, 400), 0);
  EXPECT_EQ(filter.hot_pixels(), 2);
}

TEST(NoiseFilter, DoesNotTakePixelsInsideOrAtTheSidesOfABusyPatchForHot) {
  NoiseFilter filter(20, 20, 0.005, 0, 20);
  std::vector<std::pair<int, int>> patch;
  for (int y = 5; y < 12; ++y) {
    for (int x = 5; x < 12; ++x) {
      const bool corner = (x == 5 || x == 11) && (y == 5 || y == 11);  // fewer than half of its neighbours are busy
      if (!corner) patch.emplace_back(x, y);
    }
  }
  EXPECT_EQ(PassLate(&filter, patch, 400), 50 * 45);
  EXPECT_EQ(filter.hot_pixels(), 0);
}

/// The columns up to `width` of all rows fire ON every 10 ms and OFF 5 ms later, each time within 1.5 ms.
std::vector<Event> Flicker(double seconds, int width) {
  std::mt19937 random(6);
  std::uniform_int_distribution<std::int64_t> late_ns(0, 3 * kMs / 2);
  std::vector<Event> events;
  for (std::int64_t t_ns = 0; t_ns < static_cast<std::int64_t>(1e9 * seconds); t_ns += 5 * kMs) {
    for (int i = 0; i < width * kSide; ++i) {
      events.push_back(At(t_ns + late_ns(random), i % width, i / width));
      events.back().polarity = t_ns % (10 * kMs) == 0;
    }
  }
  std::sort(events.begin(), events.end(), IsEarlier);
  return events;
}

TEST(NoiseFilter, LeavesOutAnAreaThatFlickersAndSeesItAgainWhenTheLampIsOff) {
  NoiseFilter filter(kSide, kSide, 0.01, 1, 20);
  const Split flicker(Flicker(1.5, 40));
  CountThatPass(flicker.before, &filter);
  EXPECT_LT(ShareThatPasses(flicker.after, &filter), 0.01);
  filter.Pass(At(1800 * kMs, 100, 100));
  filter.Pass(At(2100 * kMs, 100, 100));
  filter.Pass(At(2101 * kMs, 10, 10));
  filter.Pass(At(2102 * kMs, 11, 10));
  EXPECT_TRUE(filter.Pass(At(2103 * kMs, 10, 11)));
}

TEST(NoiseFilter, WithoutNeighboursToAskForABusyAreaIsNoFlicker) {
  NoiseFilter filter(kSide, kSide, 0.005, 0, 0);
  // As often as a lamp flickers, but each pixel at times of its own, as where texture moves fast.
  EXPECT_EQ(ShareThatPasses(Noise(200, 1.5, 40), &filter), 1);
}

TEST(NoiseFilter, WithoutNeighboursToAskForAnAreaThatFlickersIsLeftOutAllTheSame) {
  NoiseFilter filter(kSide, kSide, 0.005, 0, 20);
  const Split flicker(Flicker(1.5, 40));
  CountThatPass(flicker.before, &filter);
  EXPECT_LT(ShareThatPasses(flicker.after, &filter), 0.01);
}

TEST(NoiseFilter, DoesNotTakeForFlickerWhatMovesOverAnAreaAsOften) {
  // Stripes of 8 px at 800 px/s: every pixel fires ON and OFF 50 times per second each. A quarter of the image is
  // quiet.
  NoiseFilter filter(kSide, kSide, 0.01, 1, 20);
  std::vector<Event> events;
  for (int step = 0; step < 1200; ++step) {
    for (int x = step % 8; x < 3 * kSide / 4; x += 8) {
      for (int y = 0; y < kSide; ++y) {
        events.push_back(At(step * 5 * kMs / 4, x, y));
        events.back().polarity = (step - x) / 8 % 2 == 0;
      }
    }
  }
  EXPECT_GT(ShareThatPasses(events, &filter), 0.8);
}

TEST(NoiseFilter, LetsAPixelPassAgainThatHasCooledDown) {
  NoiseFilter filter(20, 20, 0.005, 0, 20);
  PassLate(&filter, {{7, 7}}, 400);
  filter.Pass(At(600 * kMs, 1, 1));  // ends the period in which the pixel was hot
  EXPECT_TRUE(filter.Pass(At(900 * kMs, 7, 7)));
}

TEST(NoiseFilter, ForgetsEverythingOnReset) {
  NoiseFilter filter(20, 20, 0.005, 1, 20);
  PassLate(&filter, {{7, 7}, {7, 8}}, 400);
  filter.Reset();
  EXPECT_EQ(filter.hot_pixels(), 0);
  EXPECT_FALSE(filter.Pass(At(300 * kMs, 7, 7)));  // time may even have gone back
  EXPECT_FALSE(filter.Pass(At(301 * kMs, 7, 8)));  // the noise is no longer known
  EXPECT_TRUE(filter.Pass(At(302 * kMs, 8, 8)));
}

TEST(NoiseFilter, TakesOtherCriteriaFromTheNextEventOn) {
  NoiseFilter filter(32, 24, 0.01, 1, 0);
  EXPECT_FALSE(filter.Pass({1'000'000, 10, 10, 1}));
  filter.SetCriteria(0.01, 0, 0);
  EXPECT_TRUE(filter.Pass({2'000'000, 20, 20, 1}));  // alone
  filter.SetCriteria(0.001, 1, 0);
  EXPECT_FALSE(filter.Pass({3'000'000, 5, 5, 1}));
  EXPECT_FALSE(filter.Pass({5'000'000, 6, 5, 1}));  // its neighbour fired, but 2 ms ago
  EXPECT_FALSE(filter.Pass({5'500'000, 7, 5, 1}));  // one more is asked for as long as the noise is unknown
  EXPECT_TRUE(filter.Pass({5'600'000, 6, 6, 1}));
}

TEST(NoiseFilter, TellsWhatIsRecentByAWindowThatIsSetLonger) {
  const std::int64_t ms = 1'000'000;
  NoiseFilter filter(32, 24, 0.01, 1, 0), from_the_start(32, 24, 0.2, 1, 0);
  filter.SetCriteria(0.2, 1, 0);
  // From the noise's first measurement on one neighbour is enough.
  std::vector<std::int64_t> times_ms = {0, 300, 400, 1000, 1150, 1500, 1800, 1900};
  std::vector<bool> passed, expected = {false, false, true, false, true, false, false, true};
  for (std::size_t k = 0; k < times_ms.size(); ++k) {
    const Event event{times_ms[k] * ms, static_cast<std::uint16_t>(k == 0 ? 20 : 5 + k % 2), 5, 1};
    passed.push_back(filter.Pass(event));
    EXPECT_EQ(passed.back(), from_the_start.Pass(event)) << k;
  }
  EXPECT_EQ(passed, expected);
}

TEST(NoiseFilter, KnowsNoRateOfNoiseWhereTheImageIsSmallerThanABlock) {
  NoiseFilter filter(8, 8, 0.01, 1, 20);
  for (std::int64_t k = 0; k < 1000; ++k) filter.Pass({k * 1'000'000, static_cast<std::uint16_t>(k % 8), 4, 1});
  EXPECT_EQ(filter.mean_passing_noise_hz(), filter.passing_noise_hz());
}

}  // namespace
}  // namespace devo
