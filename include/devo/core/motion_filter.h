// SPDX-License-Identifier: BSD-3-Clause
//
// What the motion so far says of the next pose: a Kalman filter on SE(3) whose state is pose, velocity and
// acceleration, driven by white jerk, with the acceleration fading (Singer, "Estimating optimal tracking filter
// performance for manned maneuvering targets", 1970). Its prediction is the prior of the alignment, so that
// directions that one surface leaves open are held by what earlier surfaces said of them.
#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "devo/core/options.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class MotionFilter {
 public:
  explicit MotionFilter(const TrackingOptions& options) : options_(options) {}

  /// Starts at rest (to within a walking pace and a slow turn) at a pose known to a millimetre and milliradian.
  void Start(std::int64_t t_ns, const Rigid3& T_world_event);

  struct Prediction {
    Rigid3 T_world_event;
    Vector6d velocity_event;  ///< [v; omega], m/s and rad/s
    Matrix6d covariance;      ///< of a right perturbation [rho; phi] of T_world_event, m and rad
  };
  /// At a time at or after the last update.
  Prediction Predict(std::int64_t t_ns) const;

  /// Takes the pose that maximises prior and measurement together, as the alignment that started from Predict(t_ns)
  /// found it, and the measurement's information on a right perturbation of it (without the prior).
  void Update(std::int64_t t_ns, const Rigid3& T_world_event, const Matrix6d& information);

  /// A gyroscope's mean reading over the `span_s` since the last update, free of bias: rad/s in the event frame.
  /// `sigma_rad_s`: its standard deviation, remaining bias included.
  void MeasureAngularVelocity(const Eigen::Vector3d& angular_velocity, double span_s, double sigma_rad_s);

  /// The camera is known to stand still.
  void HoldStill(std::int64_t t_ns);

  /// Nothing was measured: goes on with the prediction, slowing down.
  void Coast(std::int64_t t_ns);

  std::int64_t time_ns() const { return t_ns_; }
  const Rigid3& pose() const { return T_world_event_; }
  Matrix6d pose_covariance() const { return P_.topLeftCorner<6, 6>(); }
  bool started() const { return started_; }
  void Reset() { started_ = false; }

 private:
  using Vector18d = Eigen::Matrix<double, 18, 1>;
  using Matrix18d = Eigen::Matrix<double, 18, 18>;

  void Propagate(double dt_s, Rigid3* T_world_event, Vector6d* velocity, Vector6d* acceleration, Matrix18d* P) const;

  TrackingOptions options_;
  bool started_ = false;
  std::int64_t t_ns_ = 0;
  Rigid3 T_world_event_;
  Vector6d velocity_ = Vector6d::Zero(), acceleration_ = Vector6d::Zero();  // of and in the event frame
  Matrix18d P_ = Matrix18d::Zero();  // of [right perturbation of the pose; velocity; acceleration]
};

}  // namespace devo
