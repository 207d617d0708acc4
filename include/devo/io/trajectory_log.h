// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "devo/io/trajectory.h"

namespace devo {

/// The newest poses of a run that may last for hours: 36 bytes each, in few large blocks, so that they do not cut up
/// the memory about them. Stamps are kept exactly, positions to 5e-9 m, quaternions to 2.5e-10: finer than TumLine
/// writes. Not thread-safe.
class TrajectoryLog {
 public:
  /// Beyond `max_poses`, at least one, the oldest are forgotten.
  explicit TrajectoryLog(std::size_t max_poses) : max_poses_(max_poses) {}

  /// `pose` is finite.
  void Add(const StampedPose& pose);

  /// Oldest first, in the order in which they were added.
  Trajectory Poses() const;

  std::size_t size() const { return size_; }
  void Clear();

 private:
  struct Record {
    std::int32_t seconds;
    std::uint32_t nanoseconds;
    std::array<std::int32_t, 3> position;  // from the block's origin
    std::array<std::int32_t, 4> rotation;
  };
  struct Block {
    std::int64_t begin_ns;  // the seconds of its records count from here
    Eigen::Vector3d origin;
    std::vector<Record> records;
  };

  std::size_t max_poses_;
  std::deque<Block> blocks_;
  std::size_t size_ = 0;
  std::size_t forgotten_of_first_ = 0;  // records of the first block that do not count any more
};

}  // namespace devo
