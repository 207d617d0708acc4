// SPDX-License-Identifier: BSD-3-Clause
//
// Crests of an image of accumulated events: the thin, sub-pixel edges that mapping and tracking use in place
// of the paper's thresholded region (Steger, "An unbiased detector of curvilinear structures", PAMI 1998).
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/surface.h"

namespace devo {

/// Fixed-point weight of one event in accumulated images.
constexpr int kEventWeight = 64;

/// ON minus OFF events per pixel, held at the ends of their range.
using SignedCounts = cv::Mat_<std::int8_t>;

/// Blurs with a 5-tap binomial-like kernel of standard deviation `sigma_px` (at most 1.2), values below 4096.
/// `out` gets the size of `in`; the outermost two pixels are 0.
void Blur(const cv::Mat1w& in, double sigma_px, cv::Mat1w* scratch, cv::Mat1w* out);

/// The value below which a share `quantile` of the non-zero pixels lies (every fourth row is looked at).
int OccupiedQuantile(const cv::Mat1w& image, double quantile);

/// Ridge points of `blurred` above `threshold`: the second derivative across the ridge is negative and its
/// extremum lies within 0.6 px of the pixel. `signed_events` (not blurred) gives the polarity and
/// may be empty. Strength is in events per pixel. At most Surface::kMaxEdges are returned.
/// `clear_only`: those that stand out from both their sides.
void FindCrests(const cv::Mat1w& blurred, const SignedCounts& signed_events, int threshold,
                std::vector<EdgePoint>* crests, bool clear_only = true);

}  // namespace devo
