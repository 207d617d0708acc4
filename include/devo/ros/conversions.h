// SPDX-License-Identifier: BSD-3-Clause
//
// Times, poses and covariances between the core and ROS's conventions (REP-103).
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <tf2/buffer_core.h>

#include "devo/core/pose_estimate.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Data time as ROS's stamp. Negative times, which ROS cannot express, become 0.
ros::Time ToRosTime(std::int64_t t_ns);
std::int64_t FromRosTime(const ros::Time& stamp);

geometry_msgs::Pose ToPoseMsg(const Rigid3& T);
geometry_msgs::Transform ToTransformMsg(const Rigid3& T);

/// tf2 refuses names of frames that begin with a slash, as those of tf did.
std::string WithoutLeadingSlash(const std::string& frame);

/// The CameraInfo of a data topic, as image_transport pairs them: /a/b/image_raw has /a/b/camera_info. Empty where the
/// name has no slash.
std::string SiblingCameraInfo(const std::string& topic);

/// Throws std::invalid_argument when the quaternion is not of unit length (to 1 %) or a value is not finite.
Rigid3 FromPoseMsg(const geometry_msgs::Pose& pose);
Rigid3 FromTransformMsg(const geometry_msgs::Transform& transform);

/// T_target_source, where the transformations connect the two frames; empty where they do not, or a name is empty.
/// `reason`, if given, is then told why not, if there is something to tell.
std::optional<Rigid3> LookupTransform(const tf2::BufferCore& transforms, const std::string& target,
                                      const std::string& source, std::string* reason = nullptr);

/// ROS's covariance of the pose T_a_b: x, y, z, then rotations about the fixed axes of frame a, from the
/// core's covariance of a right perturbation [rho; phi], T_a_b * Exp(xi), which lives in frame b. To first
/// order T_a_b * Exp(xi) moves the position by R rho and turns by R phi about a's axes: J = diag(R, R).
Matrix6d FixedAxisCovariance(const Rigid3& T_a_b, const Matrix6d& covariance_b);

/// How odometry is expressed: where the world lies in the odometry's frame and which body moves in it.
struct OdometryFrames {
  std::string odom_frame = "odom";
  std::string child_frame = "event_camera";  ///< event frame, or the base where it is known
  Rigid3 T_odom_world;   ///< brings the core's world (first event-camera pose) into the odometry's frame
  Rigid3 T_event_child;  ///< identity when the child is the event camera

  Rigid3 OdomFromChild(const Rigid3& T_world_event) const { return T_odom_world * T_world_event * T_event_child; }
};

/// Pose, its covariance and the twist of the child frame (in the child frame). The twist's covariance follows from
/// two poses `velocity_window_s` apart with independent errors.
nav_msgs::Odometry ToOdometryMsg(const PoseEstimate& estimate, const OdometryFrames& frames, double velocity_window_s);

}  // namespace devo
