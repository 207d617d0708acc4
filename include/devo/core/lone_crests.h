// SPDX-License-Identifier: BSD-3-Clause
//
// Events of noise that chance brings together make crests of a few pixels, which stay in the image for as long as
// their events do: to the alignment, a camera that does not move. Edges go on.
#pragma once

#include <vector>

#include <opencv2/core/types.hpp>

#include "devo/core/surface.h"

namespace devo {

constexpr int kLeastCrestsTogether = 9;

/// Drops crests (px, in an image of this size) that with all that touch each other, pixel by pixel, are fewer than
/// that. Keeps the order of the others. One beyond the image's border is dropped.
void DropLoneCrests(cv::Size image, std::vector<EdgePoint>* crests);

}  // namespace devo
