// SPDX-License-Identifier: BSD-3-Clause
//
// How a depth camera errs, learnt from what is left between aligned images. Noise is another in each reading, and the
// many of an image average it. What multipath, a periodic error of the distance or a stereo matcher gets wrong is alike
// in a patch of the image, moves the pose as one, and stays for as long as the view does.
#pragma once

#include <Eigen/Core>

#include "devo/core/depth_alignment.h"

namespace devo {

/// Of the last ten images or so, beside which what is usual counts as two. Not thread-safe.
class DepthErrors {
 public:
  /// Of an image that was aligned to one nearby.
  void Note(const DepthAligner::Residuals& residuals);

  /// How many cells count as one measurement: so many times an alignment's squared error is what its information says,
  /// which takes cells to be independent.
  double CellsPerMeasurement() const;
  /// Standard deviation of what is wrong alike in the whole image, and so is not left between two: in metres per metre
  /// of depth, and in rad.
  double BiasShare() const;
  /// Share of an alignment's squared error that the next images have, too: 0 (noise) to 1.
  double SharedShare() const;

 private:
  Eigen::Array3d Known() const;

  Eigen::Array3d log_mean_ = Eigen::Array3d::Zero();  // of_patches, of_cells, what patches err alike per metre
  double count_ = 0;                                  // of images
};

}  // namespace devo
