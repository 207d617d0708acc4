// SPDX-License-Identifier: BSD-3-Clause
//
// Events that lamps make, whatever the camera does: one that flickers with the mains, one that is switched on or off.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "devo/core/event.h"

namespace devo {

/// Times in seconds from the first event.
struct LampOptions {
  /// Of the image, 0 to 1: a disc that a lamp lights that flickers at 100 Hz, each pixel brighter and darker once each
  /// time (a modulation of about a quarter). It wanders through the image as the camera would turn.
  double flicker_share = 0;
  struct Switch {
    double at_s;
    double factor;  ///< times as bright everywhere from then on; below 1: darker
  };
  std::vector<Switch> switches;

  bool any() const { return flicker_share > 0 || !switches.empty(); }
};

/// The same options give the same events. Not thread-safe.
class LampEvents {
 public:
  /// `width`, `height` of the image in pixels; `begin_ns`: time of the first event.
  LampEvents(const LampOptions& options, int width, int height, std::int64_t begin_ns);

  /// Adds those before `end_ns` that were not added yet, in the order of time.
  void AppendUntil(std::int64_t end_ns, std::vector<Event>* events);

 private:
  double Uniform() { return static_cast<double>(random_()) / 4294967296.0; }  // the same with every standard library
  void Add(double t_s, int x, int y, bool brighter);
  bool IsLit(int x, int y, double t_s) const;
  void AddFlicker();
  void AddSwitch(const LampOptions::Switch& at);

  LampOptions options_;
  int width_, height_;
  std::int64_t begin_ns_;
  std::int64_t next_period_ = 0;  // of the flicker
  std::size_t next_switch_ = 0;
  std::mt19937 random_{3};
  std::vector<Event> upcoming_;  // in the order of time
};

}  // namespace devo
