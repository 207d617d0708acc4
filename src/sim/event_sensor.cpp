// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/event_sensor.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "devo/sim/random.h"

namespace devo::sim {
namespace {

constexpr float kNever = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kMaxHalvings = 4;
constexpr std::int64_t kTick_ns = 1000;

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define DEVO_SIM_DISPATCH __attribute__((target_clones("avx2", "default")))
#else
#define DEVO_SIM_DISPATCH
#endif

// Helpers that return vectors are always inlined: no call passes one.
#pragma GCC diagnostic ignored "-Wpsabi"
using F8 = float __attribute__((vector_size(32)));
using I8 = std::int32_t __attribute__((vector_size(32)));

inline __attribute__((always_inline)) F8 Load(const float* p) {
  F8 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

/// Natural logarithm of positive, normal numbers to 1e-7 (Cephes logf).
inline __attribute__((always_inline)) F8 Log(F8 x) {
  I8 bits;
  std::memcpy(&bits, &x, sizeof bits);
  I8 exponent = ((bits >> 23) & 0xff) - 126;
  bits = (bits & 0x007fffff) | 0x3f000000;
  F8 m;
  std::memcpy(&m, &bits, sizeof m);
  const I8 small = m < 0.707106781186547524F;
  exponent += small;  // true is -1
  m = (small ? m + m : m) - 1.0F;
  const F8 e = __builtin_convertvector(exponent, F8);
  const F8 z = m * m;
  F8 y = F8{} + 7.0376836292E-2F;
  y = y * m - 1.1514610310E-1F;
  y = y * m + 1.1676998740E-1F;
  y = y * m - 1.2420140846E-1F;
  y = y * m + 1.4249322787E-1F;
  y = y * m - 1.6668057665E-1F;
  y = y * m + 2.0000714765E-1F;
  y = y * m - 2.4999993993E-1F;
  y = y * m + 3.3333331174E-1F;
  y = y * m * z - 2.12194440e-4F * e - 0.5F * z;
  return m + y + 0.693359375F * e;
}

/// exp(x) for x <= 0, to 1e-6; 0 below -80.
inline __attribute__((always_inline)) F8 ExpOfNegative(F8 x) {
  const I8 zero = x < -80.0F;
  x = zero ? (F8{} - 80.0F) : x;
  const F8 k = x * 1.44269504088896341F;
  I8 n = __builtin_convertvector(k - 0.5F, I8);  // rounds towards zero: nearest, for negative k
  const F8 nf = __builtin_convertvector(n, F8);
  const F8 r = x - nf * 0.693359375F + nf * 2.12194440e-4F;
  F8 y = F8{} + 1.9875691500E-4F;
  y = y * r + 1.3981999507E-3F;
  y = y * r + 8.3334519073E-3F;
  y = y * r + 4.1665795894E-2F;
  y = y * r + 1.6666665459E-1F;
  y = y * r + 5.0000001201E-1F;
  y = y * r * r + r + 1.0F;
  n = (n + 127) << 23;
  F8 scale;
  std::memcpy(&scale, &n, sizeof scale);
  return zero ? F8{} : y * scale;
}

/// What a row's pixels do in a step where nothing crosses; all arrays of `n` (a multiple of 8).
struct RowArrays {
  const float* luminance;
  float *light, *log_light, *level, *reference;
  const float *slope, *on, *off, *leak, *noise_s;
  float *new_light, *new_log, *new_level;
  std::uint8_t* attention;
};
struct RowConstants {
  float to_chip_lux, dark_lux, pole_per_lux, follower_tau, dt, end_in_block, contrast, bend_per_slope, parasitic;
  bool filter;
};

/// New light, logarithm and low-passed level; marks pixels that need a closer look.
DEVO_SIM_DISPATCH
void AdvanceQuietPixels(const RowArrays& a, const RowConstants& c, int n) {
  for (int i = 0; i < n; i += 8) {
    const F8 light = Load(a.luminance + i) * c.to_chip_lux + c.dark_lux;
    const F8 u1 = Log(light), u0 = Load(a.log_light + i), y0 = Load(a.level + i);
    F8 y1 = u1;
    if (c.filter) {
      // First-order low-pass of an input that is linear over the step, exactly.
      const F8 mean = 0.5F * (light + Load(a.light + i));
      const F8 tau = 1.0F / (c.pole_per_lux * mean) + c.follower_tau;
      const F8 lag = (u1 - u0) * (tau / c.dt);
      y1 = u1 - lag + (y0 - u0 + lag) * ExpOfNegative(-c.dt / tau);
    }
    const F8 on = Load(a.on + i), off = Load(a.off + i);
    const F8 leak = (Load(a.leak + i) + c.parasitic * light * on) * c.dt, d = y1 - Load(a.reference + i) + leak;
    const F8 step = u1 - u0, limit = c.contrast * on;
    // Light that bends may have been beyond a threshold between the two ends of the step. Twice the bend: it is an
    // estimate from the slope before the step, and may grow within.
    const F8 turn = (step / c.dt - Load(a.slope + i)) * (2.0F * c.bend_per_slope), bend = turn < 0.0F ? -turn : turn;
    const I8 quiet =
        (d + bend < on) & (bend - d < off) & (step < limit) & (-step < limit) & (Load(a.noise_s + i) > c.end_in_block);
    std::memcpy(a.new_light + i, &light, sizeof light);
    std::memcpy(a.new_log + i, &u1, sizeof u1);
    std::memcpy(a.new_level + i, &y1, sizeof y1);
    for (int k = 0; k < 8; ++k) a.attention[i + k] = quiet[k] == 0 ? 1 : 0;
    const F8 reference = Load(a.reference + i);
    const F8 leaked = quiet != 0 ? reference - leak : reference;
    std::memcpy(a.reference + i, &leaked, sizeof leaked);
  }
}

std::uint32_t NextRandom(std::uint32_t* state) {  // PCG-RXS-M-XS (O'Neill 2014)
  *state = *state * 747796405U + 2891336453U;
  const std::uint32_t word = ((*state >> ((*state >> 28) + 4)) ^ *state) * 277803737U;
  return (word >> 22) ^ word;
}

float Uniform(std::uint32_t* state) { return (static_cast<float>(NextRandom(state) >> 8) + 0.5F) * 0x1p-24F; }

/// How far the middle of a parabola lies above its chord, per difference between the slope of its chord (over `dt`) and
/// that of the chord before it (over `dt_before`).
double BendPerSlope(double dt_before, double dt) { return -dt * dt / (4 * (dt_before + dt)); }

/// The first s in [from, 1] where a + b s + c s^2 reaches `level`, which it does not at `from`; infinite: nowhere.
double FirstRoot(double a, double b, double c, double level, double from) {
  const double discriminant = b * b - 4 * c * (a - level);
  if (!(discriminant >= 0)) return kNever;
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  double first = kNever;
  for (const double root : {q / c, (a - level) / q}) {
    if (root >= from && root <= 1) first = std::min(first, root);
  }
  return first;
}

float Gaussian(std::uint32_t* state) {
  const float r = std::sqrt(-2 * std::log(Uniform(state)));
  return r * std::cos(6.2831853F * Uniform(state));
}

}  // namespace

EventPixels::EventPixels(const EventSensor& sensor, int stride, std::uint64_t seed)
    : sensor_(sensor), width_(sensor.camera.width()), height_(sensor.camera.height()), stride_((stride + 7) / 8 * 8),
      to_chip_lux_(static_cast<float>(sensor.ChipLuxPerSceneLux())) {
  const std::size_t size = static_cast<std::size_t>(stride_) * height_;
  pixels_.resize(size);
  for (auto* v : {&light_, &log_light_, &level_, &reference_, &leak_, &slope_}) v->assign(size, 0);
  on_.assign(size, 1e9F);  // padding never fires
  off_.assign(size, 1e9F);
  noise_s_.assign(size, kNever);
  block_begin_ns_.assign(height_, 0);
  block_s_.assign(height_, 0);
  step_s_.assign(height_, 0);
  const EventPixelModel& m = sensor_.pixel;
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const std::size_t i = Index(y, x);
      Rng rng(seed, 0xe7e27, i);
      const auto mismatched = [&](double threshold) {
        return static_cast<float>(std::max(0.3 * threshold, threshold + m.threshold_mismatch * rng.Gaussian()));
      };
      on_[i] = mismatched(m.threshold_on);
      off_[i] = mismatched(m.threshold_off);
      leak_[i] = static_cast<float>(m.leak_hz * std::max(0.0, 1 + m.leak_mismatch * rng.Gaussian())) * on_[i];
      if (rng.Uniform() < m.hot_share) pixels_[i].hot_hz = static_cast<float>(-m.hot_hz * std::log(rng.Uniform()));
      pixels_[i].random = static_cast<std::uint32_t>(rng.Next());
    }
  }
}

void EventPixels::StartRow(int row, std::int64_t t_ns, const float* luminance) {
  block_begin_ns_[row] = t_ns;
  for (int x = 0; x < stride_; ++x) {
    const std::size_t i = Index(row, x);
    light_[i] = luminance[x] * to_chip_lux_ + static_cast<float>(std::max(1e-6, sensor_.pixel.dark_current_lux));
    log_light_[i] = level_[i] = std::log(light_[i]);
    // A sensor that has been on for a while remembers any level between its thresholds.
    reference_[i] =
        level_[i] + (x < width_ ? (Uniform(&pixels_[i].random) - 0.5F) * 1.9F * std::min(on_[i], off_[i]) : 0);
    pixels_[i].ready_ns = t_ns;
  }
}

float EventPixels::TimeConstant(float chip_lux) const {
  const EventPixelModel& m = sensor_.pixel;
  constexpr double k2Pi = 6.283185307179586;
  return static_cast<float>(1 / (k2Pi * m.bandwidth_hz_per_lux * chip_lux) + 1 / (k2Pi * m.follower_hz));
}

float EventPixels::DrawNoiseTime(std::size_t i, double after_s) {
  // Noise is a Poisson process without memory: it may be drawn anew at any time.
  const EventPixelModel& m = sensor_.pixel;
  float rate = pixels_[i].hot_hz;
  if (m.noise_power_factor > 0) {
    rate += static_cast<float>(NoiseRate(m, light_[i], on_[i]) + NoiseRate(m, light_[i], off_[i]));
  }
  if (!(rate > 0)) return kNever;
  return static_cast<float>(after_s - std::log(Uniform(&pixels_[i].random)) / rate);
}

void EventPixels::BeginNoiseBlock(int row, std::int64_t t0_ns, std::int64_t t1_ns) {
  block_begin_ns_[row] = t0_ns;
  block_s_[row] = 1e-9 * static_cast<double>(t1_ns - t0_ns);
  for (int x = 0; x < width_; ++x) {
    const std::size_t i = Index(row, x);
    noise_s_[i] = DrawNoiseTime(i, 0);
  }
}

void EventPixels::AdvanceRow(int row, std::int64_t t0_ns, std::int64_t t1_ns, const float* luminance,
                             const Accuracy& accuracy, const Probe& probe, std::vector<Event>* events) {
  thread_local std::vector<float> new_light, new_log, new_level;
  thread_local std::vector<std::uint8_t> attention;
  for (auto* v : {&new_light, &new_log, &new_level}) v->resize(stride_);
  attention.resize(stride_);
  const EventPixelModel& m = sensor_.pixel;
  const Step step{row,
                  t0_ns,
                  1e-9 * static_cast<double>(t1_ns - t0_ns),
                  1e-9 * static_cast<double>(t0_ns - block_begin_ns_[row]),
                  BendPerSlope(step_s_[row], 1e-9 * static_cast<double>(t1_ns - t0_ns)),
                  accuracy,
                  &probe,
                  events};
  const std::size_t at = Index(row, 0);
  constexpr double k2Pi = 6.283185307179586;
  const RowConstants constants{to_chip_lux_,
                               static_cast<float>(std::max(1e-6, m.dark_current_lux)),
                               static_cast<float>(k2Pi * m.bandwidth_hz_per_lux),
                               static_cast<float>(1 / (k2Pi * m.follower_hz)),
                               static_cast<float>(step.dt_s),
                               static_cast<float>(step.block_s + step.dt_s),
                               static_cast<float>(accuracy.contrast),
                               static_cast<float>(step.bend_per_slope),
                               static_cast<float>(m.parasitic_hz_per_lux),
                               m.limit_bandwidth};
  AdvanceQuietPixels(
      {luminance, &light_[at], &log_light_[at], &level_[at], &reference_[at], &slope_[at], &on_[at], &off_[at],
       &leak_[at], &noise_s_[at], new_light.data(), new_log.data(), new_level.data(), attention.data()},
      constants, stride_);
  for (int x = 0; x < width_; ++x) {
    if (attention[x] != 0) {
      AdvancePixel(step, x, at + x, new_log[x]);
      new_level[x] = level_[at + x];
    }
  }
  step_s_[row] = step.dt_s;
  const float per_s = static_cast<float>(1 / step.dt_s);
  for (int x = 0; x < stride_; ++x) slope_[at + x] = (new_log[x] - log_light_[at + x]) * per_s;
  std::copy(new_light.begin(), new_light.end(), light_.begin() + static_cast<std::ptrdiff_t>(at));
  std::copy(new_log.begin(), new_log.end(), log_light_.begin() + static_cast<std::ptrdiff_t>(at));
  std::copy(new_level.begin(), new_level.end(), level_.begin() + static_cast<std::ptrdiff_t>(at));
}

void EventPixels::AdvancePixel(const Step& step, int column, std::size_t i, float log_light) {
  float level = level_[i];
  const double bend = ((log_light - log_light_[i]) / step.dt_s - slope_[i]) * step.bend_per_slope;
  Subdivide(step, column, i, {0, log_light_[i]}, {1, log_light}, bend, 0, &level);
  level_[i] = level;
}

void EventPixels::Subdivide(const Step& step, int column, std::size_t i, Sample from, Sample to, double bend, int depth,
                            float* level) {
  const bool coarse = std::abs(to.log_light - from.log_light) > step.accuracy.contrast * on_[i] ||
                      std::abs(bend) > step.accuracy.straightness * on_[i];
  if (depth < kMaxHalvings && *step.probe && coarse) {
    Sample middle{0.5 * (from.share + to.share), 0};
    const float dark = static_cast<float>(std::max(1e-6, sensor_.pixel.dark_current_lux));
    middle.log_light = std::log((*step.probe)(middle.share, column) * to_chip_lux_ + dark);
    // Half of a parabola lies a quarter as far from its chord.
    const double bend_of_half = (middle.log_light - 0.5 * (from.log_light + to.log_light)) / 4;
    Subdivide(step, column, i, from, middle, bend_of_half, depth + 1, level);
    Subdivide(step, column, i, middle, to, bend_of_half, depth + 1, level);
    return;
  }
  const Arc light{from.share * step.dt_s, to.share * step.dt_s, from.log_light, to.log_light, bend};
  const Arc arc = sensor_.pixel.limit_bandwidth ? LowPassed(light, *level) : light;
  Fire(step, column, i, arc);
  *level = static_cast<float>(arc.y1);
}

EventPixels::Arc EventPixels::LowPassed(const Arc& light, double y0) const {
  // y' = (u - y) / tau for u = u0 + b t + c t^2 is solved by y = u - tau u' + tau^2 u'' + (what decays).
  const double dt = light.t1 - light.t0, tau = TimeConstant(std::exp(static_cast<float>(0.5 * (light.y0 + light.y1))));
  const double c = -4 * light.bend / (dt * dt), b = (light.y1 - light.y0) / dt - c * dt;
  const auto steady = [&](double t) { return light.y0 + b * (t - tau) + c * (t * t - 2 * tau * t + 2 * tau * tau); };
  const double decays = y0 - steady(0), half = std::exp(-0.5 * dt / tau);
  const double y1 = steady(dt) + decays * half * half;
  return {light.t0, light.t1, y0, y1, steady(0.5 * dt) + decays * half - 0.5 * (y0 + y1)};
}

void EventPixels::Fire(const Step& step, int column, std::size_t i, const Arc& arc) {
  Pixel& pixel = pixels_[i];
  const double dt = arc.t1 - arc.t0, b = arc.y1 - arc.y0 + 4 * arc.bend, c = -4 * arc.bend;
  // Over the arc.
  const double leak = (leak_[i] + sensor_.pixel.parasitic_hz_per_lux * light_[i] * on_[i]) * dt;
  const auto level_at = [&](double s) { return arc.y0 + (b + c * s) * s; };
  double s = 0;  // how much of the arc is done
  float& reference = reference_[i];
  while (true) {
    if (std::isnan(reference)) {  // refractory: the memorised level follows until the pixel is released
      const double ready = (1e-9 * static_cast<double>(pixel.ready_ns - step.t0_ns) - arc.t0) / dt;
      if (ready >= 1) return;
      s = std::max(s, ready);
      reference = static_cast<float>(level_at(s));
      if (sensor_.pixel.noise_power_factor > 0) {
        reference += static_cast<float>(NoiseSigma(sensor_.pixel, light_[i])) * Gaussian(&pixel.random);
      }
    }
    const double in_block = step.block_s + arc.t0;
    while (noise_s_[i] < in_block + s * dt)
      noise_s_[i] = DrawNoiseTime(i, std::max<double>(noise_s_[i], in_block + s * dt));
    const double noise = (noise_s_[i] - in_block) / dt, d = level_at(s) - reference;
    double rise = s, fall = kNever;
    if (d <= -off_[i]) {
      std::swap(rise, fall);
    } else if (d < on_[i]) {
      const double a = arc.y0 - reference - leak * s;
      rise = FirstRoot(a, b + leak, c, on_[i], s);
      fall = FirstRoot(a, b + leak, c, -off_[i], s);
    }
    const double crossing = std::min(rise, fall);
    if (std::min(noise, crossing) > 1) {
      reference -= static_cast<float>(leak * (1 - s));
      return;
    }
    bool on = rise < fall;
    if (noise < crossing) {
      const double rate_on = NoiseRate(sensor_.pixel, light_[i], on_[i]) + pixel.hot_hz;
      const double rate_off = NoiseRate(sensor_.pixel, light_[i], off_[i]);
      on = Uniform(&pixel.random) * (rate_on + rate_off) < rate_on;
      noise_s_[i] = DrawNoiseTime(i, noise_s_[i]);
    }
    s = std::min(noise, crossing);
    Emit(step, column, i, arc.t0 + s * dt, on);
  }
}

void EventPixels::Emit(const Step& step, int column, std::size_t i, double t_s, bool on) {
  const std::int64_t t_ns = step.t0_ns + static_cast<std::int64_t>(std::ceil(t_s * 1e9));
  Event event;
  event.t_ns = std::max((t_ns + kTick_ns - 1) / kTick_ns * kTick_ns, step.t0_ns + kTick_ns);
  event.x = static_cast<std::uint16_t>(column);
  event.y = static_cast<std::uint16_t>(step.row);
  event.polarity = on ? 1 : 0;
  step.events->push_back(event);
  pixels_[i].ready_ns = t_ns + static_cast<std::int64_t>(sensor_.pixel.refractory_s * 1e9);
  reference_[i] = kNaN;
}

Readout::Readout(const EventPixelModel& model)
    : period_ns_(1e9 / model.readout_hz), delay_ns_(1e9 * model.readout_delay_s) {}

void Readout::Pass(std::vector<Event>* events, std::vector<Event>* out) {
  std::sort(events->begin(), events->end(), [](const Event& a, const Event& b) {
    if (a.t_ns != b.t_ns) return a.t_ns < b.t_ns;
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  });
  for (Event event : *events) {
    const double t = std::max(static_cast<double>(event.t_ns), free_ns_);
    if (t - static_cast<double>(event.t_ns) > delay_ns_) {
      ++lost_;
      continue;
    }
    free_ns_ = t + period_ns_;
    event.t_ns = static_cast<std::int64_t>(t) / kTick_ns * kTick_ns;
    out->push_back(event);
  }
}

}  // namespace devo::sim
