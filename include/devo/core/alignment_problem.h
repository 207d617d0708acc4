// SPDX-License-Identifier: BSD-3-Clause
//
// Residuals and Jacobian of the 3D-2D alignment, and both compressed to the form that ceres::TinySolver minimises.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "devo/core/alignment.h"

namespace devo {

/// Nearer points are taken for none in view.
constexpr float kNearest_m = 0.05F;

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

  /// `surface`, `points` and `camera` must outlive the problem. `truncation_share`: of the options' truncation, and of
  /// where the loss turns linear; up to 1, as far as the surface's field reaches.
  AlignmentProblem(const std::vector<AlignmentPoint>& points, const Surface& surface, const Camera& camera,
                   const PosePrior& prior, const Rigid3& T_event_ref, const OdometryOptions& options,
                   double truncation_share = 1);

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
  /// Without storing a row per point.
  Sums SumsAt(const Vector6d& dtheta) const;

  /// What the normals of the edges that points meet are worth.
  struct Normals {
    /// J'J of the same points, were their distances measured along the edges in place of across.
    Matrix6d along = Matrix6d::Zero();
    /// Of the angle between a point's normal, as its edge had it when the point was made, and that of the edge it meets
    /// now, rad^2: it has the noise of both.
    double angle_variance = 0;
  };
  /// At T_event_ref, over the points that meet an edge of their direction; zero in the paper's field, which has none.
  Normals NormalsAt(const Rigid3& T_event_ref) const;

  /// Signed distance of a point's projection to its edge in pixels (or the paper's field, 0 to 1).
  struct Sample {
    bool matched = false;
    float value = 0;
    float gradient_x = 0, gradient_y = 0;  ///< with respect to the pixel
  };
  Sample SampleField(const AlignmentPoint& point, float u, float v) const;

  /// A point seen from a pose.
  struct View {
    Eigen::Vector3f p_event;  ///< m
    float u, v;               ///< px; not set behind the camera
    bool in_front;
  };
  /// Calls `visit(point, view)` for each point in turn, seen from `T_event_ref`. They lie scattered in the surface, and
  /// what the field holds for the next ones is fetched meanwhile.
  template <typename Visit>
  void ForViews(const Rigid3& T_event_ref, Visit&& visit) const {
    const Eigen::Matrix3f R = T_event_ref.rotation().toRotationMatrix().cast<float>();
    const Eigen::Vector3f t = T_event_ref.translation().cast<float>();
    std::array<View, kBatch> views;
    for (std::size_t begin = 0; begin < points_.size(); begin += kBatch) {
      const std::size_t count = std::min(kBatch, points_.size() - begin);
      Project(R, t, points_.data() + begin, count, views.data());
      for (std::size_t k = 0; k < count; ++k) visit(points_[begin + k], views[k]);
    }
  }

  /// Unmatched points cost as much as a matched one at this distance.
  float truncation() const { return truncation_; }

 private:
  static constexpr std::size_t kBatch = 32;  // points
  /// Sees up to kBatch points from T = (R, t), and has what SampleField will look at fetched.
  void Project(const Eigen::Matrix3f& R, const Eigen::Vector3f& t, const AlignmentPoint* points, std::size_t count,
               View* views) const;
  /// One point's residual, seen from a pose T of rotation `R`, and, where it is matched, its row of the Jacobian with
  /// respect to a right perturbation of T. Returns whether it is matched.
  bool PointRow(const AlignmentPoint& point, const View& view, const Eigen::Matrix3f& R, float* residual,
                Eigen::Matrix<float, 6, 1>* row) const;
  /// Row of the Jacobian, with respect to a right perturbation of a pose T of rotation `R`, of how a point moves along
  /// a direction in the image, px.
  Eigen::Matrix<float, 6, 1> RowAlong(const Eigen::Vector2f& direction, const AlignmentPoint& point, const View& view,
                                      const Eigen::Matrix3f& R) const;
  /// The prior's six residuals and their Jacobian with respect to `dtheta`, T = T_event_ref * Exp(dtheta).
  Vector6d PriorResidual(const Rigid3& T) const;
  Matrix6d PriorJacobian(const Rigid3& T, const Matrix6d& J_r) const;
  /// Null outside the image.
  const std::int32_t* FieldAt(float u, float v) const {
    const float x = u + 0.5F, y = v + 0.5F;
    const bool inside =
        u >= 0 && v >= 0 && x < static_cast<float>(surface_.width()) && y < static_cast<float>(surface_.height());
    return inside ? surface_.nearest_edge[static_cast<int>(y)] + static_cast<int>(x) : nullptr;
  }
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
/// steps with matrices of fixed size: nothing is allocated, and the points' rows are never stored. The solver asks for
/// the cost of a step first, and for its Jacobian once it takes it, as it most often does: both are of one visit.
class CompressedProblem {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = 7, NUM_PARAMETERS = 6 };

  /// `function_tolerance` is for solvers that have none of their own (Ceres before 2.1): a step taken that changes the
  /// squared norm by less is answered with a Jacobian of zero, at which they stop.
  explicit CompressedProblem(const AlignmentProblem& problem, double function_tolerance = 0)
      : problem_(problem), function_tolerance_(function_tolerance) {}
  bool operator()(const double* dtheta, double* residuals, double* jacobian) const;

  /// The last ones are kept.
  const AlignmentProblem::Sums& SumsAt(const Vector6d& dtheta) const;

 private:
  struct Visited {
    Vector6d dtheta;
    AlignmentProblem::Sums sums;
  };
  const AlignmentProblem& problem_;
  double function_tolerance_;
  mutable std::optional<Visited> last_;
  mutable double taken_squared_norm_ = std::numeric_limits<double>::infinity();  // of the last step taken
};

/// Smallest cosine between the normals of a point and of an edge that may match.
constexpr float kMinNormalCosine = 0.8F;

}  // namespace devo
