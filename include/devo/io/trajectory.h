// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "devo/core/rigid3.h"

namespace devo {

struct StampedPose {
  std::int64_t t_ns = 0;
  Rigid3 T_world_body;
};

/// Poses in strictly increasing order of time.
using Trajectory = std::vector<StampedPose>;

/// One line of a TUM file: `t tx ty tz qx qy qz qw`, seconds with nine decimals (nothing of the stamp is lost),
/// metres with seven, the quaternion with nine and qw >= 0, so that equal poses give equal bytes.
std::string TumLine(const StampedPose& pose);

/// Reads a TUM file; `#` begins a comment; poses are sorted by time, repeated stamps keep the first. Throws
/// std::runtime_error naming the file, and the line where eight finite numbers with a non-zero quaternion were
/// expected.
Trajectory ReadTum(const std::string& path);

/// Throws std::runtime_error naming the file when it cannot be written.
void WriteTum(const std::string& path, const Trajectory& trajectory);

/// The file beside `path` for an epoch that is over before the run is: a/name.txt -> a/name_epoch2.txt.
std::string WithEpoch(const std::string& path, std::uint64_t epoch);

/// Sorts by time and drops repeated stamps (the first stays).
void SortByTime(Trajectory* trajectory);

/// Pose at `t_ns` on the screw motion between the two neighbours. Empty outside the trajectory and where the
/// neighbours are more than `max_gap_ns` apart.
std::optional<Rigid3> PoseAt(const Trajectory& trajectory, std::int64_t t_ns, std::int64_t max_gap_ns);

/// Length of the path in metres: sum of the distances of consecutive poses.
double PathLength(const Trajectory& trajectory);

}  // namespace devo
