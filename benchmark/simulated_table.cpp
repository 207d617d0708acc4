// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_table.h"

#include <algorithm>
#include <iterator>

#include "devo/core/time.h"
#include "devo/sim/sequence.h"

namespace devo {
namespace {

double MedianDepth(const cv::Mat1f& depth_m) {
  std::vector<float> valid;
  std::copy_if(depth_m.begin(), depth_m.end(), std::back_inserter(valid), [](float depth) { return depth > 0; });
  if (valid.empty()) return 0;
  const auto middle = valid.begin() + static_cast<std::ptrdiff_t>(valid.size() / 2);
  std::nth_element(valid.begin(), middle, valid.end());
  return *middle;
}

}  // namespace

SimulatedTable::SimulatedTable(double seconds) {
  sim::SequenceOptions options;
  options.duration_s = seconds;
  options.rest_s = 0.05;
  options.depth = sim::SequenceOptions::Depth::kRegistered;
  options.frames = options.imu = false;
  sim::Sequence sequence(options);
  camera_ = sequence.rig().event_camera;
  sim::Chunk chunk;
  while (sequence.Next(&chunk)) {
    for (const DepthImage& depth : chunk.depth) {
      if (SecondsFromNs(depth.t_ns - sequence.begin_ns()) < 0.5 * seconds) median_m_ = MedianDepth(depth.depth_m);
    }
    Vector6d velocity = Vector6d::Zero();
    if (chunk.poses.size() >= 2) {
      const sim::TimedPose &a = chunk.poses.front(), &b = chunk.poses.back();
      velocity = Log(a.T_world_event.inverse() * b.T_world_event) / SecondsFromNs(b.t_ns - a.t_ns);
    }
    periods_.push_back({chunk.end_ns, chunk.events, velocity});
  }
}

SceneDepth SimulatedTable::scene_depth() const {
  SceneDepth depth;
  depth.median_m = median_m_;
  return depth;
}

}  // namespace devo
