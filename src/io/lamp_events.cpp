// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/lamp_events.h"

#include <algorithm>
#include <cmath>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kFlicker_s = 0.01;  // twice the mains' frequency
// A pixel passes its threshold about these shares of a period after it began, the other pixels within so much of it.
constexpr double kBrighterAt = 0.25, kDarkerAt = 0.75, kSpread = 0.15, kFires = 0.9;
constexpr double kWander_s = 4, kWanderShare = 0.3;  // of the image's width
// Contrast that makes an event, and how much it differs between pixels (Lichtsteiner et al. 2008: 2.1 %).
constexpr double kThreshold = 0.25, kThresholdSpread = 0.02;
constexpr double kSwitch_s = 0.02, kMostRead_hz = 12e6;  // a lamp's rise; what a DAVIS can read

}  // namespace

LampEvents::LampEvents(const LampOptions& options, int width, int height, std::int64_t begin_ns)
    : options_(options), width_(width), height_(height), begin_ns_(begin_ns) {
  std::sort(options_.switches.begin(), options_.switches.end(),
            [](const auto& a, const auto& b) { return a.at_s < b.at_s; });
}

void LampEvents::Add(double t_s, int x, int y, bool brighter) {
  upcoming_.push_back({begin_ns_ + NsFromSeconds(t_s), static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                       static_cast<std::uint8_t>(brighter)});
}

bool LampEvents::IsLit(int x, int y, double t_s) const {
  if (options_.flicker_share >= 1) return true;
  const double radius_square = options_.flicker_share * width_ * height_ / M_PI;
  const double from_middle = kWanderShare * width_ * std::sin(2 * M_PI * t_s / kWander_s);
  return std::pow(x - 0.5 * width_ - from_middle, 2) + std::pow(y - 0.5 * height_, 2) < radius_square;
}

void LampEvents::AddFlicker() {
  const double period_s = kFlicker_s * static_cast<double>(next_period_++);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      if (!IsLit(x, y, period_s)) continue;
      for (const bool brighter : {true, false}) {
        const double share = (brighter ? kBrighterAt : kDarkerAt) + kSpread * (Uniform() - 0.5);
        if (Uniform() < kFires) Add(period_s + kFlicker_s * share, x, y, brighter);
      }
    }
  }
}

void LampEvents::AddSwitch(const LampOptions::Switch& at) {
  const double contrast = std::abs(std::log(at.factor));
  const double takes_s = std::max(kSwitch_s, contrast / kThreshold * width_ * height_ / kMostRead_hz);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const double threshold = kThreshold * (1 + kThresholdSpread * 3.46 * (Uniform() - 0.5));
      for (double passed = threshold * Uniform(); passed < contrast; passed += threshold) {
        Add(at.at_s + takes_s * passed / contrast, x, y, at.factor > 1);
      }
    }
  }
}

void LampEvents::AppendUntil(std::int64_t end_ns, std::vector<Event>* events) {
  const double end_s = SecondsFromNs(end_ns - begin_ns_);
  const std::size_t sorted = upcoming_.size();
  while (options_.flicker_share > 0 && kFlicker_s * static_cast<double>(next_period_) < end_s) AddFlicker();
  for (; next_switch_ < options_.switches.size() && options_.switches[next_switch_].at_s < end_s; ++next_switch_) {
    AddSwitch(options_.switches[next_switch_]);
  }
  if (upcoming_.size() > sorted) std::stable_sort(upcoming_.begin(), upcoming_.end(), IsEarlier);
  const auto until = std::partition_point(upcoming_.begin(), upcoming_.end(),
                                          [end_ns](const Event& event) { return event.t_ns < end_ns; });
  events->insert(events->end(), upcoming_.begin(), until);
  upcoming_.erase(upcoming_.begin(), until);
}

}  // namespace devo
