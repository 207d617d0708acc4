// SPDX-License-Identifier: BSD-3-Clause
//
// How high an image of accumulated events must be for a crest to be one of the scene. Where edges are faint, single
// events of the background, which lie everywhere, would reach as high: any pose then finds a crest near each point.
#pragma once

#include <opencv2/core/mat.hpp>

namespace devo {

/// The value below which a share `quantile` of the non-zero pixels lies (every fourth row is looked at) of an image
/// that was blurred by `blur_px`, values below 4096. A higher one where more than a twentieth of what lies above would
/// be made by `noise_per_pixel` events (mean, 0: none) of weight kEventWeight at random places; a twentieth of the
/// pixels are left above it in any case. A multiple of 8.
int CrestThreshold(const cv::Mat1w& blurred, double quantile, double noise_per_pixel, double blur_px);

}  // namespace devo
