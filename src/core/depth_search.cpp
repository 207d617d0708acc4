// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_search.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

// Alignments come from two decimetres and a quarter of a radian off.
constexpr double kShift_m = 0.15, kReachSigmas = 2.5, kTurn_rad = 0.25, kAside_m = 0.12;
constexpr int kMostShifts = 4, kTurns = 2;
// A quick alignment ends this near to where others do that found the same place; farther off it is another place.
constexpr double kSamePlace_m = 0.05, kOtherPlace_m = 0.15;  // also in radians
constexpr double kLeastFit = 0.75, kAsGood = 0.92;
constexpr int kLeastAlike = 4;

using Guess = DepthAligner::Guess;

/// Of a cube's grid, `steps` to each side.
std::vector<Eigen::Vector3d> Grid(int steps, double step) {
  std::vector<Eigen::Vector3d> grid;
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      for (int z = -steps; z <= steps; ++z) grid.push_back(step * Eigen::Vector3d(x, y, z));
    }
  }
  return grid;
}

double Apart(const Rigid3& a, const Rigid3& b) {
  const Rigid3 T_a_b = a.inverse() * b;
  return std::max(T_a_b.translation().norm(), RotationAngle(T_a_b));
}

}  // namespace

std::vector<Rigid3> ShiftedStarts(const Rigid3& T_ref_depth, double sigma_m) {
  const double reach_m = std::min(kReachSigmas * sigma_m, kMostShifts * kShift_m);
  std::vector<Rigid3> starts;
  for (const Eigen::Vector3d& shift : Grid(std::max(1, static_cast<int>(std::ceil(reach_m / kShift_m))), kShift_m))
    starts.push_back(T_ref_depth * Rigid3::Translation(shift));
  return starts;
}

std::vector<Rigid3> TurnedStarts() {
  std::vector<Rigid3> starts;
  for (const Eigen::Vector3d& turn : Grid(kTurns, kTurn_rad)) {
    const Rigid3 turned = Rigid3::Rotation(ExpSO3(turn));
    starts.push_back(turned);
    for (const double x : {-kAside_m, kAside_m})
      for (const double y : {-kAside_m, kAside_m})
        for (const double z : {-kAside_m, kAside_m}) starts.push_back(Rigid3::Translation({x, y, z}) * turned);
  }
  return starts;
}

std::optional<Rigid3> SearchPlace(const DepthAligner& aligner, const DepthCells& ref, const DepthCells& now,
                                  const std::vector<Rigid3>& T_ref_starts) {
  std::vector<Guess> guesses;
  for (const Rigid3& T_ref_start : T_ref_starts) {
    const auto guess = aligner.AlignCoarsely(ref, now, T_ref_start);
    if (guess) guesses.push_back(*guess);
  }
  const auto best =
      std::max_element(guesses.begin(), guesses.end(), [](const Guess& a, const Guess& b) { return a.fit < b.fit; });
  if (best == guesses.end() || best->fit < kLeastFit) return std::nullopt;
  int alike = 0;
  for (const Guess& guess : guesses) {
    const double apart = Apart(best->T_ref_depth, guess.T_ref_depth);
    if (apart > kOtherPlace_m && guess.fit > kAsGood * best->fit) return std::nullopt;
    alike += apart < kSamePlace_m;
  }
  return alike < kLeastAlike ? std::nullopt : std::make_optional(best->T_ref_depth);
}

}  // namespace devo
