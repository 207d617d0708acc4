// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/alignment_problem.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "devo/core/edge_lag.h"
#include "devo/core/edge_motion.h"
#include "simd.h"

namespace devo {
namespace {

/// Square root of Huber's loss, its sign that of `r`, and its derivative: half its square is the cost, so that a solver
/// of plain least squares minimises the robust one (ceres: "corrector" of first order).
struct RobustRoot {
  RobustRoot(float r, float huber) {
    const float a = std::abs(r);
    if (a <= huber) {
      value = r;
      derivative = 1;
    } else {
      const float root = std::sqrt(2 * huber * a - huber * huber);
      value = std::copysign(root, r);
      derivative = huber / root;
    }
  }
  float value, derivative;
};

/// Sums the products of the rows (J, r) of points. Some rows at a time are multiplied together, side by side and in
/// single precision, in which they are known; their sums are added up in double precision.
class ProductsOfRows {
 public:
  void Add(const Eigen::Matrix<float, 6, 1>& row, float residual) {
    rows_.row(count_) << row.transpose(), residual;
    if (++count_ == rows_.rows()) AddProducts();
  }

  /// [J'J J'r] of all rows added.
  Eigen::Matrix<double, 6, 7> Sum() {
    rows_.bottomRows(rows_.rows() - count_).setZero();
    AddProducts();
    Eigen::Matrix<double, 6, 7> all = sum_;
    all.leftCols<6>() = sum_.leftCols<6>().selfadjointView<Eigen::Upper>();
    return all;
  }

 private:
  void AddProducts() {
    for (int j = 0; j < 7; ++j) {
      for (int i = 0; i <= std::min(j, 5); ++i) sum_(i, j) += static_cast<double>(rows_.col(i).dot(rows_.col(j)));
    }
    count_ = 0;
  }

  Eigen::Matrix<float, 32, 7> rows_;
  int count_ = 0;
  Eigen::Matrix<double, 6, 7> sum_ = Eigen::Matrix<double, 6, 7>::Zero();  // upper triangle of J'J, and J'r
};

}  // namespace

AlignmentProblem::AlignmentProblem(const std::vector<AlignmentPoint>& points, const Surface& surface,
                                   const Camera& camera, const PosePrior& prior, const Rigid3& T_event_ref,
                                   const OdometryOptions& options, double truncation_share)
    : points_(points), surface_(surface), camera_(camera), prior_(prior), T_event_ref_(T_event_ref),
      plain_(surface.nearest_edge.empty()),
      truncation_(plain_ ? 1.0F : static_cast<float>(truncation_share * options.surface.truncation_px)),
      huber_(truncation_ * static_cast<float>(options.tracking.huber_share)),
      unmatched_(options.tracking.ideas.unmatched_cost ? RobustRoot(truncation_, huber_).value : 0.0F) {}

AlignmentProblem::Sample AlignmentProblem::SampleField(const AlignmentPoint& point, float u, float v) const {
  return plain_ ? SamplePlainSurface(u, v) : SampleNearestEdge(point, u, v);
}

AlignmentProblem::Sample AlignmentProblem::SampleNearestEdge(const AlignmentPoint& point, float u, float v) const {
  const std::int32_t* packed = FieldAt(u, v);
  if (packed == nullptr || *packed == Surface::kNoEdge) return {};
  const EdgePoint& edge = surface_.edges[*packed & 0xFFFF];
  const bool known = point.normal_x != 0 || point.normal_y != 0;
  const float cosine = point.normal_x * edge.nx + point.normal_y * edge.ny;
  if (known && std::abs(cosine) < kMinNormalCosine) return {};
  // A match whose polarity speaks clearly against the expected one is another edge.
  if (point.polarity * edge.polarity < -kClearPolarity) return {};
  const float lag = EdgeLagAlongEdgePx(point.lag_strength, edge.strength, cosine);
  const float distance = edge.nx * (u - edge.x) + edge.ny * (v - edge.y) - lag;
  return {std::abs(distance) < truncation_, distance, edge.nx, edge.ny};
}

AlignmentProblem::Sample AlignmentProblem::SamplePlainSurface(float u, float v) const {
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  if (!(u >= 0 && v >= 0) || x + 1 >= surface_.width() || y + 1 >= surface_.height()) return {};
  const float ax = u - x, ay = v - y;
  const std::uint8_t *p = surface_.image[y] + x, *q = surface_.image[y + 1] + x;
  // The negated surface (paper section III-D), bilinear between pixels.
  const float top = p[0] + ax * (p[1] - p[0]), bottom = q[0] + ax * (q[1] - q[0]);
  Sample sample;
  sample.value = 1 - (top + ay * (bottom - top)) / 255;
  sample.gradient_x = -((1 - ay) * (p[1] - p[0]) + ay * (q[1] - q[0])) / 255;
  sample.gradient_y = -(bottom - top) / 255;
  sample.matched = sample.value < 1;
  return sample;
}

void AlignmentProblem::Project(const Eigen::Matrix3f& R, const Eigen::Vector3f& t, const AlignmentPoint* points,
                               std::size_t count, View* views) const {
  const auto fx = static_cast<float>(camera_.fx()), fy = static_cast<float>(camera_.fy());
  const auto cx = static_cast<float>(camera_.cx()), cy = static_cast<float>(camera_.cy());
  for (std::size_t k = 0; k < count; ++k) {
    View& view = views[k];
    const Eigen::Vector3f p = R * points[k].p_ref + t;
    view.p_event = p;
    view.in_front = p.z() > kNearest_m;
    if (!view.in_front) continue;
    view.u = fx * p.x() / p.z() + cx;
    view.v = fy * p.y() / p.z() + cy;
  }
  if (plain_) return;
  std::array<const std::int32_t*, kBatch> pixels;
  for (std::size_t k = 0; k < count; ++k) {
    pixels[k] = views[k].in_front ? FieldAt(views[k].u, views[k].v) : nullptr;
    if (pixels[k] != nullptr) PrefetchToRead(pixels[k]);
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (pixels[k] != nullptr) PrefetchToRead(surface_.edges.data() + (*pixels[k] & 0xFFFF));
  }
}

Eigen::Matrix<float, 6, 1> AlignmentProblem::RowAlong(const Eigen::Vector2f& direction, const AlignmentPoint& point,
                                                      const View& view, const Eigen::Matrix3f& R) const {
  const Eigen::Vector3f& p = view.p_event;
  const auto fx = static_cast<float>(camera_.fx()), fy = static_cast<float>(camera_.fy());
  const float inverse_z = 1 / p.z(), a = fx * direction.x() * inverse_z, b = fy * direction.y() * inverse_z;
  const Eigen::Vector3f g_ref = R.transpose() * Eigen::Vector3f(a, b, -(a * p.x() + b * p.y()) * inverse_z);
  Eigen::Matrix<float, 6, 1> row;
  row.head<3>() = g_ref;
  row.tail<3>() = point.p_ref.cross(g_ref);
  return row;
}

bool AlignmentProblem::PointRow(const AlignmentPoint& point, const View& view, const Eigen::Matrix3f& R,
                                float* residual, Eigen::Matrix<float, 6, 1>* row) const {
  const Sample sample = view.in_front ? SampleField(point, view.u, view.v) : Sample();
  // An edge that moves along itself shows little: what seems to match it is more often another.
  const float weight = std::sqrt(point.expected);
  if (!sample.matched) {
    *residual = weight * unmatched_;
    return false;
  }
  const RobustRoot robust(sample.value, huber_);
  *residual = weight * robust.value;
  if (row == nullptr) return true;
  const float scale = weight * robust.derivative;
  *row = RowAlong({scale * sample.gradient_x, scale * sample.gradient_y}, point, view, R);
  return true;
}

AlignmentProblem::Normals AlignmentProblem::NormalsAt(const Rigid3& T_event_ref) const {
  const Eigen::Matrix3f R = T_event_ref.rotation().toRotationMatrix().cast<float>();
  ProductsOfRows rows;
  double squares = 0, weights = 0;
  ForViews(T_event_ref, [&](const AlignmentPoint& point, const View& view) {
    if (plain_ || !view.in_front || (point.normal_x == 0 && point.normal_y == 0)) return;
    const Sample sample = SampleField(point, view.u, view.v);
    if (!sample.matched) return;
    const float scale = std::sqrt(point.expected) * RobustRoot(sample.value, huber_).derivative;
    const float sine = point.normal_x * sample.gradient_y - point.normal_y * sample.gradient_x;
    const double weight = static_cast<double>(scale) * scale;
    squares += weight * sine * sine;
    weights += weight;
    rows.Add(RowAlong({-scale * sample.gradient_y, scale * sample.gradient_x}, point, view, R), 0);
  });
  if (!(weights > 0)) return {};
  return {rows.Sum().leftCols<6>(), squares / weights};
}

Vector6d AlignmentProblem::PriorResidual(const Rigid3& T) const {
  // Motion of the event frame away from the prior: E = T * T_prior^-1 = T_0 T_prior^-1 Exp(Ad(T_prior) delta).
  return prior_.sqrt_information * Log(T * prior_.T_event_ref.inverse());
}

Matrix6d AlignmentProblem::PriorJacobian(const Rigid3& T, const Matrix6d& J_r) const {
  const Vector6d error = Log(T * prior_.T_event_ref.inverse());
  return prior_.sqrt_information * RightJacobian(error).inverse() * Adjoint(prior_.T_event_ref) * J_r;
}

bool AlignmentProblem::operator()(const double* dtheta, double* residuals, double* jacobian) const {
  const Eigen::Map<const Vector6d> delta(dtheta);
  const Rigid3 T = T_event_ref_ * Exp(delta);
  const Eigen::Matrix3f R = T.rotation().toRotationMatrix().cast<float>();
  const int n = static_cast<int>(points_.size()), rows = NumResiduals();
  // Right perturbations at T become derivatives with respect to delta itself through the right Jacobian.
  const Matrix6d J_r = RightJacobian(delta);
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6>> J(jacobian, jacobian ? rows : 0, 6);
  int i = 0;
  ForViews(T, [&](const AlignmentPoint& point, const View& view) {
    float residual = 0;
    Eigen::Matrix<float, 6, 1> row;
    const bool matched = PointRow(point, view, R, &residual, jacobian ? &row : nullptr);
    residuals[i] = residual;
    if (jacobian) {
      J.row(i).setZero();
      if (matched) J.row(i) = row.cast<double>().transpose() * J_r;
    }
    ++i;
  });
  Eigen::Map<Vector6d>(residuals + n) = PriorResidual(T);
  if (jacobian) J.bottomRows<6>() = PriorJacobian(T, J_r);
  return true;
}

AlignmentProblem::Sums AlignmentProblem::SumsAt(const Vector6d& delta) const {
  const Rigid3 T = T_event_ref_ * Exp(delta);
  const Eigen::Matrix3f R = T.rotation().toRotationMatrix().cast<float>();
  double squared_norm = 0;
  ProductsOfRows rows;
  ForViews(T, [&](const AlignmentPoint& point, const View& view) {
    float residual = 0;
    Eigen::Matrix<float, 6, 1> row;
    const bool matched = PointRow(point, view, R, &residual, &row);
    squared_norm += static_cast<double>(residual) * residual;
    if (matched) rows.Add(row, residual);
  });
  const Eigen::Matrix<double, 6, 7> products = rows.Sum();
  const Vector6d prior = PriorResidual(T);
  // Right perturbations at T become derivatives with respect to delta itself through the right Jacobian.
  const Matrix6d J_r = RightJacobian(delta), J_prior = PriorJacobian(T, J_r);
  Sums sums;
  sums.squared_norm = squared_norm + prior.squaredNorm();
  sums.of_points = J_r.transpose() * products.leftCols<6>() * J_r;
  sums.information = sums.of_points + J_prior.transpose() * J_prior;
  sums.gradient = J_r.transpose() * products.col(6) + J_prior.transpose() * prior;
  return sums;
}

const AlignmentProblem::Sums& CompressedProblem::SumsAt(const Vector6d& dtheta) const {
  if (!last_ || last_->dtheta != dtheta) last_ = {dtheta, problem_.SumsAt(dtheta)};
  return last_->sums;
}

bool CompressedProblem::operator()(const double* dtheta, double* residuals, double* jacobian) const {
  const AlignmentProblem::Sums& sums = SumsAt(Eigen::Map<const Vector6d>(dtheta));
  Eigen::Map<Eigen::Matrix<double, 7, 1>> r(residuals);
  r.setZero();
  r[6] = std::sqrt(sums.squared_norm);
  if (!jacobian) return true;
  Eigen::Map<Eigen::Matrix<double, 7, 6>> J(jacobian);
  J.setZero();
  const double change = std::exchange(taken_squared_norm_, sums.squared_norm) - sums.squared_norm;
  if (std::abs(change) < function_tolerance_) return true;
  // J'J = L L': the first six residuals are L^-1 J'r with the Jacobian L', the last is what no step can lower.
  const Eigen::LLT<Matrix6d> cholesky(sums.information);
  if (cholesky.info() != Eigen::Success) return false;  // all zero: the solver stops where it is
  r.head<6>() = cholesky.matrixL().solve(sums.gradient);
  r[6] = std::sqrt(std::max(0.0, sums.squared_norm - r.head<6>().squaredNorm()));
  J.topRows<6>() = cholesky.matrixU();
  return true;
}

}  // namespace devo
