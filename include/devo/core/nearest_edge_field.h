// SPDX-License-Identifier: BSD-3-Clause
//
// The field that alignment looks its residuals up in: which edge is nearest to a pixel.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/surface.h"

namespace devo {

/// Nearest edge of every pixel within a square of +-`radius_px` (at most 30) around it, packed as Surface::nearest_edge
/// says. `nearest` must have the image's size; of more than Surface::kMaxEdges edges the rest is left out.
void BuildNearestEdgeField(const std::vector<EdgePoint>& edges, double radius_px, cv::Mat1i* nearest);

}  // namespace devo
