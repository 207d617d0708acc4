// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_things.h"

#include <Eigen/Geometry>

namespace devo {
namespace {

constexpr float kSmoothCosine = 0.97F;  // of the normals of neighbouring cells of one smooth surface
// A surface that is larger than this share of all cells with depth, or wider than this, is the room's.
constexpr double kLarge = 0.15;
constexpr float kWide_m = 1.2F;
constexpr int kSmallest = 20;  // cells with a normal: others tell nothing

/// Groups of cells that hang together.
struct Groups {
  std::vector<int> of_cell;  // -1: in none
  std::vector<int> sizes;
};

/// `is_in(cell)`, and `joined(cell, cell beside it)` for those that are.
template <typename IsIn, typename Joined>
Groups Connect(const DepthCells& all, const IsIn& is_in, const Joined& joined) {
  const int count = static_cast<int>(all.cells.size()), columns = all.columns;
  Groups groups;
  groups.of_cell.assign(all.cells.size(), -1);
  std::vector<int> open;
  for (int first = 0; first < count; ++first) {
    if (groups.of_cell[first] >= 0 || !is_in(first)) continue;
    const int group = static_cast<int>(groups.sizes.size());
    groups.sizes.push_back(0);
    const auto take = [&](int i) {
      groups.of_cell[i] = group;
      ++groups.sizes.back();
      open.push_back(i);
    };
    take(first);
    while (!open.empty()) {
      const int at = open.back(), column = at % columns;
      open.pop_back();
      for (const int beside :
           {at - columns, at + columns, column > 0 ? at - 1 : -1, column + 1 < columns ? at + 1 : -1}) {
        if (beside < 0 || beside >= count || groups.of_cell[beside] >= 0) continue;
        if (is_in(beside) && joined(at, beside)) take(beside);
      }
    }
  }
  return groups;
}

}  // namespace

void FindThings(DepthCells* cells) {
  std::vector<DepthCells::Cell>& all = cells->cells;
  int with_depth = 0;
  for (const DepthCells::Cell& cell : all) with_depth += cell.p.z() > 0 ? 1 : 0;
  const auto near = [&all](int a, int b) { return HangTogether(all[a], all[b]); };
  const Groups smooth = Connect(
      *cells, [&all](int i) { return !all[i].n.isZero(); },
      [&](int a, int b) { return near(a, b) && all[a].n.dot(all[b].n) > kSmoothCosine; });
  std::vector<Eigen::AlignedBox3f> extent(smooth.sizes.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (smooth.of_cell[i] >= 0) extent[smooth.of_cell[i]].extend(all[i].p);
  }
  const auto of_room = [&](int i) {
    const int surface = smooth.of_cell[i];
    return surface >= 0 && (smooth.sizes[surface] > kLarge * with_depth || extent[surface].diagonal().norm() > kWide_m);
  };
  const Groups rest = Connect(
      *cells, [&](int i) { return all[i].p.z() > 0 && !of_room(i); }, near);
  std::vector<int> telling(rest.sizes.size(), 0);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (rest.of_cell[i] >= 0 && !all[i].n.isZero()) ++telling[rest.of_cell[i]];
  }
  std::vector<std::int16_t> things(telling.size(), -1);
  cells->things = 0;
  for (std::size_t i = 0; i < things.size(); ++i) {
    if (telling[i] >= kSmallest) things[i] = static_cast<std::int16_t>(cells->things++);
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    const int group = rest.of_cell[i];
    all[i].thing = group >= 0 ? things[group] : std::int16_t{-1};
  }
}

}  // namespace devo
