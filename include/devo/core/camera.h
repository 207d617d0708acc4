// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

namespace devo {

/// Lens distortion by its ROS name (sensor_msgs/CameraInfo, REP-104).
enum class DistortionModel {
  kNone,                ///< no coefficients
  kPlumbBob,            ///< 4 or 5: k1 k2 p1 p2 [k3] (Brown-Conrady)
  kRationalPolynomial,  ///< 8: k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,         ///< 4: k1 k2 k3 k4 (Kannala-Brandt, OpenCV fisheye)
};

/// A pinhole camera with distortion. Optical frame: z forward, x right, y down. Pixel centres lie at
/// integer coordinates, (0, 0) is the centre of the top left pixel.
class Camera {
 public:
  Camera() = default;

  /// `distortion_name`: "", "none", "plumb_bob", "radtan", "rational_polynomial" or "equidistant";
  /// name and coefficient count decide the model together: plumb_bob with 8 coefficients is rational (as
  /// the VECtor data set labels it). Throws std::invalid_argument naming the value and what was expected:
  /// focal length not positive (an uncalibrated CameraInfo has K = 0), empty image, unknown name or count.
  Camera(int width, int height, double fx, double fy, double cx, double cy, const std::string& distortion_name,
         const std::vector<double>& coefficients);

  /// The undistorted image: same focal lengths, no distortion. A lens with barrel distortion sees more than an image of
  /// the sensor's size holds (of a DAVIS' events, a quarter): it is larger by as many whole pixels on each side as the
  /// lens sees of all of that side, at most a quarter of width or height. Its pixels are those of the sensor's size,
  /// shifted: `cx` and `cy` say by how much. Without distortion it is the camera itself. All pixels of the rim are
  /// unprojected for it: to be kept, not asked for at each image.
  Camera Undistorted() const;

  /// The same view in an image that is at most so large, in pixels, and not larger than this one.
  Camera ShrunkTo(int width, int height) const;

  /// The same, but with focal lengths this many times as long. Throws std::invalid_argument where that is not positive.
  Camera WithFocalLength(double factor) const;

  int width() const { return width_; }
  int height() const { return height_; }
  double fx() const { return fx_; }
  double fy() const { return fy_; }
  double cx() const { return cx_; }
  double cy() const { return cy_; }
  DistortionModel distortion() const { return distortion_; }
  const std::vector<double>& coefficients() const { return coefficients_; }

  /// Pixel of a point in the camera's frame (metres). Empty behind the camera (z < 1 mm) or where the
  /// distortion polynomial folds back; the pixel may lie outside the image.
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& p) const;

  /// Viewing ray (x, y, 1) of a pixel. Inverts the distortion by Newton iteration to 1e-9; empty where
  /// it does not converge (pixels that no ray reaches).
  std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& u_px) const;

  bool Contains(const Eigen::Vector2d& u_px, double margin_px = 0) const {
    return u_px.x() >= margin_px && u_px.y() >= margin_px && u_px.x() <= width_ - 1 - margin_px &&
           u_px.y() <= height_ - 1 - margin_px;
  }

  /// d(pixel)/d(x, y) of the distortion alone at normalised coordinates; used by Unproject and tests.
  Eigen::Matrix2d DistortionJacobian(const Eigen::Vector2d& x_normalised) const;

 private:
  /// Distorted normalised coordinates; empty where the model folds back.
  std::optional<Eigen::Vector2d> Distort(const Eigen::Vector2d& x_normalised) const;
  /// How many whole pixels, along `outward`, the undistorted image goes on beyond this side of the sensor.
  int SeenBeyond(const Eigen::Vector2d& first_px, const Eigen::Vector2d& last_px, const Eigen::Vector2d& outward) const;

  int width_ = 0, height_ = 0;
  double fx_ = 0, fy_ = 0, cx_ = 0, cy_ = 0;
  DistortionModel distortion_ = DistortionModel::kNone;
  std::vector<double> coefficients_;
};

/// Viewing rays of every pixel of a camera, row-major: (x, y) of the ray (x, y, 1), NaN where none exists.
/// CV_32FC2, height x width.
cv::Mat2f RayTable(const Camera& camera);

}  // namespace devo
