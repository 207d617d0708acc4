// SPDX-License-Identifier: BSD-3-Clause
//
// What an alignment finds: the pose that maximises prediction and measurement together.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "devo/core/motion_filter.h"

namespace devo {

/// To first order; `T_world_measured`: what the measurement says alone, with this information on a right perturbation.
inline Rigid3 MostProbable(const MotionFilter::Prediction& predicted, const Rigid3& T_world_measured,
                           const Matrix6d& information) {
  const Matrix6d prior = predicted.aligned_covariance.inverse();
  const Vector6d to_measured = Log(predicted.T_world_aligned.inverse() * T_world_measured);
  return predicted.T_world_aligned * Exp((prior + information).ldlt().solve(information * to_measured));
}

}  // namespace devo
