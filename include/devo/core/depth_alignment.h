// SPDX-License-Identifier: BSD-3-Clause
//
// How a depth camera has moved between two of its images, by their geometry alone: point-to-plane alignment (Chen and
// Medioni, "Object modelling by registration of multiple range images", 1992) with projective association (Newcombe et
// al., "KinectFusion", ISMAR 2011, section 3.5), of cells of the image in place of its pixels. Depth needs neither
// light nor motion; where the geometry leaves a direction open (a wall, a bare table), the information says so.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// A depth image by cells of its undistorted pixels, row-major, in the depth camera's frame.
struct DepthCells {
  struct Cell {
    Eigen::Vector3f p = Eigen::Vector3f::Zero();  ///< mean of its readings, m; z 0: too few, or of several surfaces
    Eigen::Vector3f n = Eigen::Vector3f::Zero();  ///< unit normal of the surface, towards the camera; 0: unknown
    float bend_m = 0;  ///< by how far it lies off a plane through the cells beside it; where the normal is known
  };
  std::vector<Cell> cells;
  float median_m = 0;  ///< depth of the cells; 0: none has one
};

class DepthAligner {
 public:
  /// `camera`: with which the depth images are taken.
  explicit DepthAligner(const Camera& camera);

  /// Averages the noise of the readings from `min_m` to `max_m`, others are no measurement, and leaves out flying
  /// pixels and edges. `depth_m` as in DepthImage. Throws std::invalid_argument when it has not the camera's size.
  DepthCells Reduce(const cv::Mat1f& depth_m, double min_m = 0, double max_m = std::numeric_limits<float>::max()) const;

  struct Result {
    Rigid3 T_ref_depth;
    Matrix6d information;  ///< on a right perturbation [rho; phi] (m, rad) of T_ref_depth, were all cells independent
    double overlap;        ///< share of the cells with a normal that met a surface of the reference, 0..1
    double sigma_m;        ///< spread of the distances between the surfaces
  };
  /// From how far off an alignment starts: a few centimetres and degrees, or two decimetres, which takes longer and
  /// finds the wrong surfaces more often.
  enum class Reach { kNear, kFar };
  /// Aligns `now` to `ref` from a start within that. Directions that the surfaces leave open stay at the start. Empty
  /// where too little overlaps.
  std::optional<Result> Align(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth,
                              Reach reach = Reach::kNear) const;

  struct Guess {
    Rigid3 T_ref_depth;
    double fit;  ///< share of the cells with a normal, where the reference has readings, that lie on its surfaces, 0..1
  };
  /// As Align from afar, with a part of the cells, to a centimetre or two; where directions are open it ends anywhere.
  std::optional<Guess> AlignCoarsely(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth) const;

 private:
  /// A pixel that is read, its viewing ray (x, y, 1) and the cell that it counts in.
  struct Sample {
    std::int32_t pixel, cell;
    float ray_x, ray_y;
  };
  struct Equations;

  int CellAt(const Eigen::Vector3f& p) const;
  void AddNormals(DepthCells* cells) const;
  Equations Linearise(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth, double sigma_m,
                      std::size_t step) const;
  /// The same, solved; empty where too little overlaps.
  std::optional<Equations> Step(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth, double sigma_m,
                                std::size_t step) const;

  /// Takes the directions that only noise constrains out of the information; returns the projection on the others.
  Matrix6d LeaveOpen(const Matrix6d& H, double depth_m, double sigma_m, Result* result) const;

  Camera camera_;  // undistorted
  cv::Size image_size_;
  int cell_px_, columns_, rows_;
  int full_ = 0;  // samples in a cell
  std::vector<Sample> samples_;
};

}  // namespace devo
