// SPDX-License-Identifier: BSD-3-Clause
//
// The tracking module as a ROS class: surfaces and local maps in, one pose per surface out.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <std_srvs/Trigger.h>

#include "devo/core/tracker.h"
#include "devo/io/trajectory_log.h"
#include "devo/ros/core_messages.h"
#include "devo/ros/ground_truth.h"
#include "devo/ros/health.h"
#include "devo/ros/imu_input.h"
#include "devo/ros/odometry_publisher.h"
#include "devo/ros/rig_resolver.h"
#include "devo/ros/service_thread.h"
#include "devo/ros/tunables.h"
#include "devo/ros/worker.h"

namespace devo {

/// Answers every surface with a TrackedPose (state INITIALISING while there is no map), which the other two modules
/// wait for. When behind, the oldest waiting surfaces are left out and counted.
class TrackingNode {
 public:
  /// Throws std::invalid_argument naming the parameter or yaml key that is wrong, before anything is subscribed.
  TrackingNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);

  /// Saves the trajectory where `save_at_shutdown` asks for it.
  ~TrackingNode();

 private:
  using SurfaceConstPtr = boost::shared_ptr<const Surface>;

  struct Frames {
    std::string odom, event, base;
    Rigid3 initial_pose;  // of the child frame in the odometry's frame
  };

  void OnRig(const ResolvedRig& rig);
  void OnOptions(const OdometryOptions& options);
  void OnSurface(const SurfaceConstPtr& surface);
  void OnMap(const boost::shared_ptr<const LocalMap>& map);
  void OnDepthPose(const boost::shared_ptr<const DepthPose>& pose);
  bool OnSaveTrajectory(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status);

  /// Writes the trajectory and says where, with its error where there is ground truth. Throws std::runtime_error.
  std::string SaveTrajectory();

  // On the worker's thread.
  bool Step();
  /// Forgets the poses of an epoch that is over; where `save_at_shutdown` wants them, they are written before.
  void EndTrajectory(std::uint64_t epoch);
  void TakeMap(const boost::shared_ptr<const LocalMap>& map);
  void Answer(const Surface& surface, const std::optional<PoseEstimate>& pose, double tracking_ms);
  void DrawReprojection(const Surface& surface, const PoseEstimate& pose);

  ros::NodeHandle nh_, private_nh_;
  RigConfig config_;
  Frames frames_;
  OdometryPublisher::Options output_;
  std::string trajectory_file_;
  bool save_at_shutdown_;
  std::size_t surface_queue_size_, max_poses_;

  std::mutex mutex_;
  std::deque<SurfaceConstPtr> surfaces_;
  boost::shared_ptr<const LocalMap> new_map_;
  std::vector<boost::shared_ptr<const DepthPose>> depth_poses_;
  std::unique_ptr<Tracker> new_tracker_;
  std::unique_ptr<OdometryPublisher> new_publisher_;
  bool options_changed_ = false;  // in config_.odometry, until the worker's tracker has them
  std::optional<Camera> camera_;  // undistorted event camera
  std::string event_frame_;       // its frame, whatever body the odometry is of
  TrajectoryLog trajectory_;      // of the event camera in the odometry's frame
  PoseEstimate last_;
  std::uint64_t tracked_ = 0, dropped_ = 0, untracked_ = 0, forgotten_ = 0;
  RateMeter pose_rate_;
  Quantiles tracking_ms_;
  Failures failures_;

  // The worker's own.
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<OdometryPublisher> publisher_;
  boost::shared_ptr<const LocalMap> map_;
  std::optional<std::uint64_t> epoch_;

  Health health_;
  std::shared_ptr<Input> surface_input_, map_input_, imu_input_;
  std::unique_ptr<RigResolver> rig_;
  image_transport::ImageTransport image_transport_;
  image_transport::Publisher reprojection_publisher_;
  ros::Publisher tracked_pose_publisher_;
  ros::Subscriber surface_subscriber_, map_subscriber_, depth_pose_subscriber_;
  std::unique_ptr<Tunables> tunables_;
  ServiceThread save_thread_;
  ros::ServiceServer save_service_;
  std::unique_ptr<GroundTruth> ground_truth_;
  std::unique_ptr<ImuInput> imu_;   // where there is an IMU
  std::unique_ptr<Worker> worker_;  // last: joined before anything that it uses goes
};

}  // namespace devo
