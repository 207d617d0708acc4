// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/frame_sensor.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "devo/sim/random.h"

namespace devo::sim {
namespace {

constexpr double kBrightLux = 500, kBrightExposure_s = 0.008, kLongestExposure_s = 0.025;
constexpr double kBrightElectrons = 8000;  // of a white surface in bright light
constexpr double kReadNoise_e = 12;
constexpr double kHeadroom = 1.1;  // white, in the mean light, stays below saturation

}  // namespace

FrameSensor::FrameSensor(const Light& light, int stride, const Camera& camera, std::uint64_t seed)
    : camera_(camera), stride_(stride), seed_(seed) {
  exposure_s_ = std::clamp(kBrightExposure_s * kBrightLux / light.mean_lux, kBrightExposure_s, kLongestExposure_s);
  electrons_per_lux_s_ = kBrightElectrons / (kBrightLux * kBrightExposure_s);
  full_scale_electrons_ = kHeadroom * electrons_per_lux_s_ * light.mean_lux * exposure_s_;
  exposure_begin_ns_ = std::numeric_limits<std::int64_t>::max() / 2;
  exposure_ns_ = static_cast<std::int64_t>(exposure_s_ * 1e6) * 1000;
  exposure_lux_s_.assign(static_cast<std::size_t>(stride) * camera.height(), 0);
}

void FrameSensor::Start(std::int64_t t_ns, double rate_hz) {
  exposure_begin_ns_ = t_ns;
  period_ns_ = static_cast<std::int64_t>(1e6 / rate_hz) * 1000;
}

std::int64_t FrameSensor::BoundStep(std::int64_t from_ns, std::int64_t to_ns) const {
  for (const std::int64_t bound : {exposure_begin_ns_, exposure_begin_ns_ + exposure_ns_}) {
    if (from_ns < bound && bound < to_ns) return bound;
  }
  return to_ns;
}

float FrameSensor::ExposedShare(std::int64_t from_ns, std::int64_t to_ns) const {
  return from_ns >= exposure_begin_ns_ && to_ns <= exposure_begin_ns_ + exposure_ns_ ? 1.0F : 0.0F;
}

void FrameSensor::ExposeRow(int row, float exposed_s, const float* begin, const float* end) {
  float* sum = &exposure_lux_s_[static_cast<std::size_t>(row) * stride_];
  for (int x = 0; x < stride_; ++x) sum[x] += 0.5F * exposed_s * (begin[x] + end[x]);
}

void FrameSensor::TakeFinished(std::int64_t now_ns, std::vector<Frame>* frames) {
  if (period_ns_ == 0 || exposure_begin_ns_ + exposure_ns_ > now_ns) return;
  frames->push_back(ReadOut());
  exposure_begin_ns_ += period_ns_;
  std::fill(exposure_lux_s_.begin(), exposure_lux_s_.end(), 0.0F);
}

Frame FrameSensor::ReadOut() {
  Frame frame{exposure_begin_ns_ + exposure_ns_ / 2, cv::Mat1b(camera_.height(), camera_.width())};
  for (int y = 0; y < camera_.height(); ++y) {
    Rng rng(seed_, 0xf2a3e + count_, static_cast<std::uint64_t>(y));
    for (int x = 0; x < camera_.width(); ++x) {
      const double electrons = electrons_per_lux_s_ * exposure_lux_s_[static_cast<std::size_t>(y) * stride_ + x];
      const double noisy = electrons + rng.Gaussian() * std::sqrt(electrons + kReadNoise_e * kReadNoise_e);
      const double value = std::pow(std::clamp(noisy / full_scale_electrons_, 0.0, 1.0), 1 / 2.2);
      frame.image(y, x) = static_cast<std::uint8_t>(std::lround(255 * value));
    }
  }
  ++count_;
  return frame;
}

}  // namespace devo::sim
