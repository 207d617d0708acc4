// SPDX-License-Identifier: BSD-3-Clause
//
// Twists are [rho; phi] and act on the right, T * Exp(xi): the names below say "right" where it matters.
#include "devo/core/rigid3.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "numeric_jacobian.h"

namespace devo {
namespace {

/// Rotation angles that matter: none, where the series takes over from the closed form, large, almost a half turn.
const std::vector<double> kAngles_rad = {0, 1e-9, 0.9e-5, 1.1e-5, 1e-3, 0.1, 1, 3, M_PI - 1e-3, M_PI - 1e-7};

class Rigid3Test : public testing::Test {
 protected:
  Eigen::Vector3d RandomUnitVector() {
    std::normal_distribution<double> normal;
    return Eigen::Vector3d(normal(random_), normal(random_), normal(random_)).normalized();
  }
  Vector6d RandomTwist(double angle_rad, double length_m) {
    Vector6d xi;
    xi << length_m * RandomUnitVector(), angle_rad * RandomUnitVector();
    return xi;
  }

  std::mt19937 random_{7};
};

TEST_F(Rigid3Test, LogInvertsExpUpToAHalfTurn) {
  for (const double angle : kAngles_rad) {
    for (int i = 0; i < 20; ++i) {
      const Vector6d xi = RandomTwist(angle, 2);
      // Just below a half turn, the last digits of the quaternion decide the sign of the axis' small components.
      const double tolerance = angle > 3 ? 1e-6 : 1e-12;
      EXPECT_NEAR((Log(Exp(xi)) - xi).norm(), 0, tolerance) << "angle " << angle << ", twist " << xi.transpose();
    }
  }
}

TEST_F(Rigid3Test, ExpInvertsLogAtAHalfTurnWhereTheAxisHasTwoSigns) {
  for (int i = 0; i < 20; ++i) {
    const Rigid3 T = Exp(RandomTwist(M_PI, 1));
    EXPECT_TRUE(Exp(Log(T)).matrix().isApprox(T.matrix(), 1e-9)) << T.matrix();
    EXPECT_NEAR(RotationAngle(T), M_PI, 1e-9);
  }
}

TEST_F(Rigid3Test, ExpIsTheMatrixExponentialOfTheTwist) {
  for (const double angle : kAngles_rad) {
    const Vector6d xi = RandomTwist(angle, 0.5);
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    A.topLeftCorner<3, 3>() = Hat(xi.tail<3>());
    A.topRightCorner<3, 1>() = xi.head<3>();
    // The defining series; 40 terms are exact in double for |phi| <= pi.
    Eigen::Matrix4d term = Eigen::Matrix4d::Identity(), sum = term;
    for (int n = 1; n <= 40; ++n) {
      term = term * A / n;
      sum += term;
    }
    EXPECT_NEAR((Exp(xi).matrix() - sum).norm(), 0, 1e-11) << "angle " << angle;
  }
}

TEST_F(Rigid3Test, ExpOfATranslationIsThatTranslation) {
  Vector6d xi = Vector6d::Zero();
  xi.head<3>() << 1, -2, 3;
  EXPECT_TRUE(Exp(xi).translation().isApprox(Eigen::Vector3d(1, -2, 3)));
  EXPECT_EQ(RotationAngle(Exp(xi)), 0);
}

TEST_F(Rigid3Test, ARotationVectorAboutZTurnsXTowardsY) {
  const Eigen::Vector3d y = ExpSO3({0, 0, M_PI / 2}) * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(y.isApprox(Eigen::Vector3d::UnitY(), 1e-15));
}

TEST_F(Rigid3Test, LogIsTheSameForBothSignsOfAQuaternion) {
  const Eigen::Quaterniond q = ExpSO3({0.3, -0.2, 2.5});
  EXPECT_TRUE(LogSO3(q).isApprox(LogSO3(Eigen::Quaterniond(-q.coeffs())), 1e-12));
}

TEST_F(Rigid3Test, CompositionInverseAndMatrixAgree) {
  const Rigid3 T_a_b = Exp(RandomTwist(1.2, 2)), T_b_c = Exp(RandomTwist(2.1, 1));
  const Eigen::Vector3d p_c(0.3, -4, 2);
  EXPECT_TRUE((T_a_b * T_b_c * p_c).isApprox(T_a_b * (T_b_c * p_c), 1e-12));
  EXPECT_TRUE((T_a_b * T_b_c).matrix().isApprox(T_a_b.matrix() * T_b_c.matrix(), 1e-12));
  EXPECT_TRUE((T_a_b * T_a_b.inverse()).matrix().isApprox(Eigen::Matrix4d::Identity(), 1e-12));
}

TEST_F(Rigid3Test, AdjointMovesARightPerturbationToTheLeft) {
  for (const double angle : {0.0, 0.1, 1.0, 3.0}) {
    const Rigid3 T = Exp(RandomTwist(angle, 3));
    const Vector6d xi = RandomTwist(0.7, 0.4);
    EXPECT_TRUE((Exp(Adjoint(T) * xi) * T).matrix().isApprox((T * Exp(xi)).matrix(), 1e-12)) << T.matrix();
  }
}

TEST_F(Rigid3Test, RightJacobianIsTheNumericOneBelowItsStatedAngle) {
  for (const double angle : {0.0, 1e-3, 0.1, 0.29}) {
    const Vector6d xi = RandomTwist(angle, 0.2);
    const auto right_difference = [&xi](const Eigen::VectorXd& d) {
      return Eigen::VectorXd(Log(Exp(xi).inverse() * Exp(xi + Vector6d(d))));
    };
    EXPECT_TRUE(JacobianIsNear("right Jacobian of SE(3)", RightJacobian(xi), right_difference, Vector6d::Zero(), 5e-6))
        << "angle " << angle;
  }
}

TEST_F(Rigid3Test, InterpolationStartsAndEndsAtItsArgumentsAndExtrapolates) {
  const Rigid3 T_a = Exp(RandomTwist(0.4, 1));
  const Vector6d step = RandomTwist(0.6, 0.5);
  const Rigid3 T_b = T_a * Exp(step);
  EXPECT_TRUE(Interpolate(T_a, T_b, 0).matrix().isApprox(T_a.matrix(), 1e-12));
  EXPECT_TRUE(Interpolate(T_a, T_b, 1).matrix().isApprox(T_b.matrix(), 1e-12));
  EXPECT_TRUE(Interpolate(T_a, T_b, 0.25).matrix().isApprox((T_a * Exp(0.25 * step)).matrix(), 1e-12));
  EXPECT_TRUE(Interpolate(T_a, T_b, 2).matrix().isApprox((T_b * Exp(step)).matrix(), 1e-12));
}

TEST_F(Rigid3Test, FromMatrixRoundTripsAndCleansSmallErrors) {
  const Rigid3 T = Exp(RandomTwist(2, 1));
  EXPECT_TRUE(Rigid3::FromMatrix(T.matrix()).matrix().isApprox(T.matrix(), 1e-12));
  Eigen::Matrix4d rounded = T.matrix();
  rounded(0, 0) += 2e-4;  // a calibration file with four digits
  const Eigen::Matrix3d R = Rigid3::FromMatrix(rounded).matrix().topLeftCorner<3, 3>();
  EXPECT_NEAR((R * R.transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-12);
}

TEST_F(Rigid3Test, FromMatrixRejectsWhatIsNotARigidTransformationAndSaysWhy) {
  const auto message = [](const Eigen::Matrix4d& T) -> std::string {
    try {
      Rigid3::FromMatrix(T);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  Eigen::Matrix4d scaled = Eigen::Matrix4d::Identity();
  scaled.topLeftCorner<3, 3>() *= 1.01;
  Eigen::Matrix4d mirrored = Eigen::Matrix4d::Identity();
  mirrored(2, 2) = -1;
  Eigen::Matrix4d transposed = Eigen::Matrix4d::Identity();
  transposed(3, 0) = 0.07;  // column-major data read row by row
  Eigen::Matrix4d not_finite = Eigen::Matrix4d::Identity();
  not_finite(1, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message(scaled), testing::HasSubstr("not a rotation"));
  EXPECT_THAT(message(mirrored), testing::HasSubstr("not a rotation"));
  EXPECT_THAT(message(transposed), testing::HasSubstr("last row is not 0 0 0 1"));
  EXPECT_THAT(message(not_finite), testing::HasSubstr("not finite"));
}

TEST(Rigid3, ViewsAreApartByTheirShiftOverTheDepthAndTheirAngle) {
  const Rigid3 T = Rigid3::Translation({0, 0.2, 0}) * Rigid3::Rotation(ExpSO3({0.1, 0, 0}));
  EXPECT_NEAR(ViewsApart(T, 2), 0.2, 1e-9);
}

TEST(Rigid3, ThePerturbationOfOneStandardDeviationInEachDirectionHasANormalisedSquareOfSix) {
  Vector6d sigma;
  sigma << 1e-3, 2e-3, 0.1, 3e-4, 5, 0.02;
  EXPECT_NEAR(NormalisedSquare(sigma, sigma.cwiseAbs2().asDiagonal()), 6, 1e-9);
}

}  // namespace
}  // namespace devo
