// SPDX-License-Identifier: BSD-3-Clause
//
// Events as a sensor makes them of a scene: the simulator's `table` at medium speed, 640x480, sensor noise included.
#pragma once

#include <cstdint>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/event.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

class SimulatedTable {
 public:
  struct Period {
    std::int64_t end_ns;
    std::vector<Event> events;
    Vector6d velocity_event;  ///< the true one at its end
  };

  /// Simulates `seconds`, the first of a motion. Takes several times as long.
  explicit SimulatedTable(double seconds);

  const Camera& camera() const { return camera_; }
  const std::vector<Period>& periods() const { return periods_; }  ///< of 10 ms
  SceneDepth scene_depth() const;                                  ///< the median of a depth image from the middle

 private:
  Camera camera_;
  std::vector<Period> periods_;
  double median_m_ = 0;
};

}  // namespace devo
