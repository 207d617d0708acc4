// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/event.h"
#include "devo/core/surface.h"

namespace devo {

/// The paper's surface (eq. 1): exp(-age / tau) of the last event that each pixel of the undistorted image shows.
class PlainSurface {
 public:
  /// `tau_s`: decay; `delta`: threshold of the semi-dense region, 0 to 1.
  PlainSurface(const Camera& camera, double tau_s, double delta);

  /// Events must lie in the image and come in the order of their time.
  void Add(const Event& event) {
    if (event.t_ns >= next_forgetting_ns_) ForgetLongAgo(event.t_ns);
    last_ticks_[static_cast<std::size_t>(event.y) * camera_.width() + event.x] = TicksAt(event.t_ns);
  }

  void Reset();

  /// Fills image, edges, window_s and events_used (pixels that are not yet dark) for the time surface->t_ns, which is
  /// not before the last event. The image must have the size of the undistorted one.
  void Render(Surface* surface);

 private:
  std::uint32_t TicksAt(std::int64_t t_ns) const { return static_cast<std::uint32_t>(t_ns >> tick_shift_); }
  void PrepareSources();
  void ForgetLongAgo(std::int64_t t_ns);
  const std::uint32_t* TicksOfRow(int y);
  void AppendEdges(int y, const std::uint8_t* values, std::vector<EdgePoint>* edges) const;

  Camera camera_, undistorted_;
  double tau_s_, delta_;
  int tick_shift_ = 0;  // a tick is 2^tick_shift_ nanoseconds: one, unless tau is long
  std::int32_t max_age_ticks_ = 0;
  std::int64_t forgot_ns_ = 0, next_forgetting_ns_ = 0;
  std::vector<std::uint32_t> last_ticks_;  // per raw pixel, wrapping; one more at the end where never is an event
  cv::Mat1i source_;                       // raw pixel that each undistorted one shows; empty when it is the same
  std::vector<std::uint32_t> row_ticks_;
  std::array<float, 256> strength_;  // of an edge of each value
};

}  // namespace devo
