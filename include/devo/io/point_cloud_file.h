// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "devo/core/local_map.h"

namespace devo {

/// Writes a cloud for pcl_viewer, CloudCompare and the like: position, normal, sigma_px and reference of each point.
/// The file's ending decides: .pcd (binary, version 0.7) or .ply (binary, little-endian). Throws std::runtime_error
/// naming the file: another ending, or not writable.
void WritePointCloud(const std::string& path, const std::vector<MapPoint>& points);

}  // namespace devo
