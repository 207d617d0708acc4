// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include <Eigen/SVD>
#include <nlohmann/json.hpp>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kDegreesPerRadian = 180.0 / 3.14159265358979323846;

struct Pair {
  std::int64_t t_ns;
  Rigid3 truth, estimate;
  const Matrix6d* covariance;  // of the estimate; null: not given
};

std::string Span(const char* name, const Trajectory& trajectory) {
  if (trajectory.empty()) return std::string(name) + " is empty";
  char text[128];
  std::snprintf(text, sizeof(text), "%s has %zu poses from %.3f s to %.3f s", name, trajectory.size(),
                SecondsFromNs(trajectory.front().t_ns), SecondsFromNs(trajectory.back().t_ns));
  return text;
}

std::vector<Pair> Associate(const Trajectory& truth, const Trajectory& estimate,
                            const std::vector<Matrix6d>& covariances, double max_gap_s) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const StampedPose& pose = estimate[i];
    const auto truth_pose = PoseAt(truth, pose.t_ns, NsFromSeconds(max_gap_s));
    if (!truth_pose) continue;
    pairs.push_back({pose.t_ns, *truth_pose, pose.T_world_body, covariances.empty() ? nullptr : &covariances[i]});
  }
  return pairs;
}

/// (Q_i^-1 Q_j)^-1 (P_i^-1 P_j): Q ground truth, P estimate.
Rigid3 RelativeError(const Pair& i, const Pair& j) {
  return (i.truth.inverse() * j.truth).inverse() * (i.estimate.inverse() * j.estimate);
}

/// e' C^-1 e / 6 of a relative error. With P = P_mean Exp(xi), P_i^-1 P_j = Z Exp(xi_j - Ad(Z^-1) xi_i) to first order.
double NormalisedErrorSquared(const Pair& i, const Pair& j) {
  const Matrix6d A = Adjoint((i.estimate.inverse() * j.estimate).inverse());
  const Matrix6d C = *j.covariance + A * *i.covariance * A.transpose();
  const Vector6d error = Log(RelativeError(i, j));
  return NormalisedSquare(error, C) / 6;
}

void AddStandstills(const std::vector<Pair>& pairs, Evaluation* result) {
  for (std::size_t begin = 0, end; begin < pairs.size(); begin = end + 1) {
    for (end = begin; end + 1 < pairs.size(); ++end) {
      const double dt_s = SecondsFromNs(pairs[end + 1].t_ns - pairs[end].t_ns);
      const Rigid3 step = pairs[end].truth.inverse() * pairs[end + 1].truth;
      if (step.translation().norm() > kStill_m_s * dt_s ||
          RotationAngle(step) * kDegreesPerRadian > kStill_deg_s * dt_s)
        break;
    }
    const double span_s = SecondsFromNs(pairs[end].t_ns - pairs[begin].t_ns);
    if (span_s < kStill_s) continue;
    result->still_s += span_s;
    for (std::size_t i = begin; i <= end; ++i) {
      const Rigid3 drift = RelativeError(pairs[begin], pairs[i]);
      result->still_drift_m = std::max(result->still_drift_m, drift.translation().norm());
      result->still_drift_deg = std::max(result->still_drift_deg, RotationAngle(drift) * kDegreesPerRadian);
    }
  }
}

void AddAbsoluteError(const std::vector<Pair>& pairs, Evaluation* result) {
  Eigen::Matrix3Xd truth(3, pairs.size()), estimate(3, pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    truth.col(i) = pairs[i].truth.translation();
    estimate.col(i) = pairs[i].estimate.translation();
  }
  result->T_truth_estimate = AlignPoints(truth, estimate);
  double sum = 0;
  Eigen::Vector3d last_error = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d error =
        result->T_truth_estimate * pairs[i].estimate.translation() - pairs[i].truth.translation();
    sum += error.squaredNorm();
    result->ate_max_m = std::max(result->ate_max_m, error.norm());
    if (i > 0) {
      result->max_step_m = std::max(result->max_step_m, (error - last_error).norm());
      result->path_length_m += (pairs[i].truth.translation() - pairs[i - 1].truth.translation()).norm();
    }
    last_error = error;
  }
  result->ate_rmse_m = std::sqrt(sum / static_cast<double>(pairs.size()));
  if (result->path_length_m >= kLeastPath_m) result->drift_percent = 100 * result->ate_rmse_m / result->path_length_m;
}

void AddRelativeError(const std::vector<Pair>& pairs, const EvaluationOptions& options, Evaluation* result) {
  const std::int64_t interval_ns = NsFromSeconds(options.rpe_interval_s);
  const std::int64_t tolerance_ns = NsFromSeconds(options.max_gap_s) / 2;
  double rotation = 0, translation = 0, nees = 0;
  for (const Pair& i : pairs) {
    const std::int64_t t_ns = i.t_ns + interval_ns;
    auto j =
        std::lower_bound(pairs.begin(), pairs.end(), t_ns, [](const Pair& p, std::int64_t t) { return p.t_ns < t; });
    if (j == pairs.end()) break;  // not the last pose again and again, nearer than the interval
    if (j != pairs.begin() && std::abs((j - 1)->t_ns - t_ns) < std::abs(j->t_ns - t_ns)) --j;
    if (std::abs(j->t_ns - t_ns) > tolerance_ns) continue;
    const Rigid3 error = RelativeError(i, *j);
    rotation += std::pow(RotationAngle(error), 2);
    translation += error.translation().squaredNorm();
    if (i.covariance) nees += NormalisedErrorSquared(i, *j);
    ++result->rpe_pairs;
  }
  const Rigid3 whole = RelativeError(pairs.front(), pairs.back());
  result->final_rotation_deg = RotationAngle(whole) * kDegreesPerRadian;
  result->final_translation_m = whole.translation().norm();
  if (result->rpe_pairs == 0) return;
  const auto n = static_cast<double>(result->rpe_pairs);
  result->rpe_rotation_rmse_deg = std::sqrt(rotation / n) * kDegreesPerRadian;
  result->rpe_translation_rmse_cm = std::sqrt(translation / n) * 100;
  result->nees = nees / n;
}

double Coverage(const Trajectory& truth, const std::vector<Pair>& pairs, double max_gap_s) {
  const std::int64_t span_ns = truth.back().t_ns - truth.front().t_ns;
  if (span_ns <= 0) return 0;
  std::int64_t covered_ns = 0;
  for (std::size_t i = 1; i < pairs.size(); ++i) {
    const std::int64_t step_ns = pairs[i].t_ns - pairs[i - 1].t_ns;
    if (step_ns <= NsFromSeconds(max_gap_s)) covered_ns += step_ns;
  }
  return static_cast<double>(covered_ns) / static_cast<double>(span_ns);
}

}  // namespace

Rigid3 AlignPoints(const Eigen::Matrix3Xd& truth, const Eigen::Matrix3Xd& estimate) {
  const Eigen::Vector3d truth_mean = truth.rowwise().mean(), estimate_mean = estimate.rowwise().mean();
  const Eigen::Matrix3d covariance = (truth.colwise() - truth_mean) * (estimate.colwise() - estimate_mean).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) signs.z() = -1;  // a reflection is no motion
  const Eigen::Matrix3d R = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  return {Eigen::Quaterniond(R), truth_mean - R * estimate_mean};
}

Evaluation Evaluate(const Trajectory& truth, const Trajectory& estimate, const EvaluationOptions& options,
                    const std::vector<Matrix6d>& covariances) {
  if (!covariances.empty() && covariances.size() != estimate.size()) {
    throw std::invalid_argument("evaluation: " + std::to_string(covariances.size()) +
                                " covariances, expected one for each of " + std::to_string(estimate.size()) + " poses");
  }
  const std::vector<Pair> pairs = Associate(truth, estimate, covariances, options.max_gap_s);
  if (pairs.size() < 3) {
    throw std::runtime_error("evaluation: only " + std::to_string(pairs.size()) +
                             " poses have ground truth, expected at least 3; " + Span("ground truth", truth) + ", " +
                             Span("estimate", estimate));
  }
  Evaluation result;
  result.pairs = pairs.size();
  AddAbsoluteError(pairs, &result);
  AddRelativeError(pairs, options, &result);
  AddStandstills(pairs, &result);
  result.coverage = Coverage(truth, pairs, options.max_gap_s);
  return result;
}

std::string DriftText(const Evaluation& e, int digits) {
  char text[96];
  if (e.drift_percent) {
    std::snprintf(text, sizeof(text), "%.*f %% of %.*f m", digits, *e.drift_percent, digits, e.path_length_m);
  } else {
    std::snprintf(text, sizeof(text), "a path of %.*f m", digits, e.path_length_m);
  }
  return text;
}

std::string RpeText(const Evaluation& e) {
  if (e.rpe_pairs == 0) return "no RPE: the poses with ground truth span less than the interval";
  char text[96];
  std::snprintf(text, sizeof(text), "RPE over 1 s %.2f deg %.2f cm", e.rpe_rotation_rmse_deg,
                e.rpe_translation_rmse_cm);
  return text;
}

std::string ToJson(const Evaluation& e) {
  // null, not zero: a recording shorter than the interval has no relative error, one that never rests none at rest.
  const auto or_null = [](bool known, double value) { return known ? nlohmann::json(value) : nlohmann::json(); };
  nlohmann::json json;
  json["pairs"] = e.pairs;
  json["ate_rmse_m"] = e.ate_rmse_m;
  json["ate_max_m"] = e.ate_max_m;
  json["path_length_m"] = e.path_length_m;
  json["drift_percent"] = or_null(e.drift_percent.has_value(), e.drift_percent.value_or(0));
  json["rpe_pairs"] = e.rpe_pairs;
  json["rpe_rotation_rmse_deg"] = or_null(e.rpe_pairs > 0, e.rpe_rotation_rmse_deg);
  json["rpe_translation_rmse_cm"] = or_null(e.rpe_pairs > 0, e.rpe_translation_rmse_cm);
  json["nees"] = or_null(e.nees > 0, e.nees);
  json["still_s"] = e.still_s;
  json["still_drift_m"] = or_null(e.still_s > 0, e.still_drift_m);
  json["still_drift_deg"] = or_null(e.still_s > 0, e.still_drift_deg);
  json["final_rotation_deg"] = e.final_rotation_deg;
  json["final_translation_m"] = e.final_translation_m;
  json["max_step_m"] = e.max_step_m;
  json["coverage"] = e.coverage;
  return json.dump(2);
}

}  // namespace devo
