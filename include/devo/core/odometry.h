// SPDX-License-Identifier: BSD-3-Clause
//
// The whole odometry on one page: events and depth in, poses and a map out, in data time.
// The offline runner calls this class; the three nodelets call its three parts from three queues.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/counters.h"
#include "devo/core/depth_image.h"
#include "devo/core/event.h"
#include "devo/core/imu.h"
#include "devo/core/lidar_sweep.h"
#include "devo/core/local_map.h"
#include "devo/core/options.h"
#include "devo/core/pose_estimate.h"
#include "devo/core/rig.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

class Odometry {
 public:
  /// With `threads` above 1, a surface is tracked while the next one is rendered, and depth is mapped beside both, on
  /// two threads of its own. The results are the same to the last bit. Throws std::invalid_argument when an option is
  /// out of range.
  Odometry(const Rig& rig, const OdometryOptions& options, int threads = 1);
  ~Odometry();

  /// Consecutive events, ordered in time. Every surface whose time has passed is rendered before the call returns. Its
  /// pose arrives through `on_pose`, on the caller's thread: before the call returns or, with threads, when the next
  /// surface is due. Throws std::runtime_error where they jump ahead by more than an hour: that is another clock, or a
  /// broken stamp, and all the surfaces in between would take for ever.
  void AddEvents(EventSpan events);

  /// A depth image; images come in the order of their time, each best before events that are later than it by more than
  /// one surface period (a reader that merges streams by stamp does that). One that comes later meets the surface and
  /// pose of its time, as long as that is at most 0.3 s ago.
  void AddDepth(const DepthImage& depth);

  /// A sweep of a LiDAR, of a rig with `depth_from_lidar`; in the order of their ends, each before events that are
  /// later than its end by more than a surface period.
  void AddSweep(LidarSweep sweep);

  /// An inertial sample, optional; sharpens the prediction. In the order
  /// of time, each before events that are later than it by more than a surface period.
  void AddImu(const ImuSample& sample);

  /// There are no more events: waits for what is under way and delivers it.
  void Finish();

  std::function<void(const PoseEstimate&, const Surface&)> on_pose;  ///< once per tracked pose
  std::function<void(const LocalMapPtr&)> on_local_map;              ///< once per new local map

  /// All map points of all references made of what was added so far, frame `world`.
  std::vector<MapPoint> GlobalMap() const;

  /// Milliseconds spent per surface, in order, for the report: all of them after Finish.
  struct Timings {
    std::vector<float> surface_ms, mapping_ms, tracking_ms;
  };
  const Timings& timings() const;

  /// Of depth, what mapping had done for the last map taken over: all of it after Finish.
  struct Counters {
    SurfaceCounters events;
    MappingCounters mapping;
  };
  Counters counters() const;

 private:
  void Step();
  void MapBeside(const SurfacePtr& surface);
  void TakePose();
  void TakeDepthPoses(std::size_t but_last);
  void TakeMaps(std::size_t but_last);

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace devo
