// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/conversions.h"

#include <cmath>
#include <stdexcept>

#include "devo/core/time.h"

namespace devo {
namespace {

template <typename Vector3, typename Quaternion>
Rigid3 FromMessage(const Vector3& p, const Quaternion& q) {
  const Eigen::Vector3d translation(p.x, p.y, p.z);
  const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
  if (!translation.allFinite() || !(std::abs(rotation.norm() - 1) < 0.01)) {
    throw std::invalid_argument("pose is not finite or its quaternion (norm " + std::to_string(rotation.norm()) +
                                ") is not of unit length");
  }
  return {rotation, translation};
}

template <typename Vector3, typename Quaternion>
void FillMessage(const Rigid3& T, Vector3& p, Quaternion& q) {
  p.x = T.translation().x();
  p.y = T.translation().y();
  p.z = T.translation().z();
  q.x = T.rotation().x();
  q.y = T.rotation().y();
  q.z = T.rotation().z();
  q.w = T.rotation().w();
}

void FillCovariance(const Matrix6d& covariance, boost::array<double, 36>& row_major) {
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(row_major.data()) = covariance;
}

}  // namespace

ros::Time ToRosTime(std::int64_t t_ns) {
  ros::Time stamp;
  stamp.fromNSec(static_cast<std::uint64_t>(t_ns < 0 ? 0 : t_ns));
  return stamp;
}

std::int64_t FromRosTime(const ros::Time& stamp) { return static_cast<std::int64_t>(stamp.toNSec()); }

std::string SiblingCameraInfo(const std::string& topic) {
  const std::size_t slash = topic.rfind('/');
  return slash == std::string::npos ? "" : topic.substr(0, slash) + "/camera_info";
}

std::string WithoutLeadingSlash(const std::string& frame) {
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

geometry_msgs::Pose ToPoseMsg(const Rigid3& T) {
  geometry_msgs::Pose pose;
  FillMessage(T, pose.position, pose.orientation);
  return pose;
}

geometry_msgs::Transform ToTransformMsg(const Rigid3& T) {
  geometry_msgs::Transform transform;
  FillMessage(T, transform.translation, transform.rotation);
  return transform;
}

Rigid3 FromPoseMsg(const geometry_msgs::Pose& pose) { return FromMessage(pose.position, pose.orientation); }

Rigid3 FromTransformMsg(const geometry_msgs::Transform& transform) {
  return FromMessage(transform.translation, transform.rotation);
}

std::optional<Rigid3> LookupTransform(const tf2::BufferCore& transforms, const std::string& target,
                                      const std::string& source, std::string* reason) {
  if (target.empty() || source.empty()) return std::nullopt;
  try {
    return FromTransformMsg(
        transforms.lookupTransform(WithoutLeadingSlash(target), WithoutLeadingSlash(source), ros::Time(0)).transform);
  } catch (const std::exception& e) {  // tf2's exceptions, and quaternions of no length
    if (reason != nullptr) *reason = e.what();
    return std::nullopt;
  }
}

Matrix6d FixedAxisCovariance(const Rigid3& T_a_b, const Matrix6d& covariance_b) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = T_a_b.rotation().toRotationMatrix();
  J.bottomRightCorner<3, 3>() = J.topLeftCorner<3, 3>();
  return J * covariance_b * J.transpose();
}

nav_msgs::Odometry ToOdometryMsg(const PoseEstimate& estimate, const OdometryFrames& frames, double velocity_window_s) {
  nav_msgs::Odometry odometry;
  odometry.header.stamp = ToRosTime(estimate.t_ns);
  odometry.header.frame_id = frames.odom_frame;
  odometry.child_frame_id = frames.child_frame;
  const Rigid3 T_odom_child = frames.OdomFromChild(estimate.T_world_event);
  odometry.pose.pose = ToPoseMsg(T_odom_child);

  // The same motion seen from the child frame: Exp(xi) * T = T * Exp(Ad(T^-1) xi).
  const Matrix6d Ad_child_event = Adjoint(frames.T_event_child.inverse());
  const Matrix6d covariance_child = Ad_child_event * estimate.covariance_event * Ad_child_event.transpose();
  FillCovariance(FixedAxisCovariance(T_odom_child, covariance_child), odometry.pose.covariance);

  const Vector6d velocity = Ad_child_event * estimate.velocity_event;
  odometry.twist.twist.linear.x = velocity(0);
  odometry.twist.twist.linear.y = velocity(1);
  odometry.twist.twist.linear.z = velocity(2);
  odometry.twist.twist.angular.x = velocity(3);
  odometry.twist.twist.angular.y = velocity(4);
  odometry.twist.twist.angular.z = velocity(5);
  // By what a chapter is off, both poses that tell a velocity are off alike.
  const Matrix6d in_chapter = Ad_child_event * estimate.covariance_in_chapter * Ad_child_event.transpose();
  FillCovariance(2 / (velocity_window_s * velocity_window_s) * in_chapter, odometry.twist.covariance);
  return odometry;
}

}  // namespace devo
