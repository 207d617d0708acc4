// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/sim/ray_tracer.h"
#include "devo/sim/thread_pool.h"
#include "devo/sim/trajectory.h"

namespace devo::sim {

/// A time-of-flight depth camera. Model and sources: docs/simulation.md.
struct DepthModel {
  Camera camera;
  Rigid3 T_event_depth;
  double rate_hz = 30;
  double exposure_s = 0.0128;
  double time_offset_s = 0;  ///< stamps are late by this much
  bool exact = false;        ///< distance at the pixel's centre at the exposure's middle, nothing else

  double noise_floor_m = 0.0005;  ///< range noise: sqrt(floor^2 + gain^2 / signal), signal = rho cos / z^2 (1/m^2)
  double noise_gain_m = 0.00066;
  double systematic_m = 0.001;  ///< amplitude of the periodic range error
  double min_range_m = 0.25;
  double max_range_m = 5.5;
  double min_signal = 0.01;    ///< a target of 15 % reflectance at 3.86 m, the data sheet's range
  double min_coherence = 0.5;  ///< readings of pixels that see two distances are rejected below
  double multipath = 0;        ///< share of the distance to the surroundings added in corners; 0: none
  bool corner_mask = true;     ///< the illuminated field is cut at the image's corners

  /// Standard deviation of a reading (m).
  double NoiseSigma(double z_m, double reflectance, double cosine) const;
};

/// Azure Kinect, narrow field of view, unbinned (640x576, rational lens), 7 cm beside and above the event camera.
DepthModel AzureKinect();
/// Exact depth in the event camera's own (distorted) image.
DepthModel RegisteredDepth(const Camera& event_camera);

class DepthSensor {
 public:
  DepthSensor(const Scene& scene, const DepthModel& model, std::uint64_t seed);
  const DepthModel& model() const { return model_; }

  /// The image whose exposure's middle is `t_s` on the trajectory. `index` counts images and chooses the noise. The
  /// image's t_ns is not set.
  cv::Mat1f Capture(const Trajectory& trajectory, double t_s, std::uint64_t index, ThreadPool* pool) const;

 private:
  struct Reading;
  void MeasureBand(const std::vector<View>& views, int tile_row, std::uint64_t index, cv::Mat1f* depth) const;
  float Measure(const std::vector<Hit>& hits, int row, int column, std::uint64_t index) const;
  void AddMultipath(cv::Mat1f* depth) const;

  const Scene& scene_;
  DepthModel model_;
  std::uint64_t seed_;
  std::vector<std::unique_ptr<RayGrid>> rays_;  // one per part of the exposure, each a fraction of a pixel off
};

}  // namespace devo::sim
