// SPDX-License-Identifier: BSD-3-Clause
//
// Crests of an image of accumulated events: the thin, sub-pixel edges that mapping and tracking use in place
// of the paper's thresholded region (Steger, "An unbiased detector of curvilinear structures", PAMI 1998).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/surface.h"

namespace devo {

/// Fixed-point weight of one event in accumulated images.
constexpr int kEventWeight = 64;

/// ON minus OFF events per pixel, held at the ends of their range.
using SignedCounts = cv::Mat_<std::int8_t>;

/// Integer 5-tap kernel (c, b, a, b, c), as {a, b, c}, that sums to 16, of a standard deviation near `sigma_px` (at
/// most 1.2): its variance is (2 b + 8 c) / 16.
std::array<int, 3> BlurKernel(double sigma_px);

/// Blurs with that kernel in both directions, values below 4096. `out` gets the size of `in`; the outermost two pixels
/// are 0.
void Blur(const cv::Mat1w& in, double sigma_px, cv::Mat1w* scratch, cv::Mat1w* out);

/// Ridge points of `blurred` above `threshold`: the second derivative across the ridge is negative and its
/// extremum lies within 0.6 px of the pixel. `signed_events` (not blurred) gives the polarity and
/// may be empty. Strength is in events per pixel. At most Surface::kMaxEdges are returned.
/// `clear_only`: those that stand out from both their sides.
void FindCrests(const cv::Mat1w& blurred, const SignedCounts& signed_events, int threshold,
                std::vector<EdgePoint>* crests, bool clear_only = true);

}  // namespace devo
