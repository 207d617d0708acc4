// SPDX-License-Identifier: BSD-3-Clause
//
// Lamps that flicker with the mains: all that they light gets brighter and darker again, 100 or 120 times a second,
// wherever in the image it comes to lie.
#pragma once

#include <algorithm>
#include <array>

#include "devo/core/event.h"
#include "devo/core/flicker_scale.h"

namespace devo {

/// Tells their events from those of motion. Not thread-safe.
class FlickerBursts {
 public:
  /// Of the image in pixels. A lamp's cone shows in small areas of which all fires; where more fires than the sensor
  /// can read, parts of the image come one after the other: less of larger areas.
  FlickerBursts(int width, int height)
      : scales_{FlickerScale(width, height, 4, 0.4), FlickerScale(width, height, 6, 0.2)} {}

  /// As of each scale.
  void Look(EventSpan events) {
    for (FlickerScale& scale : scales_) scale.Look(events);
  }
  bool found() const {
    return std::any_of(scales_.begin(), scales_.end(), [](const FlickerScale& scale) { return scale.found(); });
  }
  bool IsOfLamp(const Event& event) const {
    return std::any_of(scales_.begin(), scales_.end(),
                       [&](const FlickerScale& scale) { return scale.IsOfLamp(event); });
  }
  void Clear() {
    for (FlickerScale& scale : scales_) scale.Clear();
  }

 private:
  std::array<FlickerScale, 2> scales_;
};

}  // namespace devo
