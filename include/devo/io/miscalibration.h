// SPDX-License-Identifier: BSD-3-Clause
//
// A recording as a rig shows it whose calibration is not quite right: how much the odometry bears of it.
#pragma once

#include <string>

#include <Eigen/Core>

#include "devo/core/imu.h"
#include "devo/core/rig.h"

namespace devo {

/// What the calibration says beside what is true. All zero: it is right.
struct Miscalibration {
  Eigen::Vector3d depth_rotation_deg = Eigen::Vector3d::Zero();   ///< rotation vector, in the depth camera's frame
  Eigen::Vector3d depth_translation_m = Eigen::Vector3d::Zero();  ///< in the event camera's frame
  Eigen::Vector3d imu_rotation_deg = Eigen::Vector3d::Zero();     ///< rotation vector, in the event camera's frame
  Eigen::Vector3d imu_translation_m = Eigen::Vector3d::Zero();    ///< in the event camera's frame
  Eigen::Vector3d gyroscope_bias_deg_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d accelerometer_bias_m_s2 = Eigen::Vector3d::Zero();
  double event_focal = 0;      ///< share that the event camera's focal lengths are given too long, above -1
  double depth_focal = 0;      ///< the same of the depth camera; of its own image, where depth is registered too
  double gyroscope_scale = 0;  ///< share that turning rates read too high
  double accelerometer_scale = 0;

  /// Takes `depth_rotation`, `depth_translation`, `imu_rotation`, `imu_translation`, `gyroscope_bias` or
  /// `accelerometer_bias` with `X:Y:Z`, or `event_focal`, `depth_focal`, `gyroscope_scale` or `accelerometer_scale`
  /// with a share. False where `key` is none of these. Throws std::invalid_argument naming `key` and what was expected.
  bool Add(const std::string& key, const std::string& value);

  /// `rig` as the calibration has it. Registered depth becomes depth of a camera of its own, where that is off.
  Rig Of(const Rig& rig) const;

  /// What the sensor reads in place of `sample`.
  ImuSample Of(const ImuSample& sample) const;
};

}  // namespace devo
