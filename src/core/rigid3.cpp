// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/rigid3.h"

#include <cmath>
#include <sstream>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <Eigen/SVD>

namespace devo {
namespace {

// Below this angle the closed forms lose digits and their Taylor series are exact in double.
constexpr double kSmallAngle = 1e-5;

/// Left Jacobian of SO(3), the V of Exp: translation = V * rho.
Eigen::Matrix3d LeftJacobianSO3(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const Eigen::Matrix3d W = Hat(phi);
  if (angle < kSmallAngle) return Eigen::Matrix3d::Identity() + 0.5 * W + W * W / 6.0;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / a2 * W +
         (angle - std::sin(angle)) / (a2 * angle) * W * W;
}

Matrix6d SmallAdjoint(const Vector6d& xi) {
  Matrix6d ad = Matrix6d::Zero();
  ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = Hat(xi.tail<3>());
  ad.topRightCorner<3, 3>() = Hat(xi.head<3>());
  return ad;
}

}  // namespace

Eigen::Matrix3d Hat(const Eigen::Vector3d& a) {
  Eigen::Matrix3d A;
  A << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return A;
}

Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const double half_sinc = angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
  const Eigen::Vector3d v = half_sinc * phi;
  return Eigen::Quaterniond(std::cos(0.5 * angle), v.x(), v.y(), v.z()).normalized();
}

Eigen::Vector3d LogSO3(const Eigen::Quaterniond& q_in) {
  // The two signs of a quaternion are one rotation; w >= 0 gives the angle in [0, pi].
  const Eigen::Quaterniond q = q_in.w() < 0 ? Eigen::Quaterniond(-q_in.coeffs()) : q_in;
  const double sine = q.vec().norm();
  if (sine < 1e-10) return 2.0 * q.vec();
  return 2.0 * std::atan2(sine, q.w()) / sine * q.vec();
}

Rigid3 Rigid3::FromMatrix(const Eigen::Matrix4d& T) {
  const auto fail = [&T](const char* what) {
    std::ostringstream message;
    message << "not a rigid transformation (" << what << "):\n" << T;
    throw std::invalid_argument(message.str());
  };
  if (!T.allFinite()) fail("values that are not finite");
  if ((T.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-6) fail("last row is not 0 0 0 1");
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  if ((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-3 || R.determinant() < 0) {
    fail("upper left block is not a rotation");
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d R_nearest = svd.matrixU() * svd.matrixV().transpose();
  return {Eigen::Quaterniond(R_nearest), T.topRightCorner<3, 1>()};
}

Eigen::Matrix4d Rigid3::matrix() const {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = rotation_.toRotationMatrix();
  T.topRightCorner<3, 1>() = translation_;
  return T;
}

Rigid3 Rigid3::inverse() const {
  const Eigen::Quaterniond q = rotation_.conjugate();
  return {q, -(q * translation_)};
}

Rigid3 Rigid3::operator*(const Rigid3& other) const {
  return {rotation_ * other.rotation_, rotation_ * other.translation_ + translation_};
}

Rigid3 Exp(const Vector6d& xi) { return {ExpSO3(xi.tail<3>()), LeftJacobianSO3(xi.tail<3>()) * xi.head<3>()}; }

Vector6d Log(const Rigid3& T) {
  Vector6d xi;
  xi.tail<3>() = LogSO3(T.rotation());
  xi.head<3>() = LeftJacobianSO3(xi.tail<3>()).inverse() * T.translation();
  return xi;
}

double ViewsApart(const Rigid3& T_a_b, double depth_m) {
  return T_a_b.translation().norm() / depth_m + RotationAngle(T_a_b);
}

double NormalisedSquare(const Vector6d& x, const Matrix6d& covariance) { return x.dot(covariance.ldlt().solve(x)); }

Matrix6d Adjoint(const Rigid3& T) {
  const Eigen::Matrix3d R = T.rotation().toRotationMatrix();
  Matrix6d A = Matrix6d::Zero();
  A.topLeftCorner<3, 3>() = A.bottomRightCorner<3, 3>() = R;
  A.topRightCorner<3, 3>() = Hat(T.translation()) * R;
  return A;
}

Matrix6d RightJacobian(const Vector6d& xi) {
  const Matrix6d ad = SmallAdjoint(xi);
  const Matrix6d ad2 = ad * ad;
  return Matrix6d::Identity() - ad / 2.0 + ad2 / 6.0 - ad2 * ad / 24.0 + ad2 * ad2 / 120.0;
}

Rigid3 Interpolate(const Rigid3& T_a, const Rigid3& T_b, double s) { return T_a * Exp(s * Log(T_a.inverse() * T_b)); }

double RotationAngle(const Rigid3& T) { return LogSO3(T.rotation()).norm(); }

}  // namespace devo
