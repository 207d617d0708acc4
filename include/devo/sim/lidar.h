// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "devo/sim/ray_tracer.h"
#include "devo/sim/thread_pool.h"
#include "devo/sim/trajectory.h"

namespace devo::sim {

/// A spinning LiDAR; defaults: Velodyne VLP-16 (user manual 63-9243: 16 beams from -15 to 15 deg, 55.296 us between
/// firings, 2.304 us between beams, +-3 cm). Its frame is x forward, y left, z up (REP-103).
struct LidarModel {
  Rigid3 T_event_lidar = Rigid3(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5).inverse(), {0.0, -0.09, -0.02});
  double rate_hz = 10;
  int beams = 16;
  double lowest_deg = -15, highest_deg = 15;
  double firing_s = 55.296e-6, beam_s = 2.304e-6;
  double noise_m = 0.012;
  double min_range_m = 0.5, max_range_m = 100;
};

struct LidarPoint {
  float x, y, z;       ///< metres, in the LiDAR's frame at the point's own time (a moving LiDAR's scan is distorted)
  float intensity;     ///< reflectance, 0..255
  std::uint16_t ring;  ///< beam, 0 is the lowest
  float time_s;        ///< after the scan's begin
};

/// One turn; stamped with its begin.
struct LidarScan {
  std::int64_t t_ns = 0;
  std::vector<LidarPoint> points;
};

class Lidar {
 public:
  Lidar(const Scene& scene, const LidarModel& model, std::uint64_t seed) : scene_(scene), model_(model), seed_(seed) {}
  const LidarModel& model() const { return model_; }
  /// The turn that begins at `t_s` of the trajectory; t_ns is not set.
  LidarScan Capture(const Trajectory& trajectory, double t_s, std::uint64_t index, ThreadPool* pool) const;

 private:
  const Scene& scene_;
  LidarModel model_;
  std::uint64_t seed_;
};

}  // namespace devo::sim
