// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "devo/core/rigid3.h"
#include "devo/sim/scene.h"

namespace devo::sim {

/// A stop inside a motion: the camera slows down smoothly, stands still, and goes on.
struct Stop {
  double begin_s = 0;  ///< when standing still begins, after the sequence's start
  double duration_s = 1;
};

/// Motion of a camera: a uniform cubic B-spline on SE(3) (cumulative form; Sommer et al., CVPR 2020), run through at
/// a speed that may pause.
class Trajectory {
 public:
  /// Control poses T_world_camera, `knot_s` apart, at least 4. Pose at time 0 is that of the second control pose's
  /// knot. Throws std::invalid_argument when there are fewer.
  Trajectory(std::vector<Rigid3> control_poses, double knot_s);

  /// Poses given at increasing times (s, first one is time zero), interpolated exactly at a uniform resampling by
  /// progressive iterative approximation (Lin, Bao, Wang 2005). Throws std::invalid_argument for fewer than 4 poses or
  /// unordered times.
  static Trajectory Fit(const std::vector<double>& times_s, const std::vector<Rigid3>& poses);

  /// Standing still until `rest_s`, then reaching full speed in `ramp_s`; and stops.
  void SetPauses(double rest_s, const std::vector<Stop>& stops, double ramp_s = 0.4);

  /// The same motion for a camera that is mounted at T_camera_other on the first.
  Trajectory MovedTo(const Rigid3& T_camera_other) const;

  /// T_world_camera at a time (s); beyond the ends the camera rests where it ended.
  Rigid3 PoseAt(double t_s) const;
  /// [v; omega] of and in the camera frame (m/s, rad/s), by central differences.
  Vector6d VelocityAt(double t_s) const;
  /// Acceleration of the camera's centre in the world frame, m/s^2, by central differences.
  Eigen::Vector3d AccelerationAt(double t_s) const;

  double duration_s() const;

 private:
  Rigid3 SplineAt(double s) const;
  double SplineTime(double t_s) const;

  std::vector<Rigid3> control_;
  double knot_s_;
  struct Ramp {
    double begin_s, duration_s, from, to;
  };
  std::vector<Ramp> ramps_;  // changes of speed, in order
};

/// The paper's speeds: `slow`, `mid`, `fast` reach, but do not exceed, 0.3 m/s and 30 deg/s, 0.8 and 80, 1.5 and 200.
struct MotionLimits {
  double speed_m_s, rate_rad_s;
};
/// Throws std::invalid_argument naming the speed and the known ones.
MotionLimits LimitsOf(const std::string& speed);

/// A random smooth motion through the scene's volume, long enough for `duration_s`; the same seed gives the same.
Trajectory RandomTrajectory(const MotionVolume& volume, const MotionLimits& limits, double duration_s,
                            std::uint64_t seed);

/// The same, but back at its first pose, with the same velocity, after exactly `duration_s`; slower than the limits by
/// what is needed for that.
Trajectory ClosedTrajectory(const MotionVolume& volume, const MotionLimits& limits, double duration_s,
                            std::uint64_t seed);

/// Poses of a TUM file (`t tx ty tz qx qy qz qw`, # comments), with the time of its first pose. Throws
/// std::runtime_error naming the file and line.
Trajectory TrajectoryFromTum(const std::string& path, double* first_time_s = nullptr);

}  // namespace devo::sim
