// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/camera.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <Eigen/LU>

namespace devo {
namespace {

constexpr double kMinDepth_m = 1e-3;
// Of the image's width or height, on each side: farther out a wide lens sees ever less in ever more pixels.
constexpr double kMostBeyond = 0.25;

DistortionModel ModelFromNameAndCount(const std::string& name, std::size_t count) {
  const bool all_named_none = name.empty() || name == "none";
  if (all_named_none && count == 0) return DistortionModel::kNone;
  if (name == "equidistant" && count == 4) return DistortionModel::kEquidistant;
  if (name == "rational_polynomial" && count == 8) return DistortionModel::kRationalPolynomial;
  if (name == "plumb_bob" || name == "radtan") {
    if (count == 0) return DistortionModel::kNone;
    if (count == 4 || count == 5) return DistortionModel::kPlumbBob;
    if (count == 8) return DistortionModel::kRationalPolynomial;
  }
  std::ostringstream message;
  message << "distortion model '" << name << "' with " << count
          << " coefficients is not known; expected plumb_bob (4 or 5), rational_polynomial (8), equidistant (4) or "
             "none (0)";
  throw std::invalid_argument(message.str());
}

}  // namespace

Camera::Camera(int width, int height, double fx, double fy, double cx, double cy, const std::string& distortion_name,
               const std::vector<double>& coefficients)
    : width_(width), height_(height), fx_(fx), fy_(fy), cx_(cx), cy_(cy),
      distortion_(ModelFromNameAndCount(distortion_name, coefficients.size())), coefficients_(coefficients) {
  std::ostringstream message;
  if (width <= 0 || height <= 0) {
    message << "image size " << width << "x" << height << " is empty; expected at least 1x1 pixel";
    throw std::invalid_argument(message.str());
  }
  if (!(fx > 0 && fy > 0 && std::isfinite(fx + fy + cx + cy))) {
    message << "focal lengths fx = " << fx << ", fy = " << fy << ", principal point (" << cx << ", " << cy
            << "): expected positive, finite values (is the camera calibrated?)";
    throw std::invalid_argument(message.str());
  }
  for (const double c : coefficients) {
    if (!std::isfinite(c)) throw std::invalid_argument("distortion coefficients: expected finite values");
  }
  if (distortion_ == DistortionModel::kPlumbBob) coefficients_.resize(5, 0.0);
}

Camera Camera::WithFocalLength(double factor) const {
  if (!(factor > 0)) {
    throw std::invalid_argument("focal length times " + std::to_string(factor) + ", expected a positive factor");
  }
  Camera camera = *this;
  camera.fx_ *= factor;
  camera.fy_ *= factor;
  return camera;
}

Camera Camera::Undistorted() const {
  if (distortion_ == DistortionModel::kNone) return *this;
  const int right = width_ - 1, bottom = height_ - 1;
  const auto most_x = static_cast<int>(kMostBeyond * width_), most_y = static_cast<int>(kMostBeyond * height_);
  const int left_px = std::min(most_x, SeenBeyond({0, 0}, {0, bottom}, {-1, 0}));
  const int right_px = std::min(most_x, SeenBeyond({right, 0}, {right, bottom}, {1, 0}));
  const int top_px = std::min(most_y, SeenBeyond({0, 0}, {right, 0}, {0, -1}));
  const int bottom_px = std::min(most_y, SeenBeyond({0, bottom}, {right, bottom}, {0, 1}));
  return {width_ + left_px + right_px, height_ + top_px + bottom_px, fx_, fy_, cx_ + left_px, cy_ + top_px, "none", {}};
}

int Camera::SeenBeyond(const Eigen::Vector2d& first_px, const Eigen::Vector2d& last_px,
                       const Eigen::Vector2d& outward) const {
  const int steps = static_cast<int>((last_px - first_px).norm());
  double least_px = std::numeric_limits<double>::infinity();
  for (int k = 0; k <= steps; ++k) {
    const Eigen::Vector2d u = first_px + (last_px - first_px) * k / std::max(1, steps);
    const auto ray = Unproject(u);
    if (!ray) continue;
    const Eigen::Vector2d undistorted(fx_ * ray->x() + cx_, fy_ * ray->y() + cy_);
    least_px = std::min(least_px, outward.dot(undistorted - u));
  }
  return least_px > 0 && std::isfinite(least_px) ? static_cast<int>(least_px) : 0;
}

Camera Camera::ShrunkTo(int width, int height) const {
  const double factor = std::min({1.0, static_cast<double>(width) / width_, static_cast<double>(height) / height_});
  Camera camera = WithFocalLength(factor);
  camera.width_ = static_cast<int>(std::lround(factor * width_));
  camera.height_ = static_cast<int>(std::lround(factor * height_));
  camera.cx_ = factor * (cx_ + 0.5) - 0.5;
  camera.cy_ = factor * (cy_ + 0.5) - 0.5;
  return camera;
}

std::optional<Eigen::Vector2d> Camera::Distort(const Eigen::Vector2d& x) const {
  if (distortion_ == DistortionModel::kNone) return x;
  const auto& c = coefficients_;
  const double r2 = x.squaredNorm();
  if (distortion_ == DistortionModel::kEquidistant) {
    const double r = std::sqrt(r2);
    if (r < 1e-9) return x;
    const double a = std::atan(r), a2 = a * a;
    const double a_d = a * (1 + a2 * (c[0] + a2 * (c[1] + a2 * (c[2] + a2 * c[3]))));
    if (a_d <= 0) return std::nullopt;
    return Eigen::Vector2d(a_d / r * x);
  }
  const double numerator = 1 + r2 * (c[0] + r2 * (c[1] + r2 * c[4]));
  const double denominator =
      distortion_ == DistortionModel::kRationalPolynomial ? 1 + r2 * (c[5] + r2 * (c[6] + r2 * c[7])) : 1.0;
  const double radial = numerator / denominator;
  if (!(radial > 0)) return std::nullopt;
  const double xy2 = 2 * x.x() * x.y();
  return Eigen::Vector2d(radial * x.x() + c[2] * xy2 + c[3] * (r2 + 2 * x.x() * x.x()),
                         radial * x.y() + c[2] * (r2 + 2 * x.y() * x.y()) + c[3] * xy2);
}

Eigen::Matrix2d Camera::DistortionJacobian(const Eigen::Vector2d& x) const {
  if (distortion_ == DistortionModel::kNone) return Eigen::Matrix2d::Identity();
  const auto& c = coefficients_;
  const double r2 = x.squaredNorm();
  if (distortion_ == DistortionModel::kEquidistant) {
    const double r = std::sqrt(r2);
    if (r < 1e-9) return Eigen::Matrix2d::Identity();
    const double a = std::atan(r), a2 = a * a;
    const double a_d = a * (1 + a2 * (c[0] + a2 * (c[1] + a2 * (c[2] + a2 * c[3]))));
    const double da_d = (1 + a2 * (3 * c[0] + a2 * (5 * c[1] + a2 * (7 * c[2] + a2 * 9 * c[3])))) / (1 + r2);
    const Eigen::Vector2d n = x / r;
    return a_d / r * Eigen::Matrix2d::Identity() + (da_d - a_d / r) * n * n.transpose();
  }
  const bool rational = distortion_ == DistortionModel::kRationalPolynomial;
  const double N = 1 + r2 * (c[0] + r2 * (c[1] + r2 * c[4]));
  const double dN = c[0] + r2 * (2 * c[1] + r2 * 3 * c[4]);
  const double D = rational ? 1 + r2 * (c[5] + r2 * (c[6] + r2 * c[7])) : 1.0;
  const double dD = rational ? c[5] + r2 * (2 * c[6] + r2 * 3 * c[7]) : 0.0;
  const double radial = N / D;
  const double d_radial = (dN * D - N * dD) / (D * D);  // with respect to r^2
  Eigen::Matrix2d J = radial * Eigen::Matrix2d::Identity() + 2 * d_radial * x * x.transpose();
  J(0, 0) += 2 * c[2] * x.y() + 6 * c[3] * x.x();
  J(0, 1) += 2 * c[2] * x.x() + 2 * c[3] * x.y();
  J(1, 0) += 2 * c[2] * x.x() + 2 * c[3] * x.y();
  J(1, 1) += 6 * c[2] * x.y() + 2 * c[3] * x.x();
  return J;
}

std::optional<Eigen::Vector2d> Camera::Project(const Eigen::Vector3d& p) const {
  if (!(p.z() > kMinDepth_m)) return std::nullopt;
  const Eigen::Vector2d x = p.head<2>() / p.z();
  const auto d = Distort(x);
  // Beyond the fold of the polynomial, points from outside the field of view would land inside the image.
  if (!d || (distortion_ != DistortionModel::kNone && DistortionJacobian(x).determinant() <= 0)) return std::nullopt;
  return Eigen::Vector2d(fx_ * d->x() + cx_, fy_ * d->y() + cy_);
}

std::optional<Eigen::Vector3d> Camera::Unproject(const Eigen::Vector2d& u) const {
  const Eigen::Vector2d target((u.x() - cx_) / fx_, (u.y() - cy_) / fy_);
  Eigen::Vector2d x = target;
  // A fisheye reaches far beyond tan(r) = r; start from the inverse of the ideal equidistant lens.
  if (distortion_ == DistortionModel::kEquidistant && target.norm() > 1e-9) {
    x = target / target.norm() * std::tan(std::min(target.norm(), 1.4));
  }
  for (int iteration = 0; iteration < 30; ++iteration) {
    const auto d = Distort(x);
    if (!d) return std::nullopt;
    const Eigen::Vector2d error = *d - target;
    if (error.norm() < 1e-10) {
      const bool folded = DistortionJacobian(x).determinant() <= 0;
      return folded ? std::nullopt : std::optional<Eigen::Vector3d>(Eigen::Vector3d(x.x(), x.y(), 1));
    }
    const Eigen::Matrix2d J = DistortionJacobian(x);
    if (std::abs(J.determinant()) < 1e-9) return std::nullopt;
    x -= J.inverse() * error;
    if (!x.allFinite()) return std::nullopt;
  }
  return std::nullopt;
}

cv::Mat2f RayTable(const Camera& camera) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  cv::Mat2f table(camera.height(), camera.width());
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const auto ray = camera.Unproject({x, y});
      table(y, x) = ray ? cv::Vec2f(static_cast<float>(ray->x()), static_cast<float>(ray->y())) : cv::Vec2f(kNaN, kNaN);
    }
  }
  return table;
}

}  // namespace devo
