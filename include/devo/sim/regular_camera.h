// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"
#include "devo/sim/frame_sensor.h"
#include "devo/sim/ray_tracer.h"
#include "devo/sim/thread_pool.h"
#include "devo/sim/trajectory.h"

namespace devo::sim {

struct RegularCameraModel {
  Camera camera;
  Rigid3 T_event_camera;
  double rate_hz = 30;
};

/// VECtor's left regular camera: 1224x1024, lens and place as published.
RegularCameraModel VectorRegularCamera();

/// A global-shutter frame camera beside the event camera. Blur is the mean of views that are at most some two pixels
/// apart; exposure, gain and noise are FrameSensor's.
class RegularCamera {
 public:
  RegularCamera(const Scene& scene, const RegularCameraModel& model, const Light& light, std::uint64_t seed);

  /// The frame whose exposure begins at `begin_s` of the trajectory, which is `begin_ns` in stamps.
  Frame Capture(const Trajectory& trajectory, double begin_s, std::int64_t begin_ns, ThreadPool* pool);
  double exposure_s() const { return sensor_.exposure_s(); }
  const RegularCameraModel& model() const { return model_; }

 private:
  int ViewsFor(const Vector6d& twist) const;

  const Scene& scene_;
  RegularCameraModel model_;
  RayGrid rays_;
  FrameSensor sensor_;
};

}  // namespace devo::sim
