// SPDX-License-Identifier: BSD-3-Clause
//
// Where a depth image was taken by a camera that is lost: alignments from many starts, most of which are wrong.
#pragma once

#include <optional>
#include <vector>

#include "devo/core/depth_alignment.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Starts (T_ref_depth) around one whose position has this standard deviation and whose rotation is known to a few
/// degrees, so dense that from one of them at least an alignment finds its way; up to 0.6 m off.
std::vector<Rigid3> ShiftedStarts(const Rigid3& T_ref_depth, double sigma_m);

/// Starts around the reference's own place, turned by up to half a radian about each axis and shifted a little.
std::vector<Rigid3> TurnedStarts();

/// T_ref_depth to a few centimetres and hundredths of a radian. Empty where few starts lead to the place that fits
/// best, where that fits badly, or another about as well. 10 to 40 us for each start.
std::optional<Rigid3> SearchPlace(const DepthAligner& aligner, const DepthCells& ref, const DepthCells& now,
                                  const std::vector<Rigid3>& T_ref_starts);

}  // namespace devo
