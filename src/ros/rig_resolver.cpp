// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/rig_resolver.h"

#include <utility>

#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/parameters.h"

namespace devo {
RigResolver::RigResolver(const ros::NodeHandle& nh, const RigConfig& config, Need need,
                         std::function<void(const ResolvedRig&)> on_resolved)
    : nh_(nh), config_(config), need_(std::move(need)), on_resolved_(std::move(on_resolved)) {
  const Topics& topics = config_.topics;
  event_.name = "event_camera";
  event_.camera = config_.event_camera;
  event_.frame = config_.frames.event;
  event_.topic =
      InputTopic(nh_, "camera_info",
                 topics.event_camera_info.empty() ? SiblingCameraInfo(InputTopic(nh_, "events", topics.events))
                                                  : topics.event_camera_info);
  depth_.name = "depth_camera";
  depth_.camera = config_.depth_camera;
  depth_.frame = config_.frames.depth;
  depth_.topic =
      InputTopic(nh_, "depth/camera_info",
                 topics.depth_camera_info.empty() ? SiblingCameraInfo(InputTopic(nh_, "depth/image_raw", topics.depth))
                                                  : topics.depth_camera_info);
}

void RigResolver::Start() {
  const bool needs_extrinsics = NeedsExtrinsics() && !config_.T_event_depth;
  const bool needs_transforms = needs_extrinsics || !need_.base_frame.empty();
  const bool needs_imu = need_.imu && !config_.T_event_imu;
  // Through the frame of a depth camera that carries it; a LiDAR has no CameraInfo that would name its own.
  const bool imu_by_depth = needs_imu && config_.T_event_apart_depth() && !config_.depth_from_lidar();
  const bool needs_event_info = !event_.camera || ((NeedsEventFrame() || needs_imu) && event_.frame.empty());
  const bool needs_depth_frame = imu_by_depth || (NeedsDepthCamera() && needs_extrinsics);
  const bool needs_depth_info = (NeedsDepthCamera() && !depth_.camera) || (needs_depth_frame && depth_.frame.empty());
  TryToResolve();
  // Nothing after this: callbacks may run on the queue's thread from here on.
  if (needs_event_info) Subscribe(&event_);
  if (needs_depth_info) Subscribe(&depth_);
  if (needs_transforms) {
    transform_subscriber_ = nh_.subscribe<tf2_msgs::TFMessage>(
        "/tf_static", 100, [this](const tf2_msgs::TFMessageConstPtr& message) { OnTransforms(*message); });
  }
}

void RigResolver::Subscribe(CameraSource* source) {
  if (source->topic.empty()) return;
  source->subscriber = nh_.subscribe<sensor_msgs::CameraInfo>(
      source->topic, 2, [this, source](const sensor_msgs::CameraInfoConstPtr& info) { OnCameraInfo(source, *info); });
}

void RigResolver::OnCameraInfo(CameraSource* source, const sensor_msgs::CameraInfo& info) {
  if (source->frame.empty()) source->frame = info.header.frame_id;
  if (resolved_) return;
  if (!source->camera) {
    try {
      source->camera = ToCamera(info);
    } catch (const std::exception& error) {
      source->refused = error.what();
    }
  }
  TryToResolve();
}

void RigResolver::SetDepthFrame(const std::string& frame) {
  if (resolved_ || frame.empty() || !depth_.frame.empty()) return;
  depth_.frame = frame;
  TryToResolve();
}

void RigResolver::OnTransforms(const tf2_msgs::TFMessage& message) {
  if (resolved_) return;
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    transforms_.setTransform(transform, "tf_static", true);
  }
  TryToResolve();
}

void RigResolver::TryToResolve() {
  if (resolved_ || !event_.camera || (NeedsEventFrame() && event_.frame.empty())) return;
  ResolvedRig result;
  result.event_frame = event_.frame.empty() ? "event_camera" : WithoutLeadingSlash(event_.frame);
  result.rig.event_camera = *event_.camera;
  result.rig.depth_from_lidar = config_.depth_from_lidar();
  result.rig.depth_registered = !config_.depth_apart();
  result.rig.depth_camera = *event_.camera;
  if (NeedsDepthCamera()) {
    if (!depth_.camera) return;
    result.rig.depth_camera = *depth_.camera;
  }
  if (NeedsExtrinsics()) {
    const std::optional<Rigid3> T =
        config_.T_event_depth ? config_.T_event_depth : LookupTransform(transforms_, event_.frame, depth_.frame);
    if (!T) return;
    result.rig.T_event_depth = *T;
  }
  if (!need_.base_frame.empty()) {
    result.T_event_base = LookupTransform(transforms_, event_.frame, need_.base_frame);
    if (!result.T_event_base) return;
  }
  resolved_ = true;
  // The subscribers stay: destroying one inside its own callback would free the callback that runs.
  on_resolved_(result);
}

std::vector<std::string> RigResolver::Missing(const KnownTopics& known) const {
  std::vector<std::string> sentences;
  if (resolved_) return sentences;
  if (!event_.camera) {
    sentences.push_back(MissingCamera(known, event_));
  } else if (NeedsEventFrame() && event_.frame.empty()) {
    sentences.push_back(MissingEventFrame(known));
  }
  if (NeedsDepthCamera()) {
    if (!depth_.camera) sentences.push_back(MissingCamera(known, depth_));
  }
  if (NeedsExtrinsics()) {
    if (!config_.T_event_depth && !LookupTransform(transforms_, event_.frame, depth_.frame)) {
      sentences.push_back(MissingTransform("T_event_depth", event_.frame, depth_.frame));
    }
  }
  if (!need_.base_frame.empty() && !LookupTransform(transforms_, event_.frame, need_.base_frame)) {
    sentences.push_back(MissingTransform("base_frame's transformation", event_.frame, need_.base_frame));
  }
  return sentences;
}

std::string RigResolver::MissingCamera(const KnownTopics& known, const CameraSource& source) const {
  const std::string begin = "No intrinsics: " + source.name + " is not in the configuration and ";
  if (!source.refused.empty())
    return begin + "the CameraInfo on " + source.topic + " is no calibration: " + source.refused;
  if (source.topic.empty()) return begin + "topics." + source.name + "_info names no topic.";
  return begin + "no CameraInfo came on " + source.topic + ": " + DescribeTopic(known, source.topic, "CameraInfo") +
         ".";
}

std::string RigResolver::MissingEventFrame(const KnownTopics& known) const {
  return "No frame of the event camera, which /tf_static would place: frames.event is not in the configuration and " +
         (event_.topic.empty() ? std::string("topics.event_camera_info names no topic.")
                               : "no CameraInfo that names one came on " + event_.topic + ": " +
                                     DescribeTopic(known, event_.topic, "CameraInfo") + ".");
}

std::string RigResolver::MissingTransform(const std::string& key, const std::string& a, const std::string& b) const {
  const auto shown = [](const std::string& frame) { return frame.empty() ? "an unnamed frame" : "'" + frame + "'"; };
  std::vector<std::string> frames;
  transforms_._getFrameStrings(frames);
  std::string list;
  for (const std::string& frame : frames) list += (list.empty() ? "" : ", ") + frame;
  return "No extrinsics: " + key + " is not in the configuration and /tf_static does not connect " + shown(a) +
         " with " + shown(b) + "; frames that it knows: " + (list.empty() ? "none" : list) + ".";
}

}  // namespace devo
