// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>

#include "devo/sim/sequence.h"

namespace devo {

/// Simulated data as messages; used for bags and by the simulated sensor.
sensor_msgs::CameraInfo ToCameraInfoMsg(const Camera& camera, std::int64_t t_ns, const std::string& frame_id);
/// 16UC1 millimetres (0: invalid), rounded, or 32FC1 metres (NaN: invalid).
sensor_msgs::Image ToDepthMsg(const DepthImage& depth, const std::string& encoding, const std::string& frame_id);
sensor_msgs::Image ToFrameMsg(const sim::Frame& frame, const std::string& frame_id);
sensor_msgs::Imu ToImuMsg(const ImuSample& sample, const std::string& frame_id);
geometry_msgs::PoseStamped ToPoseMsg(std::int64_t t_ns, const Rigid3& T_frame_body, const std::string& frame_id);
/// How drivers of LiDARs lay out their points. All have x y z intensity (float32).
enum class PointLayout {
  kVelodyne,     ///< ring (uint16), time (float32, s after header.stamp): velodyne_pointcloud since 1.6
  kVelodyneOld,  ///< ring (uint16), no times, header.stamp is the end of the turn: as MVSEC has it
  kOuster,       ///< t (uint32, ns after header.stamp), ring (uint8): ouster_ros, as VECtor has it
};
/// `turn_s`: duration of a turn, which decides the stamp of kVelodyneOld.
sensor_msgs::PointCloud2 ToPointCloudMsg(const sim::LidarScan& scan, const std::string& frame_id,
                                         PointLayout layout = PointLayout::kVelodyne, double turn_s = 0.1);

/// /tf_static of the plain topics: where the depth camera, unless its images are registered, and the LiDAR are.
tf2_msgs::TFMessage StaticTransforms(const sim::Sequence& sequence);

enum class BagDialect {
  kPlain,   ///< this package's topics: NAME.bag, NAME.yaml (configuration), NAME_groundtruth.txt; with a LiDAR beside a
            ///< depth camera also NAME_lidar.yaml, with the LiDAR in its place
  kMvsec,   ///< NAME_data.bag, NAME_gt.bag and calibration beside them, as MVSEC's files
  kVector,  ///< NAME.synced.<sensor>.bag (bz2, one topic each) and yaml/ beside them, as VECtor's files
};
/// The sequence of MVSEC's right camera: a DAVIS346 of the same kind 10 cm to the right, with noise of its own.
sim::SequenceOptions RightCameraOf(const sim::SequenceOptions& left);

/// plain, mvsec or vector; else std::invalid_argument naming it.
BagDialect BagDialectOf(const std::string& name);

/// Writes a sequence as bags and calibration files. Throws std::runtime_error naming the file that cannot be written.
class SimBagWriter {
 public:
  virtual ~SimBagWriter() = default;
  virtual void Write(const sim::Chunk& chunk) = 0;
  /// The same time as the right camera of a stereo pair sees it; only after Create with `right`.
  virtual void WriteRight(const sim::Chunk& chunk);
  /// Completes the files, once, after all else. Until then the bags have .active behind their names.
  virtual void Close() = 0;
  /// Files that are there after Close, for telling the user.
  const std::vector<std::string>& files() const { return files_; }

  /// `stem`: path without extension; its directory must exist, else std::runtime_error naming it. `right`: a second
  /// sequence of the same motion, for MVSEC's right camera; other dialects throw std::invalid_argument.
  static std::unique_ptr<SimBagWriter> Create(BagDialect dialect, const std::string& stem,
                                              const sim::Sequence& sequence, const sim::Sequence* right = nullptr);

 protected:
  std::vector<std::string> files_;
};

}  // namespace devo
