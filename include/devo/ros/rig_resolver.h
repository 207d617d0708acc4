// SPDX-License-Identifier: BSD-3-Clause
//
// Completes the rig of the configuration with what the robot publishes: CameraInfo and tf_static. Never with a guess.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "devo/core/rig.h"
#include "devo/io/rig_config.h"
#include "devo/ros/health.h"
#include "devo/ros/message_conversion.h"

namespace devo {

struct ResolvedRig {
  Rig rig;                             ///< depth camera and T_event_depth only where they were asked for
  std::string event_frame;             ///< as configured, else of the CameraInfo, else "event_camera"
  std::optional<Rigid3> T_event_base;  ///< where a base frame was asked for
};

/// Not thread-safe: lives on its node's callback queue.
class RigResolver {
 public:
  struct Need {
    bool depth = false;      ///< T_event_depth and, unless a LiDAR measures depth, the depth camera
    bool imu = false;        ///< imu_surroundings() is asked for; its frames are not waited for
    std::string base_frame;  ///< T_event_base from tf_static; empty: not needed
  };

  /// `on_resolved` is called once, from Start or from a callback on the queue of `nh`.
  RigResolver(const ros::NodeHandle& nh, const RigConfig& config, Need need,
              std::function<void(const ResolvedRig&)> on_resolved);

  /// Subscribes to what the configuration leaves open.
  void Start();

  /// The frame that the depth's own messages name, used when nothing else does.
  void SetDepthFrame(const std::string& frame);

  /// With the frames as configured, else of the CameraInfos; empty while neither says.
  ImuSurroundings imu_surroundings() const {
    return {config_.T_event_imu, event_.frame, config_.T_event_apart_depth(), depth_.frame};
  }

  bool resolved() const { return resolved_; }

  /// One sentence per missing piece: what, where it was looked for, what exists there.
  std::vector<std::string> Missing(const KnownTopics& known) const;

 private:
  struct CameraSource {
    std::string name, topic;  // "event_camera"; its CameraInfo
    std::optional<Camera> camera;
    std::string frame, refused;  // frame_id; why the last CameraInfo was no calibration
    ros::Subscriber subscriber;
  };

  void Subscribe(CameraSource* source);
  void OnCameraInfo(CameraSource* source, const sensor_msgs::CameraInfo& info);
  void OnTransforms(const tf2_msgs::TFMessage& message);
  bool NeedsExtrinsics() const { return need_.depth && config_.depth_apart(); }
  bool NeedsDepthCamera() const { return NeedsExtrinsics() && !config_.depth_from_lidar(); }
  /// By its name in /tf_static, whose tree all nodelets' frames then belong to. Also where the depth is another
  /// nodelet's business: what is published here must be in the frame that is resolved there.
  bool NeedsEventFrame() const {
    return !need_.base_frame.empty() || (config_.depth_apart() && !config_.T_event_depth);
  }
  std::string MissingCamera(const KnownTopics& known, const CameraSource& source) const;
  std::string MissingEventFrame(const KnownTopics& known) const;
  std::string MissingTransform(const std::string& key, const std::string& a, const std::string& b) const;
  void TryToResolve();

  ros::NodeHandle nh_;
  RigConfig config_;
  Need need_;
  std::function<void(const ResolvedRig&)> on_resolved_;
  CameraSource event_, depth_;
  tf2::BufferCore transforms_;
  ros::Subscriber transform_subscriber_;
  bool resolved_ = false;
};

}  // namespace devo
