// SPDX-License-Identifier: BSD-3-Clause
//
// Which neighbouring returns of a LiDAR's turn lie on one surface: between them depth may be interpolated.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "devo/core/lidar_sweep.h"

namespace devo {

using Triangle = std::array<std::int32_t, 3>;  ///< indices of points

struct SweepMesh {
  std::vector<Triangle> triangles;
  std::vector<Triangle> gaps;  ///< between neighbours of two surfaces: what lies there was not measured
  double spacing_rad = 0;      ///< median angle between neighbours within a ring, 0 unknown
};

/// Triangles between neighbouring rings, and none across a jump of the range: two neighbours are connected when their
/// ranges are about equal, or when one continues the plane that the other shows with its neighbour on the far side (a
/// floor at a grazing angle jumps from ring to ring, but regularly: inverse range is linear along a plane).
/// Neighbours that a jump separates have a gap between them; where a return is missing there is neither. Points without
/// a ring stay alone.
SweepMesh ConnectRings(const std::vector<LidarPoint>& points);

}  // namespace devo
