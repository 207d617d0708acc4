// SPDX-License-Identifier: BSD-3-Clause
//
// Takes things away from a recording, or adds noise to it, to see what the odometry makes of it: events that were lost,
// pixels that fire by themselves, spans without events or depth, depth images that come late.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "devo/core/event.h"
#include "devo/io/miscalibration.h"

namespace devo {

struct DisturbanceOptions {
  struct Span {
    double begin_s, end_s;  ///< from the first event
  };
  std::vector<Span> event_gaps, depth_gaps;
  double event_loss = 0;       ///< share of the events that are lost at random, 0 to 1
  double hot_pixel_share = 0;  ///< share of the pixels that fire by themselves, 100 times a second on average, 0 to 1
  double depth_latency_s = 0;  ///< from a depth image's time to its arrival among the events
  Miscalibration miscalibration;

  bool any() const {
    return !event_gaps.empty() || !depth_gaps.empty() || event_loss > 0 || hot_pixel_share > 0 || depth_latency_s > 0;
  }

  /// Adds `event_gap=FROM:TO`, `depth_gap=FROM:TO`, `depth_latency=SECONDS`, `event_loss=SHARE`, `hot_pixels=SHARE` or
  /// what Miscalibration::Add takes.
  /// Throws std::invalid_argument naming the text and what was expected.
  void Add(const std::string& text);
};

/// The same input and options give the same output. Not thread-safe.
class Disturbance {
 public:
  /// `width`, `height` of the event camera in pixels.
  Disturbance(const DisturbanceOptions& options, int width, int height);

  /// What is left of `events`, with the noise, in the order of time; valid until the next call. Calls go on in time.
  EventSpan Apply(EventSpan events);

  /// Whether a depth image of this time is lost. Before the first event none is.
  bool LosesDepth(std::int64_t t_ns) const;

 private:
  static bool In(const std::vector<DisturbanceOptions::Span>& spans, double t_s);
  double Uniform() { return static_cast<double>(random_()) / 4294967296.0; }  // the same with every standard library
  Event NextHotEvent();

  DisturbanceOptions options_;
  std::mt19937 random_{1};
  std::vector<std::uint32_t> hot_pixels_;  // y * width + x
  std::uint32_t width_;
  std::vector<Event> out_;
  std::int64_t begin_ns_ = -1;
  Event hot_;  // the next of the hot pixels' events
};

}  // namespace devo
