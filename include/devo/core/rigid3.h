// SPDX-License-Identifier: BSD-3-Clause
//
// Rigid transformations. `T_a_b` maps points of frame b to frame a: p_a = T_a_b * p_b.
//
// One perturbation convention in the whole package: twists are [rho; phi] (translation first, then
// rotation vector) and act on the RIGHT: T * Exp(xi), that is, in the frame of the second index.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace devo {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Skew-symmetric matrix with Hat(a) * b = a x b.
Eigen::Matrix3d Hat(const Eigen::Vector3d& a);

/// Exponential of so(3): rotation by the angle |phi| (rad) about phi / |phi|.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& phi);

/// Logarithm of SO(3), |phi| in [0, pi].
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& q);

class Rigid3 {
 public:
  /// The identity.
  Rigid3() : rotation_(Eigen::Quaterniond::Identity()), translation_(Eigen::Vector3d::Zero()) {}

  /// `rotation` is normalised; `translation` in metres.
  Rigid3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation) {}

  /// From a 4x4 matrix whose last row is 0 0 0 1. Throws std::invalid_argument when the upper left
  /// block is not a rotation to within 1e-3 (it is then projected onto SO(3)) or a value is not finite.
  static Rigid3 FromMatrix(const Eigen::Matrix4d& T);

  static Rigid3 Translation(const Eigen::Vector3d& t) { return {Eigen::Quaterniond::Identity(), t}; }
  static Rigid3 Rotation(const Eigen::Quaterniond& q) { return {q, Eigen::Vector3d::Zero()}; }

  const Eigen::Quaterniond& rotation() const { return rotation_; }
  const Eigen::Vector3d& translation() const { return translation_; }
  Eigen::Matrix4d matrix() const;

  Rigid3 inverse() const;
  bool IsFinite() const { return rotation_.coeffs().allFinite() && translation_.allFinite(); }

  Rigid3 operator*(const Rigid3& other) const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return rotation_ * p + translation_; }

 private:
  Eigen::Quaterniond rotation_;
  Eigen::Vector3d translation_;
};

/// Exponential of se(3), xi = [rho; phi] (Barfoot, State Estimation for Robotics, eq. 7.85).
Rigid3 Exp(const Vector6d& xi);

/// Logarithm of SE(3), inverse of Exp for rotations below pi.
Vector6d Log(const Rigid3& T);

/// Adjoint of T_a_b: Exp(Adjoint(T) * xi) * T = T * Exp(xi), for [rho; phi] ordering.
Matrix6d Adjoint(const Rigid3& T);

/// How far two views of a scene are apart: the shift, as a share of the scene's depth, plus the angle, rad.
double ViewsApart(const Rigid3& T_a_b, double depth_m);

/// x' C^-1 x of a perturbation and its covariance: 6 in the mean where that is honest (Mahalanobis).
double NormalisedSquare(const Vector6d& x, const Matrix6d& covariance);

/// Right Jacobian of SE(3): Exp(xi + d) ~ Exp(xi) * Exp(RightJacobian(xi) * d).
/// Series to fourth order in ad(xi): accurate to 5e-6 for |phi| < 0.3 rad.
Matrix6d RightJacobian(const Vector6d& xi);

/// The transformation a share `s` of the way from `T_a` (s = 0) to `T_b` (s = 1) along the screw
/// motion between them; s outside [0, 1] extrapolates.
Rigid3 Interpolate(const Rigid3& T_a, const Rigid3& T_b, double s);

/// Rotation angle of T in radians, [0, pi].
double RotationAngle(const Rigid3& T);

}  // namespace devo
