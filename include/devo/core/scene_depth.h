// SPDX-License-Identifier: BSD-3-Clause
//
// How far the scene is in each part of a view, for moving events (surface_builder.h).
#pragma once

#include <cstdint>

#include <opencv2/core/mat.hpp>

#include "devo/core/surface.h"

namespace devo {

/// Median and coarse grid of a depth image's nearest readings (DepthRegistration::nearest_depth) in the event image;
/// holes are filled with the median. Unknown (median 0, no grid) with a handful of readings.
SceneDepth MakeSceneDepth(std::int64_t t_ns, const cv::Mat1f& nearest_depth_m);

}  // namespace devo
