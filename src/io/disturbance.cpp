// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/disturbance.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "devo/core/time.h"
#include "finite_number.h"

namespace devo {
namespace {

constexpr double kHotPixelRate_hz = 100;
constexpr const char* kSwitch = "AT:FACTOR, in seconds, and times as bright from then on, above 0";

double NumberIn(const std::string& number, const std::string& text, const char* expected) {
  const auto value = FiniteNumber(number);
  if (!value || *value < 0) throw std::invalid_argument("disturbance '" + text + "': expected " + expected);
  return *value;
}

/// Two numbers with a colon between.
std::pair<double, double> PairOf(const std::string& value, const std::string& text, const char* expected) {
  const auto colon = value.find(':');
  return {NumberIn(value.substr(0, colon), text, expected),
          NumberIn(colon == std::string::npos ? "" : value.substr(colon + 1), text, expected)};
}

}  // namespace

void DisturbanceOptions::Add(const std::string& text) {
  const auto equals = text.find('=');
  const std::string key = text.substr(0, equals), value = equals == std::string::npos ? "" : text.substr(equals + 1);
  if (key == "event_gap" || key == "depth_gap") {
    constexpr const char* kExpected = "FROM:TO in seconds, FROM below TO";
    const auto [begin_s, end_s] = PairOf(value, text, kExpected);
    const Span span{begin_s, end_s};
    if (span.begin_s >= span.end_s) throw std::invalid_argument("disturbance '" + text + "': expected " + kExpected);
    (key == "event_gap" ? event_gaps : depth_gaps).push_back(span);
    return;
  }
  if (key == "depth_latency") {
    depth_latency_s = NumberIn(value, text, "seconds");
    return;
  }
  if (key == "light") {
    const auto [at_s, factor] = PairOf(value, text, kSwitch);
    if (factor == 0) throw std::invalid_argument("disturbance '" + text + "': expected " + kSwitch);
    lamps.switches.push_back({at_s, factor});
    return;
  }
  if (key == "imu_noise") {
    std::tie(gyroscope_noise_deg_s, accelerometer_noise_m_s2) = PairOf(value, text, "DEG_S:M_S2, in deg/s and m/s^2");
    return;
  }
  if (miscalibration.Add(key, value)) return;
  const std::map<std::string, double*> shares{
      {"event_loss", &event_loss}, {"hot_pixels", &hot_pixel_share}, {"flicker", &lamps.flicker_share}};
  const auto known = shares.find(key);
  if (known == shares.end()) {
    throw std::invalid_argument(
        "disturbance '" + text +
        "': expected event_gap=FROM:TO, depth_gap=FROM:TO, depth_latency=SECONDS, "
        "event_loss=SHARE, hot_pixels=SHARE, flicker=SHARE, light=AT:FACTOR, imu_noise=DEG_S:M_S2 or an error of the "
        "calibration");
  }
  constexpr const char* kExpected = "a share from 0 to 1";
  const double share = NumberIn(value, text, kExpected);
  if (share > 1) throw std::invalid_argument("disturbance '" + text + "': expected " + kExpected);
  *known->second = share;
}

Disturbance::Disturbance(const DisturbanceOptions& options, int width, int height)
    : options_(options), width_(width), height_(height) {
  const auto pixels = static_cast<std::uint32_t>(width) * static_cast<std::uint32_t>(height);
  for (std::uint32_t pixel = 0; pixel < pixels && options.hot_pixel_share > 0; ++pixel) {
    if (Uniform() < options.hot_pixel_share) hot_pixels_.push_back(pixel);
  }
}

bool Disturbance::In(const std::vector<DisturbanceOptions::Span>& spans, double t_s) {
  return std::any_of(spans.begin(), spans.end(), [&](const auto& s) { return t_s >= s.begin_s && t_s < s.end_s; });
}

double Disturbance::Normal() {
  // Box and Muller.
  const double size = std::sqrt(-2 * std::log(1 - Uniform(&imu_random_)));
  return size * std::cos(2 * M_PI * Uniform(&imu_random_));
}

ImuSample Disturbance::Apply(ImuSample sample) {
  for (int axis = 0; axis < 3; ++axis) {
    sample.angular_velocity[axis] += M_PI / 180 * options_.gyroscope_noise_deg_s * Normal();
    sample.linear_acceleration[axis] += options_.accelerometer_noise_m_s2 * Normal();
  }
  return sample;
}

bool Disturbance::LosesDepth(std::int64_t t_ns) const {
  return begin_ns_ >= 0 && In(options_.depth_gaps, SecondsFromNs(t_ns - begin_ns_));
}

Event Disturbance::NextHotEvent() {
  const double rate_hz = kHotPixelRate_hz * static_cast<double>(hot_pixels_.size());
  const std::int64_t t_ns = hot_.t_ns + NsFromSeconds(-std::log(1 - Uniform()) / rate_hz);
  const auto chosen = static_cast<std::size_t>(Uniform() * static_cast<double>(hot_pixels_.size()));
  const std::uint32_t pixel = hot_pixels_[chosen];
  const auto width = static_cast<std::uint32_t>(width_);
  return {t_ns, static_cast<std::uint16_t>(pixel % width), static_cast<std::uint16_t>(pixel / width),
          static_cast<std::uint8_t>(Uniform() < 0.5)};
}

/// Those of hot pixels and lamps.
void Disturbance::AddEventsUntil(std::int64_t t_ns) {
  added_.clear();
  for (; !hot_pixels_.empty() && hot_.t_ns <= t_ns; hot_ = NextHotEvent()) added_.push_back(hot_);
  if (!lamps_) return;
  const auto hot = static_cast<std::ptrdiff_t>(added_.size());
  lamps_->AppendUntil(t_ns, &added_);
  std::inplace_merge(added_.begin(), added_.begin() + hot, added_.end(), IsEarlier);
}

EventSpan Disturbance::Apply(EventSpan events) {
  out_.clear();
  if (events.empty()) return out_;
  if (begin_ns_ < 0) {
    begin_ns_ = hot_.t_ns = events.begin()->t_ns;
    if (!hot_pixels_.empty()) hot_ = NextHotEvent();
    if (options_.lamps.any()) lamps_.emplace(options_.lamps, width_, height_, begin_ns_);
  }
  AddEventsUntil(events.end()[-1].t_ns);
  const auto lost = [this](const Event&) { return options_.event_loss > 0 && Uniform() < options_.event_loss; };
  std::remove_copy_if(events.begin(), events.end(), std::back_inserter(out_), lost);
  const auto own = static_cast<std::ptrdiff_t>(out_.size());
  out_.insert(out_.end(), added_.begin(), added_.end());
  std::inplace_merge(out_.begin(), out_.begin() + own, out_.end(), IsEarlier);
  const auto in_gap = [this](const Event& e) { return In(options_.event_gaps, SecondsFromNs(e.t_ns - begin_ns_)); };
  out_.erase(std::remove_if(out_.begin(), out_.end(), in_gap), out_.end());
  return out_;
}

}  // namespace devo
