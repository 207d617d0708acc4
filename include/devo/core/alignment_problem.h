// SPDX-License-Identifier: BSD-3-Clause
//
// Residuals and Jacobian of the 3D-2D alignment, and both compressed to the form that ceres::TinySolver minimises.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "devo/core/alignment.h"

namespace devo {

/// A map point as the alignment sees it at the start pose.
struct AlignmentPoint {
  Eigen::Vector3f p_ref;
  float normal_x, normal_y;  ///< expected normal of its edge in the image; 0, 0 unknown
  float polarity;            ///< expected polarity of its events: -1, 1, or 0 unknown
  float expected;            ///< share of its events that its motion lets expect, 0.1 to 1
  float lag_strength = 0;    ///< of its edge along the expected normal (LagStrength)
};

/// Parameters: dtheta = [rho; phi], a right perturbation of `T_event_ref` (forward compositional: it acts on the points
/// in the frame `ref`). Residuals: one per point, the square root of its robust cost, then six of the prior.
class AlignmentProblem {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = 6 };

  /// `surface`, `points` and `camera` must outlive the problem.
  AlignmentProblem(const std::vector<AlignmentPoint>& points, const Surface& surface, const Camera& camera,
                   const PosePrior& prior, const Rigid3& T_event_ref, const OdometryOptions& options);

  int NumResiduals() const { return static_cast<int>(points_.size()) + 6; }

  /// `jacobian` is NumResiduals() x 6, column-major, with respect to `dtheta`; may be null.
  bool operator()(const double* dtheta, double* residuals, double* jacobian) const;

  /// Sums over all residuals r and their Jacobian J with respect to `dtheta`.
  struct Sums {
    Matrix6d information;  ///< J'J
    Matrix6d of_points;    ///< the same of the points alone, without the prior
    Vector6d gradient;     ///< J'r
    double squared_norm;   ///< r'r
  };
  /// Without storing a row per point. Only `squared_norm` is set when `with_jacobian` is false.
  Sums SumsAt(const Vector6d& dtheta, bool with_jacobian) const;

  /// Signed distance of a point's projection to its edge in pixels (or the paper's field, 0 to 1).
  struct Sample {
    bool matched = false;
    float value = 0;
    float gradient_x = 0, gradient_y = 0;  ///< with respect to the pixel
  };
  Sample SampleField(const AlignmentPoint& point, float u, float v) const;

  /// Unmatched points cost as much as a matched one at this distance.
  float truncation() const { return truncation_; }

 private:
  /// One point's residual at `T` = (R, t) and, where it is matched, its row of the Jacobian with respect to a right
  /// perturbation of T. Returns whether it is matched.
  bool PointRow(const AlignmentPoint& point, const Eigen::Matrix3f& R, const Eigen::Vector3f& t, float* residual,
                Eigen::Matrix<float, 6, 1>* row) const;
  /// The prior's six residuals and their Jacobian with respect to `dtheta`, T = T_event_ref * Exp(dtheta).
  Vector6d PriorResidual(const Rigid3& T) const;
  Matrix6d PriorJacobian(const Rigid3& T, const Matrix6d& J_r) const;
  Sample SampleNearestEdge(const AlignmentPoint& point, float u, float v) const;
  Sample SamplePlainSurface(float u, float v) const;

  const std::vector<AlignmentPoint>& points_;
  const Surface& surface_;
  const Camera& camera_;
  PosePrior prior_;
  Rigid3 T_event_ref_;
  bool plain_;
  float truncation_, huber_;
  float unmatched_;  // residual of a point without match
};

/// The problem as seven residuals with the same J'J, J'r and r'r as all of them, so that the solver takes the same
/// steps with matrices of fixed size: nothing is allocated, and the points' rows are never stored.
class CompressedProblem {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = 7, NUM_PARAMETERS = 6 };

  explicit CompressedProblem(const AlignmentProblem& problem) : problem_(problem) {}
  bool operator()(const double* dtheta, double* residuals, double* jacobian) const;

 private:
  const AlignmentProblem& problem_;
};

/// Smallest cosine between the normals of a point and of an edge that may match.
constexpr float kMinNormalCosine = 0.8F;

}  // namespace devo
