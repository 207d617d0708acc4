// SPDX-License-Identifier: BSD-3-Clause
//
// The tracked poses as ROS wants them: odometry, pose, path, status and tf.
#pragma once

#include <deque>

#include <nav_msgs/Odometry.h>
#include <ros/node_handle.h>
#include <tf2_ros/transform_broadcaster.h>

#include "devo/core/pose_estimate.h"
#include "devo/core/surface.h"
#include "devo/io/trajectory.h"
#include "devo/ros/conversions.h"
#include "devo/ros/drawn_path.h"

namespace devo {

/// Not thread-safe.
class OdometryPublisher {
 public:
  struct Options {
    bool publish_tf = true;
    bool invert_tf = false;             ///< child -> odom, for trees in which the child has a parent already
    double path_min_distance_m = 0.01;  ///< poses of the path are this far apart, or 0.02 rad
    double velocity_window_s = 0.05;    ///< two poses this far apart give the twist its covariance
  };

  OdometryPublisher(ros::NodeHandle nh, const OdometryFrames& frames, const Options& options);

  void Publish(const PoseEstimate& estimate);
  void PublishStatus(const Surface& surface, const PoseEstimate& estimate, std::uint64_t surfaces_dropped);

  /// A new epoch: the path begins anew.
  void Clear();

  const OdometryFrames& frames() const { return frames_; }

 private:
  void ExtendPath(const nav_msgs::Odometry& odometry);
  void BroadcastTransform(const nav_msgs::Odometry& odometry);

  OdometryFrames frames_;
  Options options_;
  ros::Publisher odometry_, pose_, path_publisher_, status_;
  tf2_ros::TransformBroadcaster broadcaster_;
  DrawnPath path_;
  std::int64_t path_published_ns_ = 0;
};

}  // namespace devo
