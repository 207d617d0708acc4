// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_alignment.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <Eigen/Eigenvalues>

#include "devo/core/depth_image.h"
#include "devo/core/depth_things.h"
#include "devo/core/median.h"

namespace devo {
namespace {

constexpr int kColumns = 80;  // about; more cells cost more and tell the same
constexpr int kPixelStep = 2;
constexpr float kMinNormalCosine = 0.2F;  // surfaces seen at a flat angle tell of the camera's noise
constexpr float kMinMatchCosine = 0.9F;   // of the normals of a match
constexpr std::size_t kCoarseStep = 4;
constexpr double kMinSigma_m = 2e-4;
constexpr double kTukey = 4;       // standard deviations beyond which a match is an outlier
constexpr double kStill_m = 3e-5;  // a step smaller than this, or this in radians, ends the iterations
// The normals' noise makes any direction look a little constrained: below so many times of what it makes, it is open.
constexpr double kOpenNoise = 4;
constexpr double kOpenShare = 5e-4;  // and at any rate below this share of the best: a wall is never quite flat
constexpr double kDamping_m = 0.01;  // of a step, also in radians, where the surfaces say nothing
constexpr int kMinMatches = 100;
constexpr double kMinOverlap = 0.2;
constexpr double kSigmaOfMedian = 1.4826;  // of a normal distribution's absolute values
constexpr double kMostOfAll = 0.5;         // of what is known of a direction, that one thing may tell
constexpr int kPatch = 8;                  // cells of its side
constexpr int kMinPatches = 36;            // about half of the image

/// The way of an alignment; the first iterations with every kCoarseStep-th cell.
struct Course {
  double start_sigma_m;
  int coarse_iterations, most_iterations;
};
constexpr Course kNearCourse = {0.01, 2, 10}, kFarCourse = {0.05, 8, 20};

float MedianDepth(const std::vector<DepthCells::Cell>& cells) {
  std::vector<float> depths;
  for (const DepthCells::Cell& cell : cells) {
    if (cell.p.z() > 0) depths.push_back(cell.p.z());
  }
  return depths.empty() ? 0 : Median(std::move(depths));
}

}  // namespace

struct DepthAligner::Overlap {
  int seen = 0;      // cells that might have matched
  int compared = 0;  // of these, those where the reference has a reading
  int met = 0;       // of these, those that lie on a surface of the reference, if not exactly
};

/// Normal equations of the step, in units of the distances.
struct DepthAligner::Equations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  std::vector<float> distances;  // of the matches, absolute
  Overlap overlap;
  // Once solved:
  double sigma_m = 0;              // spread of the distances
  Vector6d xi = Vector6d::Zero();  // T_ref_depth is to be moved by Exp(xi)
};

DepthAligner::DepthAligner(const Camera& camera)
    : camera_(camera.Undistorted().ShrunkTo(camera.width(), camera.height())),
      image_size_(camera.width(), camera.height()), cell_px_(std::max(1, camera.width() / kColumns)),
      columns_((camera_.width() + cell_px_ - 1) / cell_px_), rows_((camera_.height() + cell_px_ - 1) / cell_px_) {
  const int step = std::min(kPixelStep, cell_px_);
  const int samples_in_a_row = cell_px_ / step;
  const double shrunk = camera_.fx() / camera.fx();
  full_ = static_cast<int>(samples_in_a_row * samples_in_a_row / (shrunk * shrunk));
  for (int y = 0; y < camera.height(); y += step) {
    for (int x = 0; x < camera.width(); x += step) {
      const auto ray = camera.Unproject({x, y});
      if (!ray) continue;
      const Eigen::Vector3f direction = ray->cast<float>();
      const int cell = CellAt(direction);
      if (cell >= 0) samples_.push_back({y * camera.width() + x, cell, direction.x(), direction.y()});
    }
  }
}

int DepthAligner::CellAt(const Eigen::Vector3f& p) const {
  const float u = static_cast<float>(camera_.fx()) * p.x() / p.z() + static_cast<float>(camera_.cx()) + 0.5F;
  const float v = static_cast<float>(camera_.fy()) * p.y() / p.z() + static_cast<float>(camera_.cy()) + 0.5F;
  // Before the conversion: of values beyond an int it is undefined.
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(camera_.width()) && v < static_cast<float>(camera_.height()))) {
    return -1;
  }
  return static_cast<int>(v) / cell_px_ * columns_ + static_cast<int>(u) / cell_px_;
}

DepthCells DepthAligner::Reduce(const cv::Mat1f& depth_m, double min_m, double max_m) const {
  if (depth_m.size() != image_size_) {
    std::ostringstream message;
    message << "depth image of " << depth_m.cols << "x" << depth_m.rows << "; expected the depth camera's "
            << image_size_.width << "x" << image_size_.height;
    throw std::invalid_argument(message.str());
  }
  const cv::Mat1f dense = depth_m.isContinuous() ? depth_m : depth_m.clone();
  const float* readings = dense.ptr<float>();
  struct Range {
    float nearest = 0, farthest = 0;
    int count = 0;
  };
  DepthCells result;
  result.cells.resize(static_cast<std::size_t>(columns_) * rows_);
  std::vector<Range> ranges(result.cells.size());
  for (const Sample& sample : samples_) {
    const float z = ValidDepthOrZero(readings[sample.pixel], static_cast<float>(min_m), static_cast<float>(max_m));
    if (!(z > 0)) continue;
    Range& range = ranges[sample.cell];
    result.cells[sample.cell].p += z * Eigen::Vector3f(sample.ray_x, sample.ray_y, 1);
    range.nearest = range.count == 0 ? z : std::min(range.nearest, z);
    range.farthest = std::max(range.farthest, z);
    ++range.count;
  }
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const Range& range = ranges[i];
    const bool one_surface = 2 * range.count >= full_ && range.farthest - range.nearest < SurfaceGap(range.nearest);
    result.cells[i].p *= one_surface && range.count > 0 ? 1.0F / static_cast<float>(range.count) : 0.0F;
  }
  result.columns = columns_;
  AddNormals(&result);
  FindThings(&result);
  result.median_m = MedianDepth(result.cells);
  return result;
}

void DepthAligner::AddNormals(DepthCells* cells) const {
  const auto p = [cells](int i) -> const Eigen::Vector3f& { return cells->cells[i].p; };
  for (int row = 1; row + 1 < rows_; ++row) {
    for (int column = 1; column + 1 < columns_; ++column) {
      const int i = row * columns_ + column, left = i - 1, right = i + 1, up = i - columns_, down = i + columns_;
      const auto joined = [&](int j) { return HangTogether(cells->cells[i], cells->cells[j]); };
      if (!(p(i).z() > 0) || !joined(left) || !joined(right) || !joined(up) || !joined(down)) continue;
      const Eigen::Vector3f n = (p(right) - p(left)).cross(p(up) - p(down)).normalized();
      if (-n.dot(p(i).normalized()) <= kMinNormalCosine) continue;
      const auto off = [&](int a, int b) { return std::abs(n.dot(0.5F * (p(a) + p(b)) - p(i))); };
      cells->cells[i].n = n;
      cells->cells[i].bend_m = std::max(off(left, right), off(up, down));
    }
  }
}

template <typename Visit>
DepthAligner::Overlap DepthAligner::ForMatches(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth,
                                               double sigma_m, std::size_t step, const CellMask& without,
                                               const Visit& visit) const {
  const Eigen::Matrix3f R = T_ref_depth.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_ref_depth.translation().cast<float>();
  const float limit_m = static_cast<float>(kTukey * sigma_m), variance = static_cast<float>(sigma_m * sigma_m);
  Overlap overlap;
  for (std::size_t i = 0; i < now.cells.size(); i += step) {
    const DepthCells::Cell& cell = now.cells[i];
    if (cell.n.isZero() || (!without.empty() && without[i] != 0)) continue;
    ++overlap.seen;
    const Eigen::Vector3f q = R * cell.p + t;
    const int k = q.z() > 0 ? CellAt(q) : -1;
    if (k < 0) continue;
    const DepthCells::Cell& surface = ref.cells[k];
    overlap.compared += surface.p.z() > 0 ? 1 : 0;
    if (surface.n.isZero() || surface.n.dot(R * cell.n) < kMinMatchCosine) continue;
    const float distance = surface.n.dot(q - surface.p);
    overlap.met += std::abs(distance) < SurfaceGap(surface.p.z()) ? 1 : 0;
    if (std::abs(distance) > limit_m) continue;
    const float share = distance / limit_m, inlier = (1 - share * share) * (1 - share * share);
    // At a crease the plane is that of none of its surfaces, and errs by as much as the cell lies off it. Where few
    // cells show a direction, many of these are at the creases of one thing. From afar the way there matters more.
    const float bend_m2 = step > 1 ? 0 : cell.bend_m * cell.bend_m + surface.bend_m * surface.bend_m;
    const float weight = inlier * variance / (variance + bend_m2);
    // q = T Exp(xi) p, so dq = R (rho + phi x p).
    const Eigen::Vector3f n = R.transpose() * surface.n;
    Vector6d row;
    row << n.cast<double>(), cell.p.cross(n).cast<double>();
    visit(cell, distance, weight, row);
  }
  return overlap;
}

DepthAligner::Equations DepthAligner::Linearise(const DepthCells& ref, const DepthCells& now, const Rigid3& T_ref_depth,
                                                double sigma_m, std::size_t step, const CellMask& without) const {
  Equations equations;
  equations.distances.reserve(now.cells.size() / step + 1);
  const auto add = [&equations](const DepthCells::Cell&, float distance, float weight, const Vector6d& row) {
    equations.distances.push_back(std::abs(distance));
    const Vector6d weighted = weight * row;
    equations.H.noalias() += weighted * row.transpose();
    equations.g.noalias() += distance * weighted;
  };
  equations.overlap = ForMatches(ref, now, T_ref_depth, sigma_m, step, without, add);
  return equations;
}

DepthAligner::Directions DepthAligner::DirectionsOf(const Matrix6d& H, double depth_m, double sigma_m) const {
  // A normal is the slope between the cells on both sides.
  const double normal_sigma = sigma_m / (2 * cell_px_ / camera_.fx() * depth_m);
  Vector6d scale;
  scale << 1, 1, 1, Eigen::Vector3d::Constant(1 / depth_m);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scale.asDiagonal() * H * scale.asDiagonal());
  Directions directions;
  directions.values = eigen.eigenvalues();
  const double least = std::max(kOpenShare, kOpenNoise * normal_sigma * normal_sigma) * directions.values(5);
  directions.known = (directions.values.array() > least).cast<double>();
  directions.to_units = scale.asDiagonal() * eigen.eigenvectors();
  directions.from_units = scale.cwiseInverse().asDiagonal() * eigen.eigenvectors();
  return directions;
}

std::optional<DepthAligner::Equations> DepthAligner::Step(const DepthCells& ref, const DepthCells& now,
                                                          const Rigid3& T_ref_depth, double sigma_m, std::size_t step,
                                                          const CellMask& without) const {
  Equations equations = Linearise(ref, now, T_ref_depth, sigma_m, step, without);
  const auto matches = static_cast<int>(equations.distances.size());
  if (matches * static_cast<int>(step) < kMinMatches || matches < kMinOverlap * equations.overlap.seen)
    return std::nullopt;
  const auto middle = equations.distances.begin() + matches / 2;
  std::nth_element(equations.distances.begin(), middle, equations.distances.end());
  equations.sigma_m = std::max(kMinSigma_m, kSigmaOfMedian * *middle);
  Matrix6d damped = equations.H;
  damped.diagonal().array() += std::pow(equations.sigma_m / kDamping_m, 2);
  equations.xi = -damped.ldlt().solve(equations.g);
  return equations;
}

std::optional<DepthAligner::Guess> DepthAligner::AlignCoarsely(const DepthCells& ref, const DepthCells& now,
                                                               const Rigid3& T_start) const {
  Guess guess{T_start, 0};
  double sigma_m = kFarCourse.start_sigma_m;
  for (int iteration = 0; iteration < kFarCourse.coarse_iterations; ++iteration) {
    const auto step = Step(ref, now, guess.T_ref_depth, sigma_m, kCoarseStep, {});
    if (!step) return std::nullopt;
    sigma_m = step->sigma_m;
    guess.T_ref_depth = guess.T_ref_depth * Exp(step->xi);
  }
  const Equations reached = Linearise(ref, now, guess.T_ref_depth, kNearCourse.start_sigma_m, kCoarseStep, {});
  guess.fit = static_cast<double>(reached.distances.size()) / std::max(1, reached.overlap.compared);
  return guess;
}

std::optional<DepthAligner::Result> DepthAligner::Align(const DepthCells& ref, const DepthCells& now,
                                                        const Rigid3& T_start, Reach reach,
                                                        const CellMask& without) const {
  const Course& course = reach == Reach::kFar ? kFarCourse : kNearCourse;
  Result result;
  result.T_ref_depth = T_start;
  result.sigma_m = course.start_sigma_m;
  Matrix6d H;
  for (int iteration = 0; iteration < course.most_iterations; ++iteration) {
    const bool coarse = iteration < course.coarse_iterations;
    const auto step = Step(ref, now, result.T_ref_depth, result.sigma_m, coarse ? kCoarseStep : 1, without);
    if (!step) return std::nullopt;
    result.sigma_m = step->sigma_m;
    result.overlap = static_cast<double>(step->overlap.met) / step->overlap.seen;
    H = step->H;
    result.T_ref_depth = result.T_ref_depth * Exp(step->xi);
    if (!coarse && step->xi.cwiseAbs().maxCoeff() < kStill_m) break;
  }
  const Directions found = DirectionsOf(H, now.median_m, result.sigma_m);
  const Vector6d information = found.known.cwiseProduct(found.values) / (result.sigma_m * result.sigma_m);
  result.information = found.from_units * information.asDiagonal() * found.from_units.transpose();
  // Directions that only noise constrains stay as they were.
  const Matrix6d known = found.to_units * found.known.asDiagonal() * found.from_units.transpose();
  result.T_ref_depth = T_start * Exp(known * Log(T_start.inverse() * result.T_ref_depth));
  return result;
}

std::optional<DepthAligner::Residuals> DepthAligner::ResidualsOf(const DepthCells& ref, const DepthCells& now,
                                                                 const Result& result) const {
  const int across = (columns_ + kPatch - 1) / kPatch, down = (rows_ + kPatch - 1) / kPatch;
  std::vector<Vector6d> patches(static_cast<std::size_t>(across) * down, Vector6d::Zero());
  Matrix6d H = Matrix6d::Zero(), of_cells = Matrix6d::Zero(), of_patches = Matrix6d::Zero();
  const auto add = [&](const DepthCells::Cell& cell, float distance, float weight, const Vector6d& row) {
    const auto index = static_cast<int>(&cell - now.cells.data());
    const int patch = index / columns_ / kPatch * across + index % columns_ / kPatch;
    const Vector6d weighted = weight * row, pull = distance * weighted;
    patches[static_cast<std::size_t>(patch)] += pull;
    of_cells.noalias() += pull * pull.transpose();
    H.noalias() += weighted * row.transpose();
  };
  ForMatches(ref, now, result.T_ref_depth, result.sigma_m, 1, {}, add);
  int used = 0;
  for (const Vector6d& pull : patches) {
    of_patches.noalias() += pull * pull.transpose();
    used += pull.isZero() ? 0 : 1;
  }
  const Directions found = DirectionsOf(H, now.median_m, result.sigma_m);
  if (used < kMinPatches || found.known.isZero()) return std::nullopt;
  // The alignment has made the pulls small along six directions: so many patches tell nothing.
  of_patches *= static_cast<double>(used) / (used - 6);
  const Vector6d stated = found.values.cwiseMax(1e-12) * (result.sigma_m * result.sigma_m);
  const auto over_stated = [&](const Matrix6d& squares) {
    const Vector6d along = (found.to_units.transpose() * squares * found.to_units).diagonal();
    return found.known.dot(along.cwiseQuotient(stated)) / found.known.sum();
  };
  return Residuals{over_stated(of_cells), over_stated(of_patches), result.sigma_m / now.median_m};
}

DepthAligner::CellMask DepthAligner::OnWhatAloneHolds(const DepthCells& ref, const DepthCells& now,
                                                      const Result& result) const {
  Matrix6d all = Matrix6d::Zero();
  std::vector<Matrix6d> of_thing(static_cast<std::size_t>(now.things), Matrix6d::Zero());
  const auto add = [&](const DepthCells::Cell& cell, float, float weight, const Vector6d& row) {
    const Matrix6d information = weight * row * row.transpose();
    all += information;
    if (cell.thing >= 0) of_thing[static_cast<std::size_t>(cell.thing)] += information;
  };
  ForMatches(ref, now, result.T_ref_depth, result.sigma_m, 1, {}, add);
  const Directions found = DirectionsOf(all, now.median_m, result.sigma_m);
  const Vector6d root = found.known.cwiseProduct(found.values.cwiseMax(1e-12).cwiseSqrt().cwiseInverse());
  const Matrix6d whitened = found.to_units * root.asDiagonal();
  std::vector<bool> alone;
  for (const Matrix6d& information : of_thing) {
    const Matrix6d share = whitened.transpose() * information * whitened;
    alone.push_back(Eigen::SelfAdjointEigenSolver<Matrix6d>(share, Eigen::EigenvaluesOnly).eigenvalues()(5) >
                    kMostOfAll);
  }
  if (std::find(alone.begin(), alone.end(), true) == alone.end()) return {};
  CellMask mask;
  for (const DepthCells::Cell& cell : now.cells) mask.push_back(cell.thing >= 0 && alone[cell.thing] ? 1 : 0);
  return mask;
}

}  // namespace devo
