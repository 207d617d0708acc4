// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_guess.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

constexpr int kCell_px = 32;
constexpr int kEnough = 10;  // points, beyond which a cell says no more

}  // namespace

DepthGuess::DepthGuess(const std::vector<ReferenceMap::Visible>& visible, const Camera& camera)
    : columns_((camera.width() + kCell_px - 1) / kCell_px),
      cells_(static_cast<std::size_t>(columns_) * ((camera.height() + kCell_px - 1) / kCell_px)) {
  for (const ReferenceMap::Visible& point : visible) {
    Cell& cell = cells_[CellOf(point.u, point.v)];
    ++cell.points;
    cell.sum_of_inverse_depths += 1 / point.p_event.z();
  }
}

std::size_t DepthGuess::CellOf(float x, float y) const {
  return static_cast<std::size_t>(y) / kCell_px * columns_ + static_cast<std::size_t>(x) / kCell_px;
}

float DepthGuess::At(float x, float y) {
  const auto at = static_cast<int>(CellOf(x, y));
  Cell& here = cells_[at];
  if (here.guess_m >= 0) return here.guess_m;
  double weights = 0, sum = 0;
  for (int k = 0; k < static_cast<int>(cells_.size()); ++k) {
    const Cell& cell = cells_[k];
    if (cell.points == 0) continue;
    const double distance = std::hypot(k % columns_ - at % columns_, k / columns_ - at / columns_);
    const double weight = std::min(cell.points, kEnough) / std::pow(std::max(distance, 0.5), 3);
    weights += weight;
    sum += weight * cell.sum_of_inverse_depths / cell.points;
  }
  here.guess_m = sum > 0 ? static_cast<float>(weights / sum) : 0;
  return here.guess_m;
}

}  // namespace devo
