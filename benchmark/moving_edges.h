// SPDX-License-Identifier: BSD-3-Clause
//
// A cheap, endless event stream with exactly known motion, for measuring cost at any resolution and event rate:
// straight edges on a plane in front of a camera that moves sideways. Not for judging accuracy (devo_simulate is).
#pragma once

#include <cstdint>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/core/event.h"
#include "devo/core/rig.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

class MovingEdges {
 public:
  static constexpr double kDepth_m = 2.0;

  /// Edges enough to give `rate_hz` events per second at an image speed that grows with the root of the rate. The
  /// camera reaches that speed with constant acceleration from rest within `start_s`; 0: it moves from the beginning.
  MovingEdges(int width, int height, double rate_hz, double start_s = 0);

  /// Appends the events of the next `duration_s`, ordered in time. Edges that leave the image come in again
  /// on the other side.
  void Advance(double duration_s, std::vector<Event>* events);

  std::int64_t t_ns() const { return t_ns_; }
  const Camera& camera() const { return camera_; }
  /// [v; omega] of the event camera at full speed: sideways.
  Vector6d velocity_event() const;
  /// Way of the event camera up to a time, sideways.
  double WayAt_m(std::int64_t t_ns) const;
  SceneDepth scene_depth() const;

  /// Depth camera of 640x576 pixels, 7 cm beside the event camera.
  Rig rig() const;
  DepthImage depth_image() const;

 private:
  /// A piece of edge, one pixel long, that fires once per pixel that it moves across itself.
  struct Piece {
    double x, y;              // position at time 0
    double step_px, next_px;  // ways of the image at which it fires
    std::uint8_t polarity;
  };

  double WayAt_px(double t_s) const;
  double TimeOf_s(double way_px) const;

  Camera camera_;
  double speed_px_s_, start_s_;
  std::int64_t t_ns_ = 0;
  std::vector<Piece> pieces_;
};

}  // namespace devo
