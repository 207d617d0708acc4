// SPDX-License-Identifier: BSD-3-Clause
//
// Where the map has nothing and no depth was measured (a view that turned beyond the last depth image, a hall that is
// longer than the depth camera sees), edges hold the camera's turn all the same, and its path once views from elsewhere
// tell how far they are. Until then their depth is that of what is seen around them.
#pragma once

#include <vector>

#include "devo/core/camera.h"
#include "devo/core/reference_map.h"

namespace devo {

/// Of one view. Not thread-safe.
class DepthGuess {
 public:
  /// `visible`: points of the map in the view; `camera`: of the undistorted event image.
  DepthGuess(const std::vector<ReferenceMap::Visible>& visible, const Camera& camera);

  /// Whether there are points of the map around the pixel.
  bool IsKnown(float x, float y) const { return cells_[CellOf(x, y)].points > 0; }

  /// Metres along the optical axis at a pixel: mean of the inverse depths of all cells with points, the nearest first
  /// (by their inverse cubed distance). 0: there are none.
  float At(float x, float y);

 private:
  struct Cell {
    int points = 0;
    float sum_of_inverse_depths = 0;
    float guess_m = -1;  // not made yet
  };

  std::size_t CellOf(float x, float y) const;

  int columns_;
  std::vector<Cell> cells_;
};

}  // namespace devo
