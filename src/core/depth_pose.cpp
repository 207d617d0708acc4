// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace devo {
namespace {

constexpr double kOpen_m = 1;  // in directions that depth leaves open, also in radians
constexpr double kLeast = 1;   // in m and rad: what is known is known to centimetres, of the rest there is nothing

// Of the variance that is stated of a pose. What errs alike in image after image is in it, too: taken for all of it, a
// full turn would drift as depth alone does.
constexpr double kCorrectedShare = 0.25;

/// (H^-1 + p s^2 p')^-1, where H may be singular and s zero.
Matrix6d InformationOnPlace(const DepthPose& depth) {
  const Vector6d told = depth.delay_sigma_s * (depth.information * depth.per_delay);
  return depth.information - told * told.transpose() / (1 + depth.delay_sigma_s * depth.per_delay.dot(told));
}

}  // namespace

Rigid3 Corrected(const Rigid3& T_world_event, const Matrix6d& covariance, const DepthPose& depth) {
  const Matrix6d I = Matrix6d::Identity();
  const Vector6d apart = Log(T_world_event.inverse() * depth.T_world_event);
  const double square = depth.SquareApart(T_world_event, covariance);
  const bool contradicts = square > kHardlyTheSame;
  if (contradicts && !depth.confirmed) return T_world_event;
  // Such a pose is as wrong as depth says, but for what may be the delay.
  const double share_of_stated = contradicts ? square / kHardlyTheSame : kCorrectedShare;
  const Matrix6d share = share_of_stated * covariance * InformationOnPlace(depth);
  // (C^-1 + H)^-1 H, where both may be singular.
  return T_world_event * Exp((I + share).partialPivLu().solve(share * apart));
}

double DepthPose::SquareApart(const Rigid3& T_world_other, const Matrix6d& covariance) const {
  return NormalisedSquare(Log(T_world_other.inverse() * T_world_event), covariance + CovarianceOfPlace());
}

bool DepthPose::Contradicts(const Rigid3& T_world_other, const Matrix6d& covariance) const {
  return SquareApart(T_world_other, covariance) > kHardlyTheSame;
}

Matrix6d DepthPose::Covariance() const {
  const Matrix6d I = Matrix6d::Identity();
  return (information + I / (kOpen_m * kOpen_m)).ldlt().solve(I);
}

Matrix6d DepthPose::CovarianceOfPlace() const {
  return Covariance() + delay_sigma_s * delay_sigma_s * per_delay * per_delay.transpose();
}

bool DepthPose::KnowsAllDirections() const {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()(0) > kLeast;
}

Matrix6d DepthPose::KnownDirections() const {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
  const Vector6d known = (eigen.eigenvalues().array() > kLeast).cast<double>();
  return eigen.eigenvectors() * known.asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace devo
