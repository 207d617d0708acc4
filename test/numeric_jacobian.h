// SPDX-License-Identifier: BSD-3-Clause
//
// The one way in which tests check an analytic Jacobian: against central differences, both printed on failure.
#pragma once

#include <algorithm>

#include <gtest/gtest.h>
#include <Eigen/Core>

namespace devo {

/// Central differences of f: R^n -> R^m at `x`; f takes and returns Eigen vectors. The error is of the order
/// of step^2, and of 1e-16 / step.
template <typename Function>
Eigen::MatrixXd NumericJacobian(const Function& f, const Eigen::VectorXd& x, double step = 1e-6) {
  const Eigen::Index rows = Eigen::VectorXd(f(x)).size();
  Eigen::MatrixXd J(rows, x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    Eigen::VectorXd ahead = x, behind = x;
    ahead[i] += step;
    behind[i] -= step;
    J.col(i) = (Eigen::VectorXd(f(ahead)) - Eigen::VectorXd(f(behind))) / (2 * step);
  }
  return J;
}

/// Use: EXPECT_TRUE(JacobianIsNear("d pixel / d pose", J, f, x)). `tolerance` is relative to the largest entry,
/// absolute below 1.
template <typename Function>
testing::AssertionResult JacobianIsNear(const char* name, const Eigen::MatrixXd& analytic, const Function& f,
                                        const Eigen::VectorXd& x, double tolerance = 1e-6, double step = 1e-6) {
  const Eigen::MatrixXd numeric = NumericJacobian(f, x, step);
  if (analytic.rows() != numeric.rows() || analytic.cols() != numeric.cols()) {
    return testing::AssertionFailure() << name << ": " << analytic.rows() << "x" << analytic.cols() << ", expected "
                                       << numeric.rows() << "x" << numeric.cols();
  }
  const double scale = std::max(1.0, numeric.cwiseAbs().maxCoeff());
  const double error = (analytic - numeric).cwiseAbs().maxCoeff();
  // Negated, so that NaN fails too.
  if (!(error <= tolerance * scale)) {
    return testing::AssertionFailure() << name << " at " << x.transpose() << "\nanalytic\n"
                                       << analytic << "\nnumeric\n"
                                       << numeric << "\nlargest difference " << error;
  }
  return testing::AssertionSuccess();
}

}  // namespace devo
