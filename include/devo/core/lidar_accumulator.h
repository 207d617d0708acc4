// SPDX-License-Identifier: BSD-3-Clause
//
// Makes of a LiDAR what the mapper expects of a depth camera: a depth image in the event camera's view. One turn of a
// LiDAR is sparse, but while the rig moves its rings fall elsewhere: the turns of a window, moved to one time, are
// dense.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/core/lidar_sweep.h"
#include "devo/core/options.h"
#include "devo/core/pose_history.h"
#include "devo/core/rigid3.h"
#include "devo/core/sweep_mesh.h"

namespace devo {

/// Not thread-safe.
class LidarAccumulator {
 public:
  /// `camera`: of the undistorted event image. `T_event_lidar`: the LiDAR's pose in the event camera's frame.
  LidarAccumulator(const Camera& camera, const Rigid3& T_event_lidar, const MappingOptions& options);

  /// Mean time of the points that lie in the event camera's view; empty where none does. A sweep of a tenth of a second
  /// passes the view in a fraction of it.
  std::optional<std::int64_t> TimeInView(const LidarSweep& sweep) const;

  /// Adds a sweep, each point moved by the pose (of the event camera) of its own time; points of times that `poses`
  /// does not hold are left out. Sweeps that ended more than mapping.lidar_window_s before this one are forgotten.
  void Add(const LidarSweep& sweep, const PoseHistory& poses);

  /// Before there are poses: this sweep alone, as if the camera had stood still at `T_world_event` during it. Forgotten
  /// at the first Add.
  void Start(const LidarSweep& sweep, const Rigid3& T_world_event);

  /// The accumulated points as the event camera sees them from `T_world_event`: in the undistorted image, 0 where
  /// nothing is known. Between neighbouring returns on one surface depth is interpolated (inverse depth is linear in
  /// the image on a plane), single returns are as large as their spacing; what lies behind something nearer is hidden,
  /// and of several sweeps on the nearest surface the inverse depths are averaged. In a gap between a surface and what
  /// lies behind it, where no sweep measured, the foreground goes on: an edge there is most likely its silhouette.
  DepthImage Render(std::int64_t t_ns, const Rigid3& T_world_event);

  void Clear() { sweeps_.clear(); }

  /// From the next sweep on.
  void SetOptions(const MappingOptions& options) { options_ = options; }

 private:
  struct Sweep {
    std::int64_t end_ns = 0;
    Rigid3 T_world_anchor;                  // the event camera at the sweep's end
    std::vector<Eigen::Vector3f> p_anchor;  // what was in front of the camera
    std::vector<Triangle> triangles, gaps;
    float spacing_rad = 0;
  };
  struct Projected {
    float u, v, inverse_depth;  // inverse_depth 0: behind the camera
  };

  /// `moved[i]`: point i in the anchor's frame, NaN where its pose is not known.
  void Append(const LidarSweep& sweep, const Rigid3& T_world_anchor, const std::vector<Eigen::Vector3f>& moved);
  void Project(const Sweep& sweep, const Rigid3& T_world_event, std::vector<Projected>* projected) const;
  template <typename Visit>
  void VisitTriangle(const Projected& a, const Projected& b, const Projected& c, Visit&& visit) const;
  template <typename Visit>
  void VisitPixels(const Sweep& sweep, const std::vector<Projected>& projected, Visit&& visit) const;
  void ContinueForeground(DepthImage* depth) const;

  Camera camera_;
  Rigid3 T_event_lidar_;
  MappingOptions options_;
  bool started_without_poses_ = false;
  std::deque<Sweep> sweeps_;
  std::vector<std::vector<Projected>> projected_;  // of each sweep
  cv::Mat1f nearest_, sum_, count_;
};

}  // namespace devo
