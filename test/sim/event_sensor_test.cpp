// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/event_sensor.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "devo/sim/ray_tracer.h"
#include "sim/sim_test_scenes.h"

namespace devo::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;

EventSensor SmallSensor(int width, int height, const EventPixelModel& pixel) {
  EventSensor sensor;
  sensor.camera = Camera(width, height, 200, 200, 0.5 * (width - 1), 0.5 * (height - 1), "none", {});
  sensor.pixel = pixel;
  return sensor;
}

/// Events of pixels that all see the same light, `light(t)` in reflected lux.
template <typename Light>
std::vector<Event> EventsOf(const EventSensor& sensor, double duration_s, double step_s, Light&& light) {
  const int width = sensor.camera.width(), height = sensor.camera.height();
  EventPixels pixels(sensor, width, 3);
  std::vector<float> row(width, static_cast<float>(light(0.0)));
  for (int y = 0; y < height; ++y) pixels.StartRow(y, 0, row.data());
  std::vector<Event> events;
  const auto step_ns = static_cast<std::int64_t>(step_s * 1e9);
  constexpr std::int64_t kBlock_ns = 10000000;
  for (std::int64_t t = 0; t < static_cast<std::int64_t>(duration_s * 1e9); t += step_ns) {
    std::fill(row.begin(), row.end(), static_cast<float>(light(1e-9 * static_cast<double>(t + step_ns))));
    for (int y = 0; y < height; ++y) {
      if (t % kBlock_ns == 0) pixels.BeginNoiseBlock(y, t, t + kBlock_ns);
      pixels.AdvanceRow(y, t, t + step_ns, row.data(), {}, nullptr, &events);
    }
  }
  return events;
}

/// A pixel that sees L(t) = L0 (1 + m sin(phase)), phase = phase0 + omega t, after it fired at a known time: the next
/// event's phase in closed form.
struct GratingPixel {
  double modulation, threshold, reference;  // reference: log(1 + m sin) at the last event

  double NextPhase(double phase, bool* on) const {
    const double rise = (std::exp(reference + threshold) - 1) / modulation;
    const double fall = (std::exp(reference - threshold) - 1) / modulation;
    double next = 1e300;
    const auto after = [&](double p) { return p + 2 * kPi * std::ceil((phase - p) / (2 * kPi)); };
    if (rise < 1) {
      next = after(std::asin(rise));
      *on = true;
    }
    if (fall > -1 && after(kPi - std::asin(fall)) < next) {
      next = after(kPi - std::asin(fall));
      *on = false;
    }
    return next;
  }

  /// The brightest or darkest light is within a hundredth of a threshold of the next event.
  bool IsUndecided() const {
    const double rest = std::min(std::abs(std::log(1 + modulation) - reference - threshold),
                                 std::abs(std::log(1 - modulation) - reference + threshold));
    return rest < 0.01 * threshold;
  }
};

struct Grating {
  double period_px, modulation, threshold;
};

struct GratingErrors {
  double mean_s = 0, worst_s = 0;
  int compared = 0;
  int undecided = 0;  ///< pixels that the closed form brings so near to a threshold that rounding decides
};

/// Moves a grating past ideal pixels at 1000 px/s, sampled as finely as a sequence does it, asserts counts and
/// polarities, and returns the errors of the times.
void CompareWithGrating(const Grating& grating, GratingErrors* errors) {
  constexpr double kSpeed_px_s = 1000, kFocal_px = 200, kDistance_m = 1;
  const double period_px = grating.period_px, contrast = grating.modulation, threshold = grating.threshold;
  // One metre of texture is `width()` = 1 texel for a grating: period in metres over texture size in metres.
  const double period_m = period_px / kFocal_px * kDistance_m;
  Scene scene = WallScene(kDistance_m, Texture::Grating(0.5, contrast, period_m), 1.0);
  scene.BakeLight(100);
  const EventSensor sensor = SmallSensor(64, 16, IdealPixel(threshold));
  const RayGrid rays(sensor.camera);
  EventPixels pixels(sensor, rays.stride(), 1);
  BandRenderer renderer(scene, rays);
  std::vector<float> light(static_cast<std::size_t>(16) * rays.stride()), nearest(rays.tile_columns());
  const auto pose = [&](double t) { return Rigid3::Translation({kSpeed_px_s / kFocal_px * t * kDistance_m, 0, 0}); };
  renderer.Render(View(scene, pose(0)), 0, light.data(), nearest.data());
  for (int y = 0; y < 16; ++y) pixels.StartRow(y, 0, &light[static_cast<std::size_t>(y) * rays.stride()]);
  std::vector<Event> events;
  constexpr std::int64_t kStep_ns = 600000;  // 0.6 px
  for (std::int64_t t = 0; t < std::llround(6 * period_px) * kStep_ns; t += kStep_ns) {
    renderer.Render(View(scene, pose(1e-9 * static_cast<double>(t + kStep_ns))), 0, light.data(), nearest.data());
    for (int y = 0; y < 16; ++y) {
      const EventPixels::Probe probe = [&](double share, int column) {
        return renderer.LuminanceOf(View(scene, pose(1e-9 * (static_cast<double>(t) + share * kStep_ns))), y, column);
      };
      pixels.AdvanceRow(y, t, t + kStep_ns, &light[static_cast<std::size_t>(y) * rays.stride()],
                        EventPixels::Accuracy(), probe, &events);
    }
  }
  std::stable_sort(events.begin(), events.end(), IsEarlier);

  // Where pixel x is on the wall, as surface coordinate and so as phase.
  const Surface& wall = scene.surfaces()[0];
  const double blur = kPi / period_px, modulation = contrast * std::exp(-0.5 * blur * blur);
  const auto phase_of = [&](int x, double t) {
    const double world_x =
        (x - sensor.camera.cx()) / kFocal_px * kDistance_m + kSpeed_px_s / kFocal_px * t * kDistance_m;
    return -2 * kPi * (wall.origin.x() - world_x + wall.texture_offset_s) / period_m + kPi;  // sin(-p + pi) = sin(p)
  };
  const double omega = 2 * kPi * kSpeed_px_s / period_px;
  for (int x = 2; x < 62; x += 3) {
    GratingPixel theory{modulation, threshold, 0};
    double phase = 0;
    bool started = false, undecided = false;
    int on = 0, off = 0;
    double first_s = 0;
    for (const Event& e : events) {
      if (e.x != x || e.y != 5) continue;
      const double t = 1e-9 * static_cast<double>(e.t_ns);
      if (!started) {
        started = true;
        first_s = t;
        phase = phase_of(x, t);
        theory.reference = std::log(1 + modulation * std::sin(phase));
        continue;
      }
      bool expect_on = false;
      phase = theory.NextPhase(phase + 1e-6, &expect_on);
      const double expected_s = first_s + (phase - phase_of(x, first_s)) / omega;
      if (expect_on != (e.polarity == 1) && theory.IsUndecided()) {
        undecided = true;
        break;
      }
      ASSERT_EQ(expect_on, e.polarity == 1) << "pixel " << x << " at " << t;
      errors->worst_s = std::max(errors->worst_s, std::abs(t - expected_s));
      errors->mean_s += std::abs(t - expected_s);
      theory.reference += expect_on ? threshold : -threshold;
      ++errors->compared;
      // Whole cycles only, for the split of polarities.
      if (t - first_s < 3 * period_px / kSpeed_px_s - 1e-4) ++(e.polarity != 0 ? on : off);
    }
    errors->undecided += undecided ? 1 : 0;
    if (undecided) continue;
    EXPECT_NEAR(on, off, 1) << "pixel " << x;
    const double range = std::log((1 + modulation) / (1 - modulation));
    EXPECT_NEAR(on / 3.0, std::floor(range / threshold), 1.34) << "pixel " << x;
  }
  errors->mean_s /= std::max(1, errors->compared);
}

TEST(EventPixels, MatchTheClosedFormOfASinusoidalGratingAtAThousandPixelsPerSecondToTwentyMicroseconds) {
  for (const Grating& grating : {Grating{20, 0.6, 0.17}, Grating{12, 0.9, 0.24}, Grating{40, 0.3, 0.05}}) {
    GratingErrors errors;
    CompareWithGrating(grating, &errors);
    const std::string name = std::to_string(static_cast<int>(grating.period_px)) + "_px_period_";
    RecordProperty(name + "mean_us", std::to_string(1e6 * errors.mean_s));
    RecordProperty(name + "worst_us", std::to_string(1e6 * errors.worst_s));
    EXPECT_GT(errors.compared, 500);
    EXPECT_LE(errors.undecided, 2);
    EXPECT_LT(errors.mean_s, 3e-6);
    EXPECT_LT(errors.worst_s, 20e-6);
  }
}

TEST(EventPixels, FireNoiseAtTheRateOfTheModel) {
  EventPixelModel model = IdealPixel(0.22);
  model.noise_power_factor = 2.0;
  const EventSensor sensor = SmallSensor(96, 96, model);
  constexpr double kLux = 20;
  const double chip = kLux * sensor.ChipLuxPerSceneLux() + 1e-6;
  const double expected = 2 * NoiseRate(model, chip, 0.22);
  ASSERT_GT(expected, 0.2) << "a test of noise needs noise";
  constexpr double kDuration_s = 10;
  const auto events = EventsOf(sensor, kDuration_s, 0.01, [&](double) { return kLux; });
  const double rate = static_cast<double>(events.size()) / (96 * 96 * kDuration_s);
  EXPECT_NEAR(rate, expected, 0.05 * expected);
  const auto on = std::count_if(events.begin(), events.end(), [](const Event& e) { return e.polarity != 0; });
  EXPECT_NEAR(static_cast<double>(on) / static_cast<double>(events.size()), 0.5, 0.02);
}

TEST(EventPixels, FireAtRestAsOftenAsShotNoiseLeakAndHotPixelsOfTheDefaultModelTogether) {
  EventPixelModel model;
  model.hot_share = 0.02;  // enough of them for a mean
  const EventSensor sensor = SmallSensor(160, 128, model);
  for (const double lux : {20.0, 3.0}) {  // dim, dark
    const double chip = 0.4 * lux * sensor.ChipLuxPerSceneLux() + model.dark_current_lux;
    const EventPixels pixels(sensor, 160, 3);
    double expected = 160 * 128 * (model.leak_hz + model.parasitic_hz_per_lux * chip + model.hot_share * model.hot_hz);
    for (int y = 0; y < 128; ++y) {
      for (int x = 0; x < 160; ++x)
        expected +=
            NoiseRate(model, chip, pixels.threshold_on(y, x)) + NoiseRate(model, chip, pixels.threshold_off(y, x));
    }
    constexpr double kSeconds = 6;
    const auto events = EventsOf(sensor, kSeconds, 0.005, [&](double) { return 0.4 * lux; });
    EXPECT_NEAR(static_cast<double>(events.size()) / kSeconds, expected, 0.05 * expected) << lux << " lux";
  }
}

TEST(EventPixels, LeakOnEventsAtTheSetRate) {
  EventPixelModel model = IdealPixel(0.22);
  model.leak_hz = 0.5;
  model.leak_mismatch = 0.2;
  const auto events = EventsOf(SmallSensor(96, 96, model), 16, 0.005, [](double) { return 100.0; });
  // After 6 s every pixel has leaked through what was between its first level and its threshold.
  const auto late = std::count_if(events.begin(), events.end(), [](const Event& e) { return e.t_ns > 6000000000; });
  EXPECT_NEAR(static_cast<double>(late) / (96 * 96 * 10), 0.5, 0.025);
  EXPECT_TRUE(std::all_of(events.begin(), events.end(), [](const Event& e) { return e.polarity == 1; }));
}

TEST(EventPixels, LeakMoreInBrightLightByTheParasiticPhotocurrent) {
  EventPixelModel model = IdealPixel(0.22);
  model.leak_hz = 0.1;
  model.parasitic_hz_per_lux = 0.01;
  const EventSensor sensor = SmallSensor(96, 96, model);
  constexpr double kChipLux = 40;
  const auto events = EventsOf(sensor, 16, 0.005, [&](double) { return kChipLux / sensor.ChipLuxPerSceneLux(); });
  const auto late = std::count_if(events.begin(), events.end(), [](const Event& e) { return e.t_ns > 6000000000; });
  EXPECT_NEAR(static_cast<double>(late) / (96 * 96 * 10), 0.5, 0.025);
}

TEST(EventPixels, HaveThresholdsOfTheSetMeanAndMismatch) {
  const EventPixelModel model;
  const EventSensor sensor = SmallSensor(160, 160, model);
  const EventPixels pixels(sensor, 160, 3);
  double sum = 0, squares = 0, products = 0;
  constexpr double kCount = 160 * 160;
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 160; ++x) {
      const double on = pixels.threshold_on(y, x) - model.threshold_on;
      const double off = pixels.threshold_off(y, x) - model.threshold_off;
      sum += on + off;
      squares += on * on + off * off;
      products += on * off;
    }
  }
  const double sigma = std::sqrt(squares / (2 * kCount));
  EXPECT_NEAR(sigma, model.threshold_mismatch, 0.05 * model.threshold_mismatch);
  EXPECT_NEAR(sum / (2 * kCount), 0, 0.05 * model.threshold_mismatch);
  EXPECT_NEAR(products / kCount, 0, 0.05 * sigma * sigma) << "ON and OFF thresholds are drawn independently";
}

TEST(EventPixels, FireAtTheThresholdsThatWereDrawnForThem) {
  EventPixelModel model = IdealPixel(0.22);
  model.threshold_mismatch = 0.03;
  const EventSensor sensor = SmallSensor(32, 16, model);
  // A ramp of log light: the time between two events of a pixel is its threshold over the slope.
  constexpr double kSlope = 4;
  for (const double sign : {1.0, -1.0}) {
    const auto events = EventsOf(sensor, 0.5, 0.001, [&](double t) { return 500 * std::exp(sign * kSlope * t); });
    const EventPixels pixels(sensor, 32, 3);  // of the same seed
    std::vector<std::int64_t> last(32 * 16, -1);
    int compared = 0;
    for (const Event& e : events) {
      ASSERT_EQ(e.polarity, sign > 0 ? 1 : 0);
      std::int64_t& previous = last[e.y * 32 + e.x];
      if (previous >= 0) {
        const double threshold = sign > 0 ? pixels.threshold_on(e.y, e.x) : pixels.threshold_off(e.y, e.x);
        EXPECT_NEAR(1e-9 * static_cast<double>(e.t_ns - previous), threshold / kSlope, 5e-6);
        ++compared;
      }
      previous = e.t_ns;
    }
    EXPECT_GT(compared, 1000);
  }
}

TEST(EventPixels, AreHotAtTheSetShareAndRate) {
  EventPixelModel model = IdealPixel(0.22);
  model.hot_share = 0.25;
  model.hot_hz = 20;
  constexpr int kWidth = 192, kHeight = 128, kSeconds = 4;
  const auto events = EventsOf(SmallSensor(kWidth, kHeight, model), kSeconds, 0.005, [](double) { return 100.0; });
  std::vector<bool> fired(kWidth * kHeight, false);
  for (const Event& e : events) fired[e.y * kWidth + e.x] = true;
  // Rates are exponentially distributed: 1 / (1 + 80) of the hot pixels are silent for 4 s.
  const double share = static_cast<double>(std::count(fired.begin(), fired.end(), true)) / fired.size();
  EXPECT_NEAR(share, 0.25 * 80 / 81, 0.05 * 0.25);
  EXPECT_NEAR(static_cast<double>(events.size()) / (kWidth * kHeight * kSeconds), 5, 0.25);
}

TEST(EventPixels, AreSilentInConstantLightWithoutNoise) {
  EXPECT_TRUE(EventsOf(SmallSensor(32, 16, IdealPixel()), 1, 0.005, [](double) { return 100.0; }).empty());
}

TEST(EventPixels, RespectTheRefractoryPeriodAndFireAsTheRampThatItLeavesOutPredicts) {
  EventPixelModel model = IdealPixel(0.1);
  model.refractory_s = 300e-6;
  // The memorised level follows the light while the pixel is refractory: an event every threshold / slope and period.
  constexpr double kSlope = 40;
  const double expected_s = 0.1 / kSlope + model.refractory_s;
  const auto events =
      EventsOf(SmallSensor(16, 16, model), 0.1, 0.0005, [](double t) { return 10 * std::exp(kSlope * t); });
  ASSERT_GT(events.size(), 5000U);
  std::vector<std::int64_t> last(256, -1);
  for (const Event& e : events) {
    std::int64_t& previous = last[e.y * 16 + e.x];
    if (previous >= 0) {
      EXPECT_NEAR(1e-9 * static_cast<double>(e.t_ns - previous), expected_s, 3e-6);
    }
    previous = e.t_ns;
  }
}

TEST(EventPixels, FollowAStepOfLightWithThePhotoreceptorsTimeConstant) {
  EventPixelModel model = IdealPixel(0.2);
  model.limit_bandwidth = true;
  const EventSensor sensor = SmallSensor(64, 16, model);
  constexpr double kLux = 8, kStep = 0.5;  // log units
  const auto events =
      EventsOf(sensor, 0.2, 20e-6, [](double t) { return t < 0.1 - 1e-9 ? kLux : kLux * std::exp(kStep); });
  const double chip = kLux * std::exp(kStep) * sensor.ChipLuxPerSceneLux();
  const double tau = 1 / (2 * kPi * PhotoreceptorBandwidth(model, chip)) + 1 / (2 * kPi * model.follower_hz);
  // The memorised level is uniform within 0.95 thresholds: so is what is left to the first event.
  int first_events = 0;
  double earliest = 1, latest = 0;
  std::vector<bool> seen(64 * 16, false);
  for (const Event& e : events) {
    if (seen[e.y * 64 + e.x]) continue;
    seen[e.y * 64 + e.x] = true;
    ++first_events;
    earliest = std::min(earliest, 1e-9 * static_cast<double>(e.t_ns) - 0.1);
    latest = std::max(latest, 1e-9 * static_cast<double>(e.t_ns) - 0.1);
  }
  EXPECT_EQ(first_events, 64 * 16);
  const double expected_latest = -tau * std::log(1 - 1.95 * 0.2 / kStep);
  const double expected_earliest = -tau * std::log(1 - 0.05 * 0.2 / kStep);
  EXPECT_NEAR(latest, expected_latest, 0.03 * expected_latest);
  EXPECT_NEAR(earliest, expected_earliest, 0.03 * expected_latest);
}

TEST(EventPixels, SeeLessContrastInTheDarkBecauseOfDarkCurrent) {
  EventPixelModel model = IdealPixel(0.1);
  model.dark_current_lux = 0.05;
  const EventSensor sensor = SmallSensor(16, 16, model);
  const auto modulated = [](double lux) {
    return [lux](double t) { return lux * (1 + 0.8 * std::sin(2 * kPi * 5 * t)); };
  };
  EXPECT_LT(EventsOf(sensor, 1, 0.001, modulated(0.5)).size(), EventsOf(sensor, 1, 0.001, modulated(500)).size() / 2);
}

TEST(Readout, DelaysEventsBeyondItsRateAndLosesThoseThatWaitTooLong) {
  EventPixelModel model;
  model.readout_hz = 1e6;
  model.readout_delay_s = 100e-6;
  Readout readout(model);
  std::vector<Event> burst(1000), out;
  for (int i = 0; i < 1000; ++i) {
    burst[i].t_ns = 5000000;
    burst[i].x = static_cast<std::uint16_t>(i);
  }
  readout.Pass(&burst, &out);
  EXPECT_EQ(out.size(), 101U);
  EXPECT_EQ(readout.lost(), 899U);
  EXPECT_EQ(out.back().t_ns, 5100000);
  EXPECT_TRUE(std::is_sorted(out.begin(), out.end(), IsEarlier));
}

TEST(NoiseModel, MakesNoisePeakInDimLightAndVanishInBright) {
  const EventPixelModel model;
  EXPECT_GT(NoiseRate(model, 0.3, 0.16), 20 * NoiseRate(model, 30, 0.16));
  EXPECT_LT(NoiseSigma(model, 30), NoiseSigma(model, 0.3));
}

}  // namespace
}  // namespace devo::sim
