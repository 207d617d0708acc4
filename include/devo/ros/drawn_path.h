// SPDX-License-Identifier: BSD-3-Clause
//
// A path to look at, which stays small however long the way and the rest on it are.
#pragma once

#include <optional>

#include <nav_msgs/Path.h>

#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class DrawnPath {
 public:
  /// Poses are this far apart, or 0.02 rad.
  explicit DrawnPath(double min_distance_m) : min_distance_m_(min_distance_m) {}

  /// `header` has the frame of all poses. Returns false for a pose that is left out, as it is too near to the last.
  bool Extend(const std_msgs::Header& header, const Rigid3& T_odom_body);
  void Clear();

  const nav_msgs::Path& message() const { return path_; }

 private:
  double min_distance_m_;
  nav_msgs::Path path_;
  std::optional<Rigid3> T_odom_last_;
};

}  // namespace devo
