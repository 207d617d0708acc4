// SPDX-License-Identifier: BSD-3-Clause
//
// Error of an estimated trajectory against ground truth, as defined by Sturm et al., "A Benchmark for the Evaluation of
// RGB-D SLAM Systems" (IROS 2012), with the relative pose error in the order of the DEVO paper.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "devo/io/trajectory.h"

namespace devo {

struct EvaluationOptions {
  double max_gap_s = 0.1;       ///< ground truth is interpolated over shorter gaps only
  double rpe_interval_s = 1.0;  ///< distance in time of the poses that the relative error compares
};

struct Evaluation {
  std::size_t pairs = 0;      ///< estimated poses that have ground truth
  std::size_t rpe_pairs = 0;  ///< pairs of them one interval apart; 0: no relative error
  double ate_rmse_m = 0;      ///< after SE(3) alignment without scale
  double ate_max_m = 0;
  double rpe_rotation_rmse_deg = 0;
  double rpe_translation_rmse_cm = 0;
  double final_rotation_deg = 0;  ///< of the relative motion from the first to the last pair
  double final_translation_m = 0;
  /// Mean of e' C^-1 e / 6 over the relative errors e, with C from the covariances of both poses taken as independent;
  /// about 1 where they are honest, below where they are cautious. Zero without covariances.
  double nees = 0;
  /// Largest motion of the estimate within a standstill of the truth, and the standstills' time; see kStill_*.
  double still_drift_m = 0, still_drift_deg = 0, still_s = 0;
  double max_step_m = 0;     ///< largest change of the position error between consecutive estimates (jumps)
  double coverage = 0;       ///< share of the ground truth's span that the estimate covers without gaps, 0..1
  double path_length_m = 0;  ///< of the ground truth at the pairs
  /// ATE in percent of the path's length; none where that is below kLeastPath_m: pure rotation, a standstill.
  std::optional<double> drift_percent;
  Rigid3 T_truth_estimate;  ///< the alignment
};

/// The shortest path that an error is given a share of.
constexpr double kLeastPath_m = 0.02;

/// A standstill: slower than this for at least half a second.
constexpr double kStill_m_s = 2e-3, kStill_deg_s = 0.1, kStill_s = 0.5;

/// Associates by interpolating `truth` at the estimate's stamps. Throws std::runtime_error naming the spans of both
/// when fewer than three poses have ground truth. `covariances`: of a right perturbation [rho; phi] (m, rad) of each
/// pose of `estimate`, or empty.
Evaluation Evaluate(const Trajectory& truth, const Trajectory& estimate, const EvaluationOptions& options = {},
                    const std::vector<Matrix6d>& covariances = {});

/// Rigid transformation T minimising sum |truth_i - T estimate_i|^2 (Umeyama 1991 without scale). 3 x n each, n >= 1.
Rigid3 AlignPoints(const Eigen::Matrix3Xd& truth, const Eigen::Matrix3Xd& estimate);

/// "0.54 % of 2.19 m", or "a path of 0.00 m" where there is no share.
std::string DriftText(const Evaluation& evaluation, int digits);

/// "RPE over 1 s 0.21 deg 0.50 cm", of the default interval, or that there is none.
std::string RpeText(const Evaluation& evaluation);

/// As one JSON object.
std::string ToJson(const Evaluation& evaluation);

}  // namespace devo
