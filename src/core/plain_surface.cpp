// SPDX-License-Identifier: BSD-3-Clause
#include "plain_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "devo/core/time.h"
#include "simd.h"

namespace devo {
namespace {

constexpr int kMargin = 3;  // pixels at the border that are no edges
// Ages are differences of wrapping times of 32 bits: none may grow beyond.
constexpr std::uint32_t kLongAgo_ticks = 1U << 29;
constexpr std::int64_t kForgettingPeriod_ticks = std::int64_t{1} << 30;

constexpr int kSegment = 32;  // pixels that are looked at together, and left dark together

/// 255 * 2^-x for x from 0 to 10: the whole part in the exponent's bits, the rest (half at most, either way) by the
/// polynomial through 255 * 2^-rest at the six Chebyshev nodes. Without calls or branches, so that the compiler
/// vectorises a loop of it.
DEVO_ALWAYS_INLINE float Decayed255(float x) {
  const auto whole = static_cast<std::int32_t>(x + 0.5F);
  const float rest = x - static_cast<float>(whole);
  float power = 2.46738814F + rest * -0.341467016F;
  power = -14.1534106F + rest * power;
  power = 61.2563741F + rest * power;
  power = -176.752533F + rest * power;
  power = 255.000019F + rest * power;
  const std::int32_t scale_bits = (127 - whole) << 23;
  float scale;
  std::memcpy(&scale, &scale_bits, sizeof(scale));
  return scale * power;
}
constexpr float kDoubt = 2e-4F;  // the most by which it may be wrong, and more

/// What a row is made of, and what was seen in it.
struct Decay {
  std::uint32_t now;
  std::int32_t max_age;
  float halvings_per_tick, exponent_per_tick;
  std::int32_t used = 0, oldest = 0;
};

/// Where a value lies so near the middle between two levels that only the library's exponential tells which it is.
void DecayExactly(const std::uint32_t* ticks, int count, const Decay& decay, std::uint8_t* values) {
  for (int x = 0; x < count; ++x) {
    const auto age = static_cast<std::int32_t>(decay.now - ticks[x]);
    if (age > decay.max_age) continue;
    values[x] = static_cast<std::uint8_t>(
        std::lround(255 * std::exp(decay.exponent_per_tick * static_cast<float>(std::max(age, 0)))));
  }
}

DEVO_ALWAYS_INLINE void DecaySegment(const std::uint32_t* ticks, int count, std::uint8_t* values, Decay* decay) {
  const std::uint32_t now = decay->now;
  const std::int32_t max_age = decay->max_age;
  const float halvings_per_tick = decay->halvings_per_tick;
  std::int32_t used = 0, oldest = 0;
  for (int x = 0; x < count; ++x) used += static_cast<std::int32_t>(now - ticks[x]) <= max_age ? 1 : 0;
  decay->used += used;
  if (used == 0) {
    std::memset(values, 0, static_cast<std::size_t>(count));
    return;
  }
  std::int32_t doubtful = 0;
  for (int x = 0; x < count; ++x) {
    const auto age = static_cast<std::int32_t>(now - ticks[x]);
    const std::int32_t bright = age <= max_age ? -1 : 0;
    const float value = Decayed255(halvings_per_tick * static_cast<float>(age & bright)) + 0.5F;
    const auto whole = static_cast<std::int32_t>(value);
    const float rest = value - static_cast<float>(whole);
    doubtful |= static_cast<std::int32_t>(rest < kDoubt) | static_cast<std::int32_t>(rest > 1 - kDoubt);
    values[x] = static_cast<std::uint8_t>(whole & bright);
    oldest = std::max(oldest, age & bright);
  }
  if (doubtful) DecayExactly(ticks, count, *decay, values);
  decay->oldest = std::max(decay->oldest, oldest);
}

DEVO_ALWAYS_INLINE void DecayRow(const std::uint32_t* ticks, int width, std::uint8_t* values, Decay* decay) {
  int x = 0;
  for (; x + kSegment <= width; x += kSegment) DecaySegment(ticks + x, kSegment, values + x, decay);
  DecaySegment(ticks + x, width - x, values + x, decay);
}

void DecayRowPortable(const std::uint32_t* ticks, int width, std::uint8_t* values, Decay* decay) {
  DecayRow(ticks, width, values, decay);
}
#ifdef DEVO_AVX2
DEVO_AVX2 void DecayRowAvx2(const std::uint32_t* ticks, int width, std::uint8_t* values, Decay* decay) {
  DecayRow(ticks, width, values, decay);
}
#endif

/// Which of 16 values are at least `least`, one bit each.
inline int Reaching(const std::uint8_t* values, std::uint8_t least) {
  return cv::v_signmask(cv::v_reinterpret_as_s8(cv::v_load(values) >= cv::v_setall_u8(least)));
}

}  // namespace

PlainSurface::PlainSurface(const Camera& camera, double tau_s, double delta)
    : camera_(camera), undistorted_(camera.Undistorted()), tau_s_(tau_s), delta_(delta),
      row_ticks_(undistorted_.width()) {
  // exp(-age / tau) in 255 levels is exactly 0 beyond this age.
  const std::int64_t max_age_ns = NsFromSeconds(tau_s * std::log(2 * 255.0));
  while (max_age_ns >> tick_shift_ >= kLongAgo_ticks) ++tick_shift_;
  max_age_ticks_ = static_cast<std::int32_t>(max_age_ns >> tick_shift_);
  for (int value = 0; value < 256; ++value) strength_[value] = static_cast<float>(value) / 255.0F;
  if (camera.distortion() != DistortionModel::kNone) PrepareSources();
  Reset();
}

void PlainSurface::PrepareSources() {
  const int none = camera_.width() * camera_.height();
  source_.create(undistorted_.height(), undistorted_.width());
  for (int y = 0; y < undistorted_.height(); ++y) {
    for (int x = 0; x < undistorted_.width(); ++x) {
      const Eigen::Vector3d ray((x - undistorted_.cx()) / undistorted_.fx(),
                                (y - undistorted_.cy()) / undistorted_.fy(), 1);
      const auto u = camera_.Project(ray);
      source_(y, x) = u && camera_.Contains(*u) ? static_cast<int>(std::lround(u->y())) * camera_.width() +
                                                      static_cast<int>(std::lround(u->x()))
                                                : none;
    }
  }
}

void PlainSurface::Reset() {
  last_ticks_.assign(static_cast<std::size_t>(camera_.width()) * camera_.height() + 1, 0);
  forgot_ns_ = next_forgetting_ns_ = std::numeric_limits<std::int64_t>::min();  // the next event forgets them all
}

void PlainSurface::ForgetLongAgo(std::int64_t t_ns) {
  const std::int64_t period_ns = kForgettingPeriod_ticks << tick_shift_;
  const std::int64_t long_ago_ns = std::int64_t{kLongAgo_ticks} << tick_shift_;
  // After a gap this long, every pixel has been silent for long.
  const bool all =
      forgot_ns_ == std::numeric_limits<std::int64_t>::min() || t_ns - forgot_ns_ >= period_ns + long_ago_ns;
  const std::uint32_t now = TicksAt(t_ns);
  for (std::uint32_t& last : last_ticks_) last = all || now - last > kLongAgo_ticks ? now - kLongAgo_ticks : last;
  forgot_ns_ = t_ns;
  next_forgetting_ns_ = t_ns + period_ns;
}

const std::uint32_t* PlainSurface::TicksOfRow(int y) {
  if (source_.empty()) return last_ticks_.data() + static_cast<std::size_t>(y) * camera_.width();
  const int* source = source_[y];
  for (int x = 0; x < undistorted_.width(); ++x) row_ticks_[x] = last_ticks_[source[x]];
  return row_ticks_.data();
}

void PlainSurface::Render(Surface* surface) {
  if (surface->t_ns >= next_forgetting_ns_) ForgetLongAgo(surface->t_ns);
  auto decay_row = DecayRowPortable;
#ifdef DEVO_AVX2
  if (HasAvx2()) decay_row = DecayRowAvx2;
#endif
  Decay decay;
  decay.now = TicksAt(surface->t_ns);
  decay.max_age = max_age_ticks_;
  decay.halvings_per_tick = static_cast<float>(std::ldexp(1e-9, tick_shift_) / (tau_s_ * std::log(2.0)));
  decay.exponent_per_tick = static_cast<float>(std::ldexp(-1e-9 / tau_s_, tick_shift_));
  for (int y = 0; y < undistorted_.height(); ++y) {
    const int used = decay.used;
    decay_row(TicksOfRow(y), undistorted_.width(), surface->image[y], &decay);
    if (decay.used > used) AppendEdges(y, surface->image[y], &surface->edges);
  }
  surface->events_used = static_cast<std::uint32_t>(decay.used);
  surface->window_s = std::ldexp(1e-9 * decay.oldest, tick_shift_);
}

void PlainSurface::AppendEdges(int y, const std::uint8_t* values, std::vector<EdgePoint>* edges) const {
  if (y < kMargin || y >= undistorted_.height() - kMargin || delta_ >= 1) return;
  const auto least = static_cast<std::uint8_t>(std::floor(255 * delta_) + 1);
  const int end = undistorted_.width() - kMargin;
  PixelList columns;
  const auto append = [&] {
    const std::size_t before = edges->size();
    edges->resize(before + columns.size());
    EdgePoint* edge = edges->data() + before;
    for (int k = 0; k < columns.size(); ++k, ++edge) {
      edge->x = static_cast<float>(columns[k]);
      edge->y = static_cast<float>(y);
      edge->strength = strength_[values[columns[k]]];
    }
    columns.Clear();
  };
  for (int x = kMargin; x < end; x += 16) {
    // Sixteen are read: the image's end may come sooner.
    std::array<std::uint8_t, 16> copied{};
    const bool last = x + 16 > undistorted_.width();
    if (last) std::copy(values + x, values + undistorted_.width(), copied.begin());
    const int bits = Reaching(last ? copied.data() : values + x, least) & (0xFFFF >> std::max(x + 16 - end, 0));
    if (bits == 0) continue;
    columns.Append(x, bits & 0xFF);
    columns.Append(x + 8, bits >> 8);
    if (columns.size() > PixelList::kFull - 16) append();
  }
  append();
}

}  // namespace devo
