// SPDX-License-Identifier: BSD-3-Clause
//
// Calibration as data sets publish it, read as downloaded.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// What a data set's files say about a rig of one event camera and one depth camera.
struct DatasetCalibration {
  Camera event_camera;
  std::optional<Camera> depth_camera;
  std::optional<Rigid3> T_event_depth;
  std::optional<Rigid3> T_event_lidar;
  std::optional<Rigid3> T_event_imu;
  std::optional<Rigid3> T_event_imu_of_lidar_rig;  ///< the same but where the rig was mounted anew for the LiDAR
  std::optional<Rigid3>
      T_body_event;  ///< body: what the ground truth is the pose of, where that is not the event camera
};

/// VECtor's assets/yaml: left event camera, Kinect depth camera (factory intrinsics),
/// T_event_depth = T_cam0_cam2^-1 * T_cam0_cam4 * T_color_depth with the small-scale joint extrinsics and the
/// calibrated depth-to-colour transformation, and T_body_event through the motion-capture extrinsics where that file is
/// there. T_event_lidar, where camera_lidar_extrinsic_results.yaml is there, is T_cam0_cam2^-1 * T_cam_lidar with the
/// large-scale joint extrinsics (else the small-scale ones). T_event_imu is T_cam0_cam2^-1 * T_cam0_imu with the joint
/// and camera-IMU extrinsics of either scale, where the latter are there. Gao et al., "VECtor: A Versatile
/// Event-Centric Benchmark for Multi-Sensor SLAM", RA-L 2022. Throws std::invalid_argument naming the file and key that
/// is missing or malformed.
DatasetCalibration ReadVectorCalibration(const std::string& directory);

/// A camera of a Kalibr camchain.
struct KalibrCamera {
  Camera camera;
  std::string rostopic;
  std::optional<Rigid3> T_cn_cnm1;  ///< from the previous camera of the chain
  std::optional<Rigid3> T_cam_imu;
};

struct KalibrChain {
  std::vector<KalibrCamera> cameras;
  std::optional<Rigid3> T_cam0_lidar;  ///< MVSEC's addition

  /// T_a_b between two cameras of the chain. Throws std::invalid_argument when a link T_cn_cnm1 is missing.
  Rigid3 Between(std::size_t a, std::size_t b) const;
};

/// Throws std::invalid_argument naming the file and key that is missing or malformed.
KalibrChain ReadKalibrChain(const std::string& path);

/// MVSEC's camchain-imucam-<scene>.yaml: cam0 is the left DAVIS, whose image its depth images are registered to and
/// whose own IMU T_cam_imu places.
/// Zhu et al., "The Multi Vehicle Stereo Event Camera Dataset", RA-L 2018.
DatasetCalibration ReadMvsecCalibration(const std::string& path);

}  // namespace devo
