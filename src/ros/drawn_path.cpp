// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/drawn_path.h"

#include "devo/ros/conversions.h"

namespace devo {
namespace {

constexpr double kMinAngle_rad = 0.02;
constexpr std::size_t kMaxPoses = 8000;

}  // namespace

bool DrawnPath::Extend(const std_msgs::Header& header, const Rigid3& T_odom_body) {
  if (T_odom_last_) {
    const Rigid3 step = T_odom_last_->inverse() * T_odom_body;
    if (step.translation().norm() < min_distance_m_ && RotationAngle(step) < kMinAngle_rad) return false;
  }
  T_odom_last_ = T_odom_body;
  geometry_msgs::PoseStamped pose;
  pose.header = header;
  pose.pose = ToPoseMsg(T_odom_body);
  path_.header = header;
  path_.poses.push_back(pose);
  if (path_.poses.size() > kMaxPoses) {
    // A long way keeps its shape with every second pose.
    for (std::size_t i = 0; 2 * i < path_.poses.size(); ++i) path_.poses[i] = path_.poses[2 * i];
    path_.poses.resize((path_.poses.size() + 1) / 2);
  }
  return true;
}

void DrawnPath::Clear() {
  path_.poses.clear();
  T_odom_last_.reset();
}

}  // namespace devo
