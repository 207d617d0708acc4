// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace devo {

/// One return of a LiDAR.
struct LidarPoint {
  Eigen::Vector3f p_lidar = Eigen::Vector3f::Zero();  ///< metres, in the LiDAR's frame at the point's own time
  int ring = -1;                                      ///< beam that measured it; -1: unknown
  std::int64_t t_ns = 0;                              ///< when it was measured, on the event camera's clock
};

/// What a LiDAR sends as one message: one turn of a spinning one. While it turns the LiDAR moves, so its points belong
/// together only once each has been moved by the pose of its own time.
struct LidarSweep {
  std::int64_t end_ns = 0;  ///< time of the last point
  std::vector<LidarPoint> points;
};

}  // namespace devo
