// SPDX-License-Identifier: BSD-3-Clause
//
// The configuration of one rig: topics, cameras, how they stand to each other, and the odometry's options.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/options.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Topics in bags. Empty: not used.
struct Topics {
  std::string events = "/events";
  std::string event_camera_info;
  std::string depth = "/depth/image_raw";
  std::string depth_camera_info;
  std::string points;
  std::string imu;
  std::string ground_truth;
};

/// Names of the cameras' optical frames, where those in the messages are empty or wrong.
struct Frames {
  std::string event;
  std::string depth;
};

/// A data set's own calibration files, read by dataset_calibration.h. Empty: none.
struct CalibrationFiles {
  std::string format;
  std::string path;
};

struct RigConfig {
  Topics topics;
  Frames frames;
  CalibrationFiles calibration;
  std::optional<Camera> event_camera;   ///< else CameraInfo of the bag or topic
  std::optional<Camera> depth_camera;   ///< else CameraInfo of the bag or topic
  std::optional<Rigid3> T_event_depth;  ///< of the depth camera or the LiDAR; else tf_static
  std::optional<Rigid3> T_event_imu;    ///< else tf_static
  std::optional<Rigid3> T_body_event;   ///< where ground truth is the pose of another body than the event camera
  bool registered = false;              ///< depth is already in the (distorted) event image
  double depth_time_offset_s = 0;       ///< added to the stamps of the depth images
  double imu_time_offset_s = 0;         ///< added to the stamps of the IMU
  double points_turn_s = 0;             ///< of a LiDAR whose points carry no times
  double depth_scale = 1;               ///< depth in metres = depth_scale * depth as the images say
  OdometryOptions odometry;

  /// A LiDAR measures depth: `registered`, topics.depth and depth_camera are of no use then.
  bool depth_from_lidar() const { return !topics.points.empty(); }
  /// What measures depth has a place of its own, T_event_depth.
  bool depth_apart() const { return depth_from_lidar() || !registered; }
  /// T_event_depth as configured, of what has a place of its own: an IMU may be attached to it.
  std::optional<Rigid3> T_event_apart_depth() const { return depth_apart() ? T_event_depth : std::nullopt; }
};

/// Calls `visit(key, value&, min, max, meaning)` for numbers, `visit(key, string&, choices, meaning)` for
/// names, `visit(key, bool&, meaning)` and `visit(key, string&, meaning)` for the rest, once per plain setting of the
/// rig. The cameras and transformations are groups of their own (see LoadRigConfig); the odometry's options are visited
/// by VisitOptions.
template <typename Config, typename Visitor>
void VisitRig(Config& c, Visitor&& visit) {
  visit("topics.events", c.topics.events, "EventArray or EventPacket");
  visit("topics.event_camera_info", c.topics.event_camera_info,
        "CameraInfo, used when event_camera is not given; empty: camera_info beside the events");
  visit("topics.depth", c.topics.depth, "Image, 16UC1 (mm) or 32FC1 (m), raw");
  visit("topics.depth_camera_info", c.topics.depth_camera_info,
        "CameraInfo, used when depth_camera is not given; empty: camera_info beside the depth");
  visit("topics.points", c.topics.points, "PointCloud2 of a LiDAR: where given, it takes the place of depth images");
  visit("topics.imu", c.topics.imu, "Imu, optional");
  visit("topics.ground_truth", c.topics.ground_truth, "PoseStamped, Odometry or TransformStamped, for evaluation only");
  visit("frames.event", c.frames.event,
        "event camera's optical frame; empty: its CameraInfo's (devo_offline: or its events')");
  visit("frames.depth", c.frames.depth,
        "optical frame of the depth camera, or the LiDAR's; empty: as its messages say");
  visit("calibration.format", c.calibration.format, "|vector|mvsec",
        "whose files: VECtor's, MVSEC's (Kalibr); empty: none");
  visit("calibration.path", c.calibration.path,
        "VECtor: folder of its yaml files; MVSEC: camchain-imucam-<scene>.yaml");
  visit("registered", c.registered, "depth is already in the event camera's (distorted) image");
  visit("depth_time_offset_s", c.depth_time_offset_s, -10.0, 10.0,
        "added to the depth's stamps: depth clock to event clock");
  visit("imu_time_offset_s", c.imu_time_offset_s, -10.0, 10.0, "added to the IMU's stamps: its clock to event clock");
  visit("points_turn_s", c.points_turn_s, 0.0, 10.0,
        "LiDAR whose points carry no times: duration of a turn, which ends at the stamp and whose azimuth tells the "
        "time; "
        "0: all points at the stamp");
  visit("depth_scale", c.depth_scale, 0.1, 10.0, "metres per metre that the depth camera reports");
}

/// Reads yaml files in order, later ones override earlier ones, then `overrides` (`key=value`, the key dotted as in
/// `surface.rate_hz`, the value yaml). Besides the keys of VisitRig and VisitOptions there are
///   event_camera, depth_camera:  {width, height, fx, fy, cx, cy, distortion_model, distortion_coefficients}, or the
///   layout
///                                of ROS camera_info files, or {file: PATH} to one, relative to the yaml;
///   T_event_depth, T_event_imu, T_body_event: 16 numbers row-major, four rows of four, {rows, cols, data}, or
///                                {translation: [x, y, z], quaternion: [x, y, z, w]};
/// What is not given there is taken from the files named by `calibration`. An empty group `{}` is as if it were not
/// there. Throws std::invalid_argument naming file and key (unknown, with the nearest known one; of the wrong kind; out
/// of range, with the range) or the file that cannot be read.
RigConfig LoadRigConfig(const std::vector<std::string>& yaml_paths, const std::vector<std::string>& overrides = {});

/// The same from yaml text; `name` stands for the file in messages, `directory` is where relative paths start.
void ApplyYaml(const std::string& text, const std::string& name, const std::string& directory, RigConfig* config);

/// A ROS camera_info file (camera_calibration_parsers layout; `camera_model:` is accepted for `distortion_model:`) or
/// the short form above. Throws std::invalid_argument naming the file and key.
Camera ReadCameraFile(const std::string& path);

/// Every plain setting in use as `key: value` lines, in the order of the visits, to be logged.
std::string Describe(const RigConfig& config);

/// docs/parameters.md: a table of all keys with default, range and meaning.
std::string ParametersMarkdown();

}  // namespace devo
