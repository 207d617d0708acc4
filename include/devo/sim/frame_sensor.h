// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "devo/core/camera.h"
#include "devo/sim/sensors.h"

namespace devo::sim {

/// A frame of the event camera's pixels (mono, gamma 2.2), stamped at the middle of its exposure.
struct Frame {
  std::int64_t t_ns = 0;
  cv::Mat1b image;
};

/// Integrates the light that the event camera sees into frames with motion blur, shot noise and read noise. Exposure
/// and gain follow the light level as an auto exposure would set them: 8 ms in bright light, up to 25 ms, then gain.
class FrameSensor {
 public:
  FrameSensor(const Light& light, int stride, const Camera& camera, std::uint64_t seed);

  /// Sets the rate and the begin of the first exposure; without it no frame is taken.
  void Start(std::int64_t t_ns, double rate_hz);
  double exposure_s() const { return exposure_s_; }

  /// `to` or, if earlier, the next begin or end of an exposure after `from`: steps so bounded are exposed whole or not.
  std::int64_t BoundStep(std::int64_t from_ns, std::int64_t to_ns) const;
  /// 1 if the (bounded) step is exposed, else 0.
  float ExposedShare(std::int64_t from_ns, std::int64_t to_ns) const;
  /// Adds a step's light (reflected lux at its begin and end) to a row. Rows are independent.
  void ExposeRow(int row, float exposed_s, const float* luminance_begin, const float* luminance_end);
  /// If the exposure ended at or before `now`, reads the frame out.
  void TakeFinished(std::int64_t now_ns, std::vector<Frame>* frames);

 private:
  Frame ReadOut();

  Camera camera_;
  int stride_;
  std::uint64_t seed_, count_ = 0;
  double exposure_s_, electrons_per_lux_s_, full_scale_electrons_;
  std::int64_t period_ns_ = 0, exposure_begin_ns_, exposure_ns_;
  std::vector<float> exposure_lux_s_;
};

}  // namespace devo::sim
