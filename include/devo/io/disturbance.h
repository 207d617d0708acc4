// SPDX-License-Identifier: BSD-3-Clause
//
// Takes things away from a recording, or adds noise to it, to see what the odometry makes of it: events that were lost,
// pixels that fire by themselves, lamps, spans without events or depth, depth images that come late, an inertial sensor
// that is shaken.
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "devo/core/event.h"
#include "devo/core/imu.h"
#include "devo/io/lamp_events.h"
#include "devo/io/miscalibration.h"

namespace devo {

struct DisturbanceOptions {
  struct Span {
    double begin_s, end_s;  ///< from the first event
  };
  std::vector<Span> event_gaps, depth_gaps;
  double event_loss = 0;       ///< share of the events that are lost at random, 0 to 1
  double hot_pixel_share = 0;  ///< share of the pixels that fire by themselves, 100 times a second on average, 0 to 1
  LampOptions lamps;
  double gyroscope_noise_deg_s = 0;     ///< standard deviation that each reading has more, per axis
  double accelerometer_noise_m_s2 = 0;  ///< the same
  double depth_latency_s = 0;           ///< from a depth image's time to its arrival among the events
  Miscalibration miscalibration;

  bool any() const {
    return !event_gaps.empty() || !depth_gaps.empty() || event_loss > 0 || hot_pixel_share > 0 || lamps.any() ||
           depth_latency_s > 0 || gyroscope_noise_deg_s > 0 || accelerometer_noise_m_s2 > 0;
  }

  /// Adds `event_gap=FROM:TO`, `depth_gap=FROM:TO`, `depth_latency=SECONDS`, `event_loss=SHARE`, `hot_pixels=SHARE`,
  /// `flicker=SHARE`, `light=AT:FACTOR`, `imu_noise=DEG_S:M_S2` or what Miscalibration::Add takes.
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

  /// The sample with the noise. Calls go on in time.
  ImuSample Apply(ImuSample sample);

  /// Whether a depth image of this time is lost. Before the first event none is.
  bool LosesDepth(std::int64_t t_ns) const;

 private:
  static bool In(const std::vector<DisturbanceOptions::Span>& spans, double t_s);
  static double Uniform(std::mt19937* random) {
    return static_cast<double>((*random)()) / 4294967296.0;  // the same with every standard library
  }
  double Uniform() { return Uniform(&random_); }
  double Normal();
  Event NextHotEvent();
  void AddEventsUntil(std::int64_t t_ns);

  DisturbanceOptions options_;
  std::mt19937 random_{1}, imu_random_{2};  // of events and of the inertial sensor: they come in any order
  std::vector<std::uint32_t> hot_pixels_;   // y * width + x
  int width_, height_;
  std::optional<LampEvents> lamps_;
  std::vector<Event> added_, out_;
  std::int64_t begin_ns_ = -1;
  Event hot_;  // the next of the hot pixels' events
};

}  // namespace devo
