// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "devo/core/background_noise.h"
#include "devo/core/event.h"
#include "devo/core/flicker_detector.h"
#include "devo/core/needed_neighbours.h"
#include "devo/core/pixel_memory.h"

namespace devo {

/// Tells signal from noise, one event at a time. Background activity (thermal noise, leak) comes alone: an
/// event passes when enough of its eight neighbours fired shortly before it (Delbruck, "Frame-free dynamic
/// digital vision", 2008). A hot pixel fires at a rate that its neighbours do not share. Where a lamp flickers, an area
/// fires as one, over and over; it is left out like hot pixels, from half a second on. Not thread-safe.
class NoiseFilter {
 public:
  /// `window_s`: how recent a neighbour must be; `min_neighbours`: 0 lets every event pass, else it is raised by one
  /// where noise is so dense that it often has neighbours by chance. Where it is denser still (from 6 Hz per pixel
  /// with a window of 10 ms), they must have been of the event's polarity within a shorter window, such that not more
  /// than 0.5 Hz pass. `hot_factor`: a pixel this many times as active as its neighbours is hot, 0: none is.
  NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor);

  /// Writes the positions (0 to events.size - 1, rising) of those events that are signal to `passed`, which has room
  /// for all, and returns how many there are. Events must lie in the image and come in the order of their time; where a
  /// stream is cut into spans makes no difference.
  std::size_t Pass(EventSpan events, std::uint32_t* passed);

  /// The same for one event.
  bool Pass(const Event& event) {
    std::uint32_t position = 0;
    return Pass(EventSpan(&event, 1), &position) > 0;
  }

  /// Other criteria from the next event on, as in the constructor; what was learnt of noise and hot pixels stays.
  void SetCriteria(double window_s, int min_neighbours, double hot_factor);

  void Reset();
  int hot_pixels() const { return static_cast<int>(hot_.size()); }

  /// Background events per pixel and second, from the quietest parts of the image in the last quarter of a second.
  double noise_hz() const { return noise_.hz(); }

  /// Whether it has been measured: for the first 50 ms it has not.
  bool knows_noise() const { return knows_noise_; }

  /// Whether neighbours must have been of the same polarity, too; more of it passed before it was known.
  bool noise_is_very_dense() const { return needed_.same_polarity; }

  /// How many per pixel and second pass, were all of the image as quiet as these parts.
  double passing_noise_hz() const { return PassingHz(needed_, noise_.hz(), noise_.on_share()); }

  /// The same, noise being as it is in each part: where the light differs, so does noise, and of two parts with as many
  /// events together as two that are alike more pass. While the camera moves, as passing_noise_hz.
  double mean_passing_noise_hz() const { return mean_passing_noise_hz_; }

 private:
  void Update(std::int64_t t_ns);
  void SetNeeded();

  NeededNeighbours asked_, needed_;
  double hot_factor_;
  PixelMemory memory_;
  BackgroundNoise noise_;
  FlickerDetector flicker_;
  std::vector<std::uint32_t> hot_;  // positions in memory_
  std::int64_t next_update_ns_ = 0, counted_since_ns_ = 0;
  double mean_passing_noise_hz_ = 0;
  bool knows_noise_ = false;
};

}  // namespace devo
