// SPDX-License-Identifier: BSD-3-Clause
//
// How far the scene is in each part of a view, for moving events (surface_builder.h).
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/reference_map.h"
#include "devo/core/surface.h"

namespace devo {

/// Median and coarse grid of a depth image's nearest readings (DepthRegistration::nearest_depth) in the event image.
/// Holes have the mean of the map's points that lie in them, the median where these are fewer than three. With a
/// handful of readings the median is the one known before; where that is 0, too, all is unknown (median 0, no grid).
SceneDepth MakeSceneDepth(std::int64_t t_ns, const cv::Mat1f& nearest_depth_m,
                          const std::vector<ReferenceMap::Visible>& points = {}, double median_before_m = 0);

}  // namespace devo
