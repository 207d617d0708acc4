// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/alignment.h"

#include <algorithm>
#include <cmath>

#include <ceres/tiny_solver.h>
#include <ceres/version.h>
#include <Eigen/Eigenvalues>

#include "devo/core/alignment_problem.h"
#include "devo/core/edge_lag.h"
#include "devo/core/edge_motion.h"

namespace devo {
namespace {

// A point whose guessed depth may place it so far off, across its edge, counts half. That is less than an edge's own
// error, as neighbours' guesses are wrong alike.
constexpr float kTolerated_px = 0.15F;
constexpr int kMinMatched = 30;  // fewer points hold no pose, however large their share
// Far from their edges points find their way; near to them what is still farther off than this share of the truncation
// is most often beside another edge, and what the loss tolerates may be as much smaller.
constexpr double kFineShare = 0.5;
// Fall of the cost per point, as a share of the squared truncation, below which matches flicker and the pose does not
// get better.
constexpr double kConverged = 1e-5;
constexpr double kRidge = 1e-9;  // of the trace, where all points move alike

/// Points that should show in the surface, with what their edges look like from the start pose.
void PreparePoints(const std::vector<MapPoint>& points, const Surface& surface, const Camera& camera,
                   const PosePrior& prior, const Vector6d& velocity_event, const OdometryOptions& options,
                   std::vector<AlignmentPoint>* prepared) {
  const TrackingIdeas& ideas = options.tracking.ideas;
  const Eigen::Matrix3f R = prior.T_event_ref.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = prior.T_event_ref.translation().cast<float>();
  const auto window_s = static_cast<float>(surface.window_s), lag_px = static_cast<float>(options.surface.edge_lag_px);
  const Eigen::Matrix<float, 6, 1> velocity = velocity_event.cast<float>();
  const Eigen::Matrix3f P_way = prior.position_covariance.cast<float>();
  const Eigen::Matrix<float, 6, 6> L_t = prior.sqrt_velocity_covariance.transpose().cast<float>();
  prepared->clear();
  prepared->reserve(points.size());
  for (const MapPoint& point : points) {
    const Eigen::Vector3f p = R * point.p_ref + t;
    if (p.z() < kNearest_m) continue;
    const Eigen::Vector2f u(static_cast<float>(camera.fx()) * p.x() / p.z() + static_cast<float>(camera.cx()),
                            static_cast<float>(camera.fy()) * p.y() / p.z() + static_cast<float>(camera.cy()));
    if (!camera.Contains(u.cast<double>(), 2)) continue;
    AlignmentPoint out{point.p_ref, 0, 0, 0, 1};
    if (!point.normal_ref.isZero()) {
      const Eigen::Vector2f normal = ProjectNormal(point.normal_ref, R, p);
      const Eigen::Matrix<float, 6, 1> per_motion = ImageVelocityAlong(normal, p, camera),
                                       along = window_s * per_motion;
      const float across_px = along.dot(velocity);
      if (ideas.match_direction) {
        out.normal_x = normal.x();
        out.normal_y = normal.y();
        out.lag_strength = LagStrength(across_px, (L_t * along).norm(), lag_px);
      }
      if (ideas.visibility_weight) out.expected = VisibilityOfMotion(across_px);
      if (!point.sigma_depth_ref.isZero()) {
        const Eigen::Vector3f px_per_m = per_motion.head<3>();
        // A point moves through the image as it does when the camera moves the other way.
        const float by_depth_px = px_per_m.dot(R * point.sigma_depth_ref);
        // Nor is the way of the camera known, which would show such a depth as another.
        const float depth_share = point.sigma_depth_ref.norm() / p.norm();
        const float by_way_px2 = depth_share * depth_share * px_per_m.dot(P_way * px_per_m);
        out.expected /= 1 + (by_depth_px * by_depth_px + by_way_px2) / (kTolerated_px * kTolerated_px);
      }
      if (ideas.match_polarity && std::abs(across_px) > kClearMotion_px) {
        out.polarity = -std::copysign(point.sign, point.sign * across_px);
      }
    }
    prepared->push_back(out);
  }
}

void CountMatches(const AlignmentProblem& problem, AlignmentResult* result) {
  double expected = 0, met = 0, residual = 0;
  int visible = 0, matched = 0;
  problem.ForViews(result->T_event_ref, [&](const AlignmentPoint& point, const AlignmentProblem::View& view) {
    if (!view.in_front) return;
    const auto sample = problem.SampleField(point, view.u, view.v);
    ++visible;
    expected += point.expected;
    if (!sample.matched || std::abs(sample.value) > 0.5F * problem.truncation()) return;
    ++matched;
    met += point.expected;
    residual += std::abs(sample.value);
  });
  result->visible = visible;
  result->matched = matched;
  result->inlier_share = matched >= kMinMatched ? met / expected : 0;
  result->mean_residual_px = matched > 0 ? residual / matched : 0;
}

/// Of the information of points what their edges' normals can tell. A normal that is off by an angle has its point
/// measure that much of its way along the edge, of which it shows nothing: along stripes, hundreds of points would know
/// to a millimetre what none of them sees (errors in variables). Of a direction that is told no better than so nothing
/// is left, and of one that is told n times as well all but its 1/n^2.
Matrix6d BeyondNormals(const Matrix6d& information, const AlignmentProblem::Normals& normals) {
  const double ridge = kRidge * information.trace();
  if (!(ridge > 0 && normals.angle_variance > 0)) return information;
  const Matrix6d across_and_along = information + normals.along + ridge * Matrix6d::Identity();
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix6d> eigen(information, across_and_along);
  Vector6d kept = eigen.eigenvalues();  // of each direction's information what is told across edges
  for (int k = 0; k < 6; ++k) {
    const double across = kept(k), by_noise = normals.angle_variance * (1 - across);
    kept(k) = across > by_noise ? across - by_noise * by_noise / across : 0;
  }
  const Matrix6d V = across_and_along * eigen.eigenvectors();
  return V * kept.asDiagonal() * V.transpose();
}

struct Minimum {
  double cost;           // mean over the points
  Matrix6d information;  // of the points
};

/// Brings the pose of `result`, at which the problem was made, to the minimum, in what is left of all iterations.
Minimum Minimise(const AlignmentProblem& problem, int max_iterations, AlignmentResult* result) {
  ceres::TinySolver<CompressedProblem> solver;
  solver.options.max_num_iterations = max_iterations - result->iterations;
  solver.options.parameter_tolerance = 1e-6;
  const double function_tolerance = kConverged * std::pow(problem.truncation(), 2) * problem.NumResiduals();
#if CERES_VERSION_MAJOR > 2 || (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1)
  solver.options.function_tolerance = function_tolerance;
  const CompressedProblem compressed(problem);
#else
  const CompressedProblem compressed(problem, function_tolerance);
#endif
  Vector6d delta = Vector6d::Zero();
  const auto summary = solver.Solve(compressed, &delta);
  result->T_event_ref = result->T_event_ref * Exp(delta);
  result->iterations += summary.iterations;
  return {summary.final_cost / std::max(problem.NumResiduals() - 6, 1), compressed.SumsAt(delta).of_points};
}

}  // namespace

AlignmentResult Align(const std::vector<MapPoint>& points, const Surface& surface, const Camera& camera,
                      const PosePrior& prior, const Vector6d& velocity_event, const OdometryOptions& options) {
  // Kept from call to call, so that nothing is allocated per pose.
  thread_local std::vector<AlignmentPoint> prepared;
  PreparePoints(points, surface, camera, prior, velocity_event, options, &prepared);
  AlignmentResult result;
  result.T_event_ref = prior.T_event_ref;
  const TrackingIdeas& ideas = options.tracking.ideas;
  const auto note = [&](const AlignmentProblem& problem, const Matrix6d& information) {
    result.information = result.credible_information = information;
    if (prior.doubt_normals)
      result.credible_information = BeyondNormals(information, problem.NormalsAt(result.T_event_ref));
  };
  const AlignmentProblem coarse(prepared, surface, camera, prior, result.T_event_ref, options);
  const Minimum near = Minimise(coarse, options.tracking.max_iterations, &result);
  result.cost = near.cost;
  const bool may_go_on = result.iterations < options.tracking.max_iterations;
  if (ideas.fine_alignment && may_go_on && !surface.nearest_edge.empty()) {
    const AlignmentProblem fine(prepared, surface, camera, prior, result.T_event_ref, options, kFineShare);
    const Minimum nearer = Minimise(fine, options.tracking.max_iterations, &result);
    note(fine, nearer.information);
  } else {
    note(coarse, near.information);
  }
  CountMatches(coarse, &result);
  return result;
}

}  // namespace devo
