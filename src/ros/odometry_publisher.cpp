// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/odometry_publisher.h"

#include <geometry_msgs/PoseStamped.h>

#include "devo/Status.h"
#include "devo/core/time.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

constexpr double kPathPeriod_s = 0.1;
// What a pose that is only a guess claims to know (variances, m^2 and rad^2).
constexpr double kLostVariance_m2 = 1e6, kLostVariance_rad2 = 10;

PoseEstimate WithHonestCovariance(PoseEstimate estimate) {
  if (estimate.state == TrackingState::kLost || estimate.state == TrackingState::kInitialising) {
    estimate.covariance_event.setZero();
    estimate.covariance_event.diagonal() << Eigen::Vector3d::Constant(kLostVariance_m2),
        Eigen::Vector3d::Constant(kLostVariance_rad2);
    estimate.covariance_in_chapter = estimate.covariance_event;
  }
  return estimate;
}

}  // namespace

OdometryPublisher::OdometryPublisher(ros::NodeHandle nh, const OdometryFrames& frames, const Options& options)
    : frames_(frames), options_(options), odometry_(nh.advertise<nav_msgs::Odometry>(topics::kOdometry, 50)),
      pose_(nh.advertise<geometry_msgs::PoseStamped>(topics::kPose, 50)),
      path_publisher_(nh.advertise<nav_msgs::Path>(topics::kPath, 1, true)),
      status_(nh.advertise<Status>(topics::kStatus, 50)), path_(options.path_min_distance_m) {}

void OdometryPublisher::Publish(const PoseEstimate& estimate) {
  const nav_msgs::Odometry odometry =
      ToOdometryMsg(WithHonestCovariance(estimate), frames_, options_.velocity_window_s);
  odometry_.publish(odometry);
  if (pose_.getNumSubscribers() > 0) {
    geometry_msgs::PoseStamped pose;
    pose.header = odometry.header;
    pose.pose = odometry.pose.pose;
    pose_.publish(pose);
  }
  if (options_.publish_tf) BroadcastTransform(odometry);
  ExtendPath(odometry);
}

void OdometryPublisher::BroadcastTransform(const nav_msgs::Odometry& odometry) {
  geometry_msgs::TransformStamped transform;
  transform.header = odometry.header;
  transform.child_frame_id = odometry.child_frame_id;
  Rigid3 T = FromPoseMsg(odometry.pose.pose);
  if (options_.invert_tf) {
    std::swap(transform.header.frame_id, transform.child_frame_id);
    T = T.inverse();
  }
  transform.transform = ToTransformMsg(T);
  broadcaster_.sendTransform(transform);
}

void OdometryPublisher::ExtendPath(const nav_msgs::Odometry& odometry) {
  if (!path_.Extend(odometry.header, FromPoseMsg(odometry.pose.pose))) return;
  const std::int64_t t_ns = FromRosTime(odometry.header.stamp);
  if (std::abs(t_ns - path_published_ns_) < NsFromSeconds(kPathPeriod_s)) return;
  path_published_ns_ = t_ns;
  path_publisher_.publish(path_.message());
}

void OdometryPublisher::Clear() {
  path_.Clear();
  path_published_ns_ = 0;
}

void OdometryPublisher::PublishStatus(const Surface& surface, const PoseEstimate& estimate,
                                      std::uint64_t surfaces_dropped) {
  if (status_.getNumSubscribers() == 0) return;
  Status status;
  status.header.stamp = ToRosTime(surface.t_ns);
  status.header.frame_id = frames_.odom_frame;
  status.state = static_cast<std::uint8_t>(estimate.state);
  status.state_name = ToString(estimate.state);
  status.epoch = surface.epoch;
  status.reference_id = estimate.reference_id;
  status.points_used = estimate.points_used;
  status.inlier_share = static_cast<float>(estimate.inlier_share);
  status.mean_residual_px = static_cast<float>(estimate.mean_residual_px);
  status.still = surface.still;
  status.event_rate_hz = static_cast<float>(surface.event_rate_hz);
  status.surfaces_dropped = surfaces_dropped;
  status_.publish(status);
}

}  // namespace devo
