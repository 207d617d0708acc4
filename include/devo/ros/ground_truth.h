// SPDX-License-Identifier: BSD-3-Clause
//
// Ground truth where a recording or a motion-capture system gives it: drawn beside the estimate and compared with it.
// Never an input of the odometry.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include <ros/node_handle.h>

#include "devo/io/trajectory.h"
#include "devo/io/trajectory_log.h"
#include "devo/ros/drawn_path.h"
#include "devo/ros/topic_probe.h"

namespace devo {

/// Thread-safe.
class GroundTruth {
 public:
  struct Options {
    std::size_t max_poses;       ///< kept to compare with; then the oldest are forgotten
    double path_min_distance_m;  ///< as OdometryPublisher's
  };

  /// `topic` carries PoseStamped, Odometry or TransformStamped; which, its first message says. `T_body_event`: from the
  /// event camera to the body whose pose it is.
  GroundTruth(const ros::NodeHandle& nh, const std::string& topic, const Rigid3& T_body_event, const Options& options);

  /// Poses of the event camera since the last time that the stamps went back.
  Trajectory poses() const;

  /// At the first call for which there is truth, fixes where the truth lies in the odometry's frame; later calls
  /// publish the path where it has become longer, at most ten times per second of data time, seldom while nobody looks.
  void PublishPath(std::int64_t t_ns, const Rigid3& T_odom_event, const std::string& odom_frame);

  void Clear();

 private:
  bool Subscribe(const std::string& type);  ///< false for types that hold no pose
  void Add(std::int64_t t_ns, const Rigid3& T_world_body);
  bool DrawRecent(const std::string& odom_frame);  ///< whether the path has become longer
  template <typename Message>
  void SubscribeTo();

  ros::NodeHandle nh_;
  std::string topic_;
  Rigid3 T_body_event_;
  mutable std::mutex mutex_;
  TrajectoryLog poses_;
  Trajectory recent_;  // of them, for the path and where it lies
  std::optional<Rigid3> T_odom_world_;
  DrawnPath path_;
  std::size_t drawn_ = 0;  // of the recent ones, that are in the path, or were passed over
  std::int64_t published_ns_ = 0;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  TopicProbe probe_;  // last: it ends before what it sets
};

}  // namespace devo
