// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/sweep_mesh.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace devo {
namespace {

constexpr float kTurn = 6.28318531F;
// Neighbours of a ring farther apart than this many spacings have lost a return between them (too near, too dark).
constexpr float kMaxSteps = 2.5F;

/// Difference of range that noise and slanted surfaces explain (two centimetres is what spinning LiDARs are good for).
float RangeGap(float range_m) { return 0.025F * range_m + 0.03F; }
/// How far a plane through two returns may miss the third.
float PlaneGap(float range_m) { return 0.04F * range_m + 0.05F; }

struct Polar {
  std::int32_t index;
  float azimuth, elevation, range;
};
using Ring = std::vector<Polar>;  // by azimuth

/// Rings from the lowest to the highest.
std::vector<Ring> SortIntoRings(const std::vector<LidarPoint>& points) {
  std::map<int, Ring> by_number;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i].p_lidar;
    const float range = p.norm();
    if (points[i].ring < 0 || !(range > 0.01F)) continue;
    by_number[points[i].ring].push_back(
        {static_cast<std::int32_t>(i), std::atan2(p.y(), p.x()), std::asin(p.z() / range), range});
  }
  std::vector<std::pair<float, Ring>> rings;
  for (auto& entry : by_number) {
    Ring& ring = entry.second;
    if (ring.size() < 3) continue;
    std::stable_sort(ring.begin(), ring.end(), [](const Polar& a, const Polar& b) { return a.azimuth < b.azimuth; });
    float elevation = 0;
    for (const Polar& p : ring) elevation += p.elevation / static_cast<float>(ring.size());
    rings.emplace_back(elevation, std::move(ring));
  }
  std::stable_sort(rings.begin(), rings.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Ring> sorted;
  sorted.reserve(rings.size());
  for (auto& ring : rings) sorted.push_back(std::move(ring.second));
  return sorted;
}

float MedianStep(const std::vector<Ring>& rings) {
  std::vector<float> steps;
  for (const Ring& ring : rings) {
    for (std::size_t i = 1; i < ring.size(); ++i) {
      const float step = ring[i].azimuth - ring[i - 1].azimuth;
      if (step > 1e-5F) steps.push_back(step);
    }
  }
  if (steps.empty()) return 0;
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

float AngleBetween(float a, float b) { return std::remainder(a - b, kTurn); }

/// The point of a ring nearest to an azimuth, null where the ring has none within `reach`.
const Polar* Nearest(const Ring& ring, float azimuth, float reach) {
  auto after = std::lower_bound(ring.begin(), ring.end(), azimuth,
                                [](const Polar& p, float value) { return p.azimuth < value; });
  const Polar& next = after == ring.end() ? ring.front() : *after;
  const Polar& before = after == ring.begin() ? ring.back() : *(after - 1);
  const float to_next = std::abs(AngleBetween(next.azimuth, azimuth));
  const float to_before = std::abs(AngleBetween(before.azimuth, azimuth));
  const Polar& best = to_next < to_before ? next : before;
  return std::min(to_next, to_before) <= reach ? &best : nullptr;
}

/// Whether `far` lies where the plane through `beyond` and `near` comes to, `step` and `step_before` being the angles
/// from `near` to `far` and from `beyond` to `near`.
bool Continues(const Polar& beyond, const Polar& near, const Polar& far, float step_before, float step) {
  if (!(std::abs(step_before) > 1e-5F)) return false;
  const float inverse = 1 / near.range + (1 / near.range - 1 / beyond.range) * step / step_before;
  return inverse > 0 && std::abs(1 / inverse - far.range) < PlaneGap(far.range);
}

class Connector {
 public:
  Connector(const std::vector<Ring>& rings, float reach) : rings_(rings), reach_(reach) {}

  /// Marches along two neighbouring rings at once, a triangle per step.
  void Zip(std::size_t lower, SweepMesh* mesh) const {
    const Ring &a = rings_[lower], &b = rings_[lower + 1];
    std::size_t i = 0, j = 0;
    while (i < a.size() || j < b.size()) {
      const bool along_a = j >= b.size() || (i < a.size() && Unwrapped(a, i + 1) < Unwrapped(b, j + 1));
      const Polar &p = a[i % a.size()], &q = b[j % b.size()];
      const Polar& next = along_a ? a[(i + 1) % a.size()] : b[(j + 1) % b.size()];
      if (InReach(p, q) && InReach(p, next) && InReach(q, next)) {
        const bool connected =
            along_a ? AlongRing(a, i) && AcrossRings(lower, next, q) : AlongRing(b, j) && AcrossRings(lower, p, next);
        const bool surface = connected && AcrossRings(lower, p, q);
        (surface ? mesh->triangles : mesh->gaps).push_back({p.index, next.index, q.index});
      }
      ++(along_a ? i : j);
    }
  }

 private:
  bool InReach(const Polar& p, const Polar& q) const { return std::abs(AngleBetween(p.azimuth, q.azimuth)) <= reach_; }

  static float Unwrapped(const Ring& ring, std::size_t i) {
    return ring[i % ring.size()].azimuth + (i >= ring.size() ? kTurn : 0.0F);
  }

  bool AlongRing(const Ring& ring, std::size_t i) const {
    const std::size_t n = ring.size();
    const Polar &p = ring[i % n], &q = ring[(i + 1) % n];
    const float step = AngleBetween(q.azimuth, p.azimuth);
    if (std::abs(p.range - q.range) < RangeGap(std::min(p.range, q.range))) return true;
    const Polar &before = ring[(i + n - 1) % n], &after = ring[(i + 2) % n];
    const float step_before = AngleBetween(p.azimuth, before.azimuth),
                step_after = AngleBetween(after.azimuth, q.azimuth);
    return (std::abs(step_before) < reach_ && Continues(before, p, q, step_before, step)) ||
           (std::abs(step_after) < reach_ && Continues(after, q, p, step_after, step));
  }

  /// `p` of ring `lower`, `q` of the next.
  bool AcrossRings(std::size_t lower, const Polar& p, const Polar& q) const {
    if (std::abs(p.range - q.range) < RangeGap(std::min(p.range, q.range))) return true;
    const float step = q.elevation - p.elevation;
    const Polar* below = lower > 0 ? Nearest(rings_[lower - 1], p.azimuth, reach_) : nullptr;
    if (below && Continues(*below, p, q, p.elevation - below->elevation, step)) return true;
    const Polar* above = lower + 2 < rings_.size() ? Nearest(rings_[lower + 2], q.azimuth, reach_) : nullptr;
    return above && Continues(*above, q, p, above->elevation - q.elevation, step);
  }

  const std::vector<Ring>& rings_;
  float reach_;
};

}  // namespace

SweepMesh ConnectRings(const std::vector<LidarPoint>& points) {
  SweepMesh mesh;
  const std::vector<Ring> rings = SortIntoRings(points);
  const float spacing = MedianStep(rings);
  mesh.spacing_rad = spacing;
  const Connector connector(rings, kMaxSteps * spacing);
  for (std::size_t lower = 0; lower + 1 < rings.size(); ++lower) connector.Zip(lower, &mesh);
  return mesh;
}

}  // namespace devo
