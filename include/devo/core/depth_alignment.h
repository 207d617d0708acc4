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
#include "devo/core/depth_cells.h"
#include "devo/core/rigid3.h"

namespace devo {

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
  /// Not 0: this cell is left out. Empty: none is.
  using CellMask = std::vector<std::uint8_t>;
  /// Aligns `now` to `ref` from a start within that. Directions that the surfaces leave open stay at the start. Empty
  /// where too little overlaps. `without`: of the cells of `now`.
  std::optional<Result> Align(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth,
                              Reach reach = Reach::kNear, const CellMask& without = {}) const;

  /// What is left between the surfaces of two aligned images, as squared errors of the alignment over what
  /// Result::information says of it, in the mean of the known directions.
  struct Residuals {
    double of_cells;     ///< were each cell's error its own
    double of_patches;   ///< as patches of 8 x 8 cells err: larger where the errors within one are alike
    double sigma_share;  ///< spread of the distances over the depth of the scene
  };
  /// By cluster-robust covariances (Liang and Zeger, "Longitudinal data analysis using generalized linear models",
  /// Biometrika 1986). Empty where too little of the view is compared for its patches to tell.
  std::optional<Residuals> ResidualsOf(const DepthCells& ref, const DepthCells& now, const Result& result) const;

  /// The cells of `now` on things each of which tells more of some direction than all else that was aligned: had it
  /// moved by itself, that would look like a motion of the camera. Empty where there is none.
  CellMask OnWhatAloneHolds(const DepthCells& ref, const DepthCells& now, const Result& result) const;

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
  struct Overlap;
  struct Equations;

  int CellAt(const Eigen::Vector3f& p) const;
  void AddNormals(DepthCells* cells) const;
  /// Calls `visit(cell of now, distance to the reference's surface in m, weight, derivative of the distance)` for each
  /// match.
  template <typename Visit>
  Overlap ForMatches(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth, double sigma_m,
                     std::size_t step, const CellMask& without, const Visit& visit) const;
  Equations Linearise(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth, double sigma_m,
                      std::size_t step, const CellMask& without) const;
  /// The same, solved; empty where too little overlaps.
  std::optional<Equations> Step(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth, double sigma_m,
                                std::size_t step, const CellMask& without) const;

  /// Of information in the units of distances: its eigenvectors, scaled so that a turn is as large as what it moves at
  /// the depth of the scene, and which are more than noise.
  struct Directions {
    Matrix6d to_units, from_units;  ///< from coordinates along them to [rho; phi]; the same of information
    Vector6d values, known;         ///< 1 or 0
  };
  Directions DirectionsOf(const Matrix6d& H, double depth_m, double sigma_m) const;

  Camera camera_;  // undistorted
  cv::Size image_size_;
  int cell_px_, columns_, rows_;
  int full_ = 0;  // samples in a cell
  std::vector<Sample> samples_;
};

}  // namespace devo
