// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "devo/core/odometry.h"

namespace devo::sim {

/// Topics of the plain dialect: what `devo_simulate` writes and the simulated sensor publishes.
struct PlainTopics {
  static constexpr const char* kEvents = "/event_camera/events";
  static constexpr const char* kEventCameraInfo = "/event_camera/camera_info";
  static constexpr const char* kFrames = "/event_camera/image_raw";
  static constexpr const char* kDepth = "/depth/image_raw";
  static constexpr const char* kDepthCameraInfo = "/depth/camera_info";
  static constexpr const char* kPoints = "/velodyne_points";
  static constexpr const char* kImu = "/imu";
  static constexpr const char* kGroundTruth = "/ground_truth/pose";
  static constexpr const char* kEventFrame = "event_camera_optical";
  static constexpr const char* kDepthFrame = "depth_camera_optical";
  static constexpr const char* kLidarFrame = "velodyne";
};

/// Name of a distortion model in ROS.
const char* DistortionName(const Camera& camera);

/// The odometry's configuration of a simulated rig as yaml: plain topics, cameras, extrinsics. `comment` goes on top.
/// With rig.depth_from_lidar, T_event_depth is the LiDAR's pose and topics.points its topic.
std::string RigYaml(const Rig& rig, double depth_time_offset_s, const std::string& comment);

}  // namespace devo::sim
