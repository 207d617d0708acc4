// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_pose.h"

#include <Eigen/Eigenvalues>

namespace devo {
namespace {

constexpr double kLeast = 1;  // in m and rad: what is known is known to centimetres, of the rest there is nothing

}  // namespace

bool DepthPose::KnowsAllDirections() const {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()(0) > kLeast;
}

}  // namespace devo
