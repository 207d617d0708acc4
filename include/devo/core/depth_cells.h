// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace devo {

/// A depth image by cells of its undistorted pixels, row-major, in the depth camera's frame.
struct DepthCells {
  struct Cell {
    Eigen::Vector3f p = Eigen::Vector3f::Zero();  ///< mean of its readings, m; z 0: too few, or of several surfaces
    Eigen::Vector3f n = Eigen::Vector3f::Zero();  ///< unit normal of the surface, towards the camera; 0: unknown
    float bend_m = 0;         ///< by how far it lies off a plane through the cells beside it; where the normal is known
    std::int16_t thing = -1;  ///< which thing it is on (FindThings); -1: none
  };
  std::vector<Cell> cells;
  int columns = 0;
  int things = 0;      ///< how many there are
  float median_m = 0;  ///< depth of the cells; 0: none has one
};

/// Readings of one cell, or neighbouring cells, farther apart than this are of several surfaces; m.
inline float SurfaceGap(float z_m) { return 0.06F * z_m + 0.01F; }

/// Whether neighbouring cells, the first of which has depth, may be of one surface.
inline bool HangTogether(const DepthCells::Cell& cell, const DepthCells::Cell& beside) {
  return beside.p.z() > 0 && std::abs(beside.p.z() - cell.p.z()) < SurfaceGap(cell.p.z());
}

}  // namespace devo
