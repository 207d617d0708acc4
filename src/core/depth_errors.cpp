// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_errors.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

/// What is learnt, each as a logarithm, as its scatter is one of factors.
enum Learnt { kOfPatches, kOfCells, kAlikePerMetre };
// Patches show a part only: what is alike across them looks like a motion, and is gone once the images are aligned.
// Against ground truth alignments err by 4 to 40 times, in the median 16, what patches let expect as a square.
constexpr double kUnseen = 16;
// Of a depth camera that is not known yet: ten cells are a measurement, a tenth of its squared error is noise.
constexpr double kUsualOfPatches = 10 / kUnseen, kUsualOfCells = kUsualOfPatches / 10, kUsualAlike = 2.5e-4;
constexpr double kUsualCount = 2, kMostCount = 10;
constexpr double kLeastOfPatches = 0.05;
constexpr double kCellsAlike = 8;  // of a patch, so many err as one
constexpr double kLeastShare = 5e-5, kMostShare = 1.5e-3;

}  // namespace

void DepthErrors::Note(const DepthAligner::Residuals& residuals) {
  // A perfect camera leaves nothing, of which there is no logarithm.
  const double of_patches = std::max(1e-3, residuals.of_patches), of_cells = std::max(1e-3, residuals.of_cells);
  const double alike = std::sqrt(std::max(1e-3 * of_patches, of_patches - of_cells) / kCellsAlike);
  count_ = std::min(kMostCount, count_ + 1);
  const Eigen::Array3d now(of_patches, of_cells, std::max(1e-6, alike * residuals.sigma_share));
  log_mean_ += (now.log() - log_mean_) / count_;
}

Eigen::Array3d DepthErrors::Known() const {
  const Eigen::Array3d usual(kUsualOfPatches, kUsualOfCells, kUsualAlike);
  return ((log_mean_ * count_ + usual.log() * kUsualCount) / (count_ + kUsualCount)).exp();
}

double DepthErrors::CellsPerMeasurement() const { return kUnseen * std::max(kLeastOfPatches, Known()(kOfPatches)); }

double DepthErrors::BiasShare() const { return std::clamp(Known()(kAlikePerMetre), kLeastShare, kMostShare); }

double DepthErrors::SharedShare() const {
  const Eigen::Array3d known = Known();
  return std::max(0.0, 1 - known(kOfCells) / known(kOfPatches));
}

}  // namespace devo
