// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_filter.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "devo/core/time.h"

namespace devo {
namespace {

// Accelerations of hands and small vehicles keep their direction about this long.
constexpr double kManeuver_s = 0.15;
// Without events a motion is taken to go on about this long.
constexpr double kCoast_s = 0.5;
constexpr double kStartSigma_m = 1e-3, kStartSigma_rad = 1e-3;
constexpr double kStartSpeed_m_s = 0.5, kStartTurn_rad_s = 0.5;
constexpr double kStillSpeed_m_s = 0.01, kStillTurn_rad_s = 0.01;

Vector6d Both(double translation, double rotation) {
  Vector6d v;
  v << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return v;
}

}  // namespace

void MotionFilter::Start(std::int64_t t_ns, const Rigid3& T_world_event) {
  started_ = true;
  t_ns_ = t_ns;
  T_world_event_ = T_world_event;
  velocity_.setZero();
  acceleration_.setZero();
  P_.setZero();
  P_.diagonal() << Both(kStartSigma_m, kStartSigma_rad).cwiseAbs2(),
      Both(kStartSpeed_m_s, kStartTurn_rad_s).cwiseAbs2(),
      Both(options_.acceleration_m_s2, options_.angular_acceleration_rad_s2).cwiseAbs2();
}

void MotionFilter::Propagate(double dt_s, Rigid3* T, Vector6d* velocity, Vector6d* acceleration, Matrix18d* P) const {
  const double fade = std::exp(-dt_s / kManeuver_s);
  const Vector6d step = *velocity * dt_s + *acceleration * (0.5 * dt_s * dt_s);
  Matrix18d F = Matrix18d::Identity();
  F.block<6, 6>(0, 0) = Adjoint(Exp(-step));
  F.block<6, 6>(0, 6) = dt_s * Matrix6d::Identity();
  F.block<6, 6>(0, 12) = 0.5 * dt_s * dt_s * Matrix6d::Identity();
  F.block<6, 6>(6, 12) = dt_s * Matrix6d::Identity();
  F.block<6, 6>(12, 12) = fade * Matrix6d::Identity();
  // Singer: the acceleration's variance is stationary, its density follows from the time it takes to fade.
  const Vector6d variance = Both(options_.acceleration_m_s2, options_.angular_acceleration_rad_s2).cwiseAbs2();
  const Vector6d q = 2 / kManeuver_s * variance;
  Matrix18d Q = Matrix18d::Zero();
  const double d = dt_s, d2 = d * d, d3 = d2 * d, d4 = d3 * d, d5 = d4 * d;
  for (int i = 0; i < 6; ++i) {
    Q(i, i) = q[i] * d5 / 20;
    Q(i, i + 6) = Q(i + 6, i) = q[i] * d4 / 8;
    Q(i, i + 12) = Q(i + 12, i) = q[i] * d3 / 6;
    Q(i + 6, i + 6) = q[i] * d3 / 3;
    Q(i + 6, i + 12) = Q(i + 12, i + 6) = q[i] * d2 / 2;
    Q(i + 12, i + 12) = q[i] * d;
  }
  *T = *T * Exp(step);
  *velocity += *acceleration * dt_s;
  *acceleration *= fade;
  *P = F * *P * F.transpose() + Q;
}

MotionFilter::Prediction MotionFilter::Predict(std::int64_t t_ns) const {
  Prediction prediction{T_world_event_, velocity_, Matrix6d::Zero()};
  Vector6d acceleration = acceleration_;
  Matrix18d P = P_;
  Propagate(SecondsFromNs(t_ns - t_ns_), &prediction.T_world_event, &prediction.velocity_event, &acceleration, &P);
  prediction.covariance = P.topLeftCorner<6, 6>();
  return prediction;
}

void MotionFilter::Update(std::int64_t t_ns, const Rigid3& T_world_event, const Matrix6d& information) {
  Propagate(SecondsFromNs(t_ns - t_ns_), &T_world_event_, &velocity_, &acceleration_, &P_);
  t_ns_ = t_ns;
  const Matrix6d P_pose = P_.topLeftCorner<6, 6>();
  const Matrix6d I = Matrix6d::Identity();
  const Matrix6d P_pose_inverse = P_pose.ldlt().solve(I);
  // Conditioning on the pose: velocity and acceleration follow it as far as they are correlated with it.
  const Eigen::Matrix<double, 18, 6> gain = P_.leftCols<6>() * P_pose_inverse;
  const Vector6d moved = Log(T_world_event_.inverse() * T_world_event);
  velocity_ += gain.middleRows<6>(6) * moved;
  acceleration_ += gain.bottomRows<6>() * moved;
  T_world_event_ = T_world_event;
  const Matrix6d P_pose_after = (P_pose_inverse + information).ldlt().solve(I);
  P_ -= gain * (P_pose - P_pose_after) * gain.transpose();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

void MotionFilter::MeasureAngularVelocity(const Eigen::Vector3d& angular_velocity, double span_s, double sigma_rad_s) {
  // The mean over the span is the velocity at its middle.
  Eigen::Matrix<double, 3, 18> H = Eigen::Matrix<double, 3, 18>::Zero();
  H.block<3, 3>(0, 9).setIdentity();
  H.block<3, 3>(0, 15) = 0.5 * span_s * Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d S = H * P_ * H.transpose() + sigma_rad_s * sigma_rad_s * Eigen::Matrix3d::Identity();
  const Eigen::Matrix<double, 18, 3> gain = P_ * H.transpose() * S.inverse();
  const Eigen::Vector3d expected = velocity_.tail<3>() + 0.5 * span_s * acceleration_.tail<3>();
  const Vector18d correction = gain * (angular_velocity - expected);
  // The pose stays: it was measured to this time, and a gyroscope says nothing of where the camera was.
  velocity_ += correction.segment<6>(6);
  acceleration_ += correction.tail<6>();
  P_ -= gain * S * gain.transpose();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

void MotionFilter::HoldStill(std::int64_t t_ns) {
  t_ns_ = t_ns;
  velocity_.setZero();
  acceleration_.setZero();
  const Matrix6d P_pose = P_.topLeftCorner<6, 6>();
  P_.setZero();
  P_.topLeftCorner<6, 6>() = P_pose;
  P_.diagonal().segment<6>(6) = Both(kStillSpeed_m_s, kStillTurn_rad_s).cwiseAbs2();
  P_.diagonal().tail<6>() = Both(options_.acceleration_m_s2, options_.angular_acceleration_rad_s2).cwiseAbs2();
}

void MotionFilter::Coast(std::int64_t t_ns) {
  const double dt_s = SecondsFromNs(t_ns - t_ns_);
  Propagate(dt_s, &T_world_event_, &velocity_, &acceleration_, &P_);
  t_ns_ = t_ns;
  acceleration_.setZero();
  velocity_ *= std::exp(-dt_s / kCoast_s);
  // Coasting for long must not let the covariance overflow what a search can cover.
  P_ = P_ / std::max(1.0, P_.diagonal().head<6>().maxCoeff());
}

}  // namespace devo
