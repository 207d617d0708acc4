// SPDX-License-Identifier: BSD-3-Clause
//
// Ground truth where a recording or a motion-capture system gives it: drawn beside the estimate and compared with it.
// Never an input of the odometry.
#pragma once

#include <functional>
#include <mutex>
#include <string>

#include <nav_msgs/Path.h>
#include <ros/node_handle.h>

#include "devo/io/trajectory.h"
#include "devo/ros/topic_probe.h"

namespace devo {

/// Thread-safe.
class GroundTruth {
 public:
  /// `topic` carries PoseStamped, Odometry or TransformStamped; which, its first message says. `T_body_event`: from the
  /// event camera to the body whose pose it is.
  GroundTruth(const ros::NodeHandle& nh, const std::string& topic, const Rigid3& T_body_event);

  /// Poses of the event camera since the last time that the stamps went back.
  Trajectory poses() const;

  /// At the first call for which there is truth, fixes where the truth lies in the odometry's frame; later calls
  /// publish the path at most ten times per second of data time.
  void PublishPath(std::int64_t t_ns, const Rigid3& T_odom_event, const std::string& odom_frame);

  void Clear();

 private:
  bool Subscribe(const std::string& type);  ///< false for types that hold no pose
  void Add(std::int64_t t_ns, const Rigid3& T_world_body);
  template <typename Message>
  void SubscribeTo();

  ros::NodeHandle nh_;
  std::string topic_;
  Rigid3 T_body_event_;
  mutable std::mutex mutex_;
  Trajectory poses_;
  std::optional<Rigid3> T_odom_world_;
  nav_msgs::Path path_;
  std::size_t drawn_ = 0;  // poses that are in the path, or were passed over
  std::int64_t published_ns_ = 0;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  TopicProbe probe_;  // last: it ends before what it sets
};

}  // namespace devo
