// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/reference_map.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "devo/core/alignment_problem.h"
#include "devo/core/edge_motion.h"

namespace devo {
namespace {

constexpr int kExplainRadius_px = 2;
constexpr float kMinDepth_m = 0.05F;
// A point this share (and constant) behind what the depth camera saw is hidden.
constexpr float kHiddenShare = 0.04F, kHidden_m = 0.03F;
// A point is judged after this much expectation, and dropped below this share of fulfilment.
constexpr float kJudgeAfter = 6, kMinSupport = 0.3F;
constexpr float kSupportDistance_px = 1.5F;
constexpr int kSelectionCell_px = 32;

float SupportOf(const ReferenceMap::Reference& reference, int point) {
  return (reference.met[point] + 1) / (reference.expected[point] + 2);
}

}  // namespace

ReferenceMap::ReferenceMap(const Camera& camera, const MappingOptions& options) : camera_(camera), options_(options) {}

int ReferenceMap::Add(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points) {
  Reference reference;
  reference.id = next_id_++;
  reference.chapter = chapter_;
  reference.t_ns = t_ns;
  reference.T_world_ref = T_world_ref;
  reference.center_ref.setZero();
  for (MapPoint& point : points) {
    point.reference = reference.id;
    reference.center_ref += point.p_ref / static_cast<float>(points.size());
  }
  reference.radius_m = 0;
  for (const MapPoint& point : points) {
    reference.radius_m = std::max(reference.radius_m, (point.p_ref - reference.center_ref).norm());
  }
  reference.expected.assign(points.size(), 0);
  reference.met.assign(points.size(), 0);
  reference.points = std::move(points);
  reference.last_seen = ++calls_;
  references_.push_back(std::move(reference));
  ForgetBeyondBudget();
  return references_.back().id;
}

void ReferenceMap::ForgetBeyondBudget() {
  const auto add = [](std::size_t sum, const Reference& reference) { return sum + reference.points.size(); };
  std::size_t total = std::accumulate(references_.begin(), references_.end(), std::size_t{0}, add);
  while (total > static_cast<std::size_t>(options_.max_map_points) && references_.size() > 1) {
    const auto oldest = std::min_element(references_.begin(), references_.end() - 1,
                                         [](const auto& a, const auto& b) { return a.last_seen < b.last_seen; });
    total -= oldest->points.size();
    references_.erase(oldest);
  }
}

bool ReferenceMap::chapter_empty() const {
  return std::none_of(references_.begin(), references_.end(),
                      [this](const Reference& reference) { return reference.chapter == chapter_; });
}

bool ReferenceMap::InView(const Reference& reference, const Rigid3& T_event_ref) const {
  const Eigen::Vector3d center = T_event_ref * reference.center_ref.cast<double>();
  const double radius = reference.radius_m;
  if (center.z() < -radius) return false;
  // Distance of the sphere's centre to the cone around the image's half diagonal.
  const double tangent = 0.5 * std::hypot(camera_.width() / camera_.fx(), camera_.height() / camera_.fy()) +
                         std::hypot((camera_.cx() - 0.5 * camera_.width()) / camera_.fx(),
                                    (camera_.cy() - 0.5 * camera_.height()) / camera_.fy());
  const double cosine = 1 / std::sqrt(1 + tangent * tangent);
  return (center.head<2>().norm() - tangent * center.z()) * cosine < radius;
}

std::vector<ReferenceMap::Visible> ReferenceMap::Project(const Rigid3& T_world_event, const Occluder* occluder) const {
  std::vector<Visible> visible;
  const auto fx = static_cast<float>(camera_.fx()), fy = static_cast<float>(camera_.fy());
  const auto cx = static_cast<float>(camera_.cx()), cy = static_cast<float>(camera_.cy());
  const float max_u = camera_.width() - 3.0F, max_v = camera_.height() - 3.0F;
  for (std::size_t k = 0; k < references_.size(); ++k) {
    const Reference& reference = references_[k];
    const Rigid3 T_event_ref = T_world_event.inverse() * reference.T_world_ref;
    if (reference.chapter != chapter_ || !InView(reference, T_event_ref)) continue;
    const Eigen::Matrix3f R = T_event_ref.rotation().toRotationMatrix().cast<float>();
    const Eigen::Vector3f t = T_event_ref.translation().cast<float>();
    const Rigid3 T_occluder_ref = occluder ? occluder->T_world_event.inverse() * reference.T_world_ref : Rigid3();
    const Eigen::Matrix3f R_o = T_occluder_ref.rotation().toRotationMatrix().cast<float>();
    const Eigen::Vector3f t_o = T_occluder_ref.translation().cast<float>();
    for (std::size_t i = 0; i < reference.points.size(); ++i) {
      const MapPoint& point = reference.points[i];
      const Eigen::Vector3f p = R * point.p_ref + t;
      if (p.z() < kMinDepth_m) continue;
      const float u = fx * p.x() / p.z() + cx, v = fy * p.y() / p.z() + cy;
      if (!(u >= 2 && v >= 2 && u <= max_u && v <= max_v)) continue;
      if (occluder) {
        const Eigen::Vector3f q = R_o * point.p_ref + t_o;
        const int column = static_cast<int>((fx * q.x() / q.z() + cx) / occluder->cell_px);
        const int row = static_cast<int>((fy * q.y() / q.z() + cy) / occluder->cell_px);
        if (q.z() > kMinDepth_m && column >= 0 && row >= 0 && column < occluder->nearest_depth_m.cols &&
            row < occluder->nearest_depth_m.rows) {
          const float nearest = occluder->nearest_depth_m(row, column);
          if (nearest > 0 && q.z() > (1 + kHiddenShare) * nearest + kHidden_m) continue;
        }
      }
      Eigen::Vector2f normal(0, 0);
      if (!point.normal_ref.isZero()) normal = ProjectNormal(point.normal_ref, R, p);
      visible.push_back({static_cast<int>(k), static_cast<int>(i), p, u, v, normal.x(), normal.y()});
    }
  }
  return visible;
}

std::vector<bool> ReferenceMap::ExplainedEdges(const Surface& surface, const std::vector<Visible>& visible) const {
  // Points per pixel by direction: normals fall into eight classes of 22.5 degrees (a normal and its opposite are
  // one), a point marks its own and both neighbours, so that normals within 22.5 degrees always meet.
  const auto class_of = [](float nx, float ny) {
    return static_cast<int>(std::floor((std::atan2(ny, nx) + 2 * M_PI) / (M_PI / 8))) % 8;
  };
  cv::Mat1b classes(surface.height(), surface.width(), std::uint8_t{0});
  for (const Visible& point : visible) {
    const bool known = point.normal_x != 0 || point.normal_y != 0;
    int mask = 0xFF;
    if (known) {
      const int c = class_of(point.normal_x, point.normal_y);
      mask = 1 << c | 1 << (c + 1) % 8 | 1 << (c + 7) % 8;
    }
    const int x = static_cast<int>(std::lround(point.u)), y = static_cast<int>(std::lround(point.v));
    for (int row = std::max(y - kExplainRadius_px, 0); row <= std::min(y + kExplainRadius_px, classes.rows - 1);
         ++row) {
      for (int column = std::max(x - kExplainRadius_px, 0); column <= std::min(x + kExplainRadius_px, classes.cols - 1);
           ++column) {
        classes(row, column) |= static_cast<std::uint8_t>(mask);
      }
    }
  }
  std::vector<bool> explained(surface.edges.size());
  for (std::size_t i = 0; i < surface.edges.size(); ++i) {
    const EdgePoint& edge = surface.edges[i];
    const bool known = edge.nx != 0 || edge.ny != 0;
    const int mask = known ? 1 << class_of(edge.nx, edge.ny) : 0xFF;
    explained[i] = (classes(static_cast<int>(std::lround(edge.y)), static_cast<int>(std::lround(edge.x))) & mask) != 0;
  }
  return explained;
}

void ReferenceMap::UpdateSupport(const Surface& surface, const std::vector<Visible>& visible,
                                 const Vector6d& velocity_event) {
  if (surface.nearest_edge.empty()) return;
  std::vector<bool> touched(references_.size(), false);
  ++calls_;
  for (const Visible& point : visible) {
    Reference& reference = references_[point.reference];
    reference.last_seen = calls_;
    const Eigen::Vector2f motion =
        ImageVelocity(velocity_event, point.p_event, camera_) * static_cast<float>(surface.window_s);
    const float across_px = motion.x() * point.normal_x + motion.y() * point.normal_y;
    const float weight = VisibilityOfMotion(across_px);
    if (weight < 0.5F) continue;
    reference.expected[point.point] += weight;
    touched[point.reference] = true;
    const int id = surface.NearestEdge(static_cast<int>(std::lround(point.u)), static_cast<int>(std::lround(point.v)));
    if (id < 0) continue;
    const EdgePoint& edge = surface.edges[id];
    if (std::abs(point.normal_x * edge.nx + point.normal_y * edge.ny) < kMinNormalCosine) continue;
    const float distance = edge.nx * (point.u - edge.x) + edge.ny * (point.v - edge.y);
    if (std::abs(distance) < kSupportDistance_px) reference.met[point.point] += weight;
  }
  for (std::size_t k = 0; k < references_.size(); ++k) {
    if (touched[k] && options_.ideas.drop_points) Prune(&references_[k]);
  }
}

void ReferenceMap::Prune(Reference* reference) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < reference->points.size(); ++i) {
    const float expected = reference->expected[i];
    if (expected > kJudgeAfter && reference->met[i] < kMinSupport * expected) continue;
    reference->points[kept] = reference->points[i];
    reference->expected[kept] = expected;
    reference->met[kept] = reference->met[i];
    ++kept;
  }
  reference->points.resize(kept);
  reference->expected.resize(kept);
  reference->met.resize(kept);
}

std::vector<MapPoint> ReferenceMap::Select(const std::vector<Visible>& visible, const Rigid3& T_world_ref) const {
  const int cell_px = options_.ideas.spread_points ? kSelectionCell_px : std::max(camera_.width(), camera_.height());
  const int columns = (camera_.width() + cell_px - 1) / cell_px, rows = (camera_.height() + cell_px - 1) / cell_px;
  std::vector<std::vector<std::size_t>> cells(static_cast<std::size_t>(columns) * rows);
  for (std::size_t i = 0; i < visible.size(); ++i) {
    cells[static_cast<std::size_t>(visible[i].v) / cell_px * columns + static_cast<std::size_t>(visible[i].u) / cell_px]
        .push_back(i);
  }
  // The largest quota per cell that stays within the budget: crowded cells give, sparse ones keep all.
  const auto total = [&](std::size_t quota) {
    return std::accumulate(cells.begin(), cells.end(), std::size_t{0},
                           [&](std::size_t sum, const auto& cell) { return sum + std::min(cell.size(), quota); });
  };
  std::size_t quota = 1;
  while (quota < visible.size() && total(quota + 1) <= static_cast<std::size_t>(options_.max_points)) ++quota;

  std::vector<Rigid3> T_ref_own;
  for (const Reference& reference : references_) T_ref_own.push_back(T_world_ref.inverse() * reference.T_world_ref);
  std::vector<MapPoint> selected;
  selected.reserve(std::min(visible.size(), quota * cells.size()));
  std::vector<std::pair<std::uint32_t, std::size_t>> ranked;
  for (auto& cell : cells) {
    if (cell.size() > quota) {
      // Best support first, in quarters; a fixed scatter of the index, which no two share, breaks ties: neighbours on
      // one edge are not taken in a row.
      ranked.clear();
      for (const std::size_t i : cell) {
        const float support = SupportOf(references_[visible[i].reference], visible[i].point);
        const auto quarters = 4 - std::min(4U, static_cast<std::uint32_t>(support * 4));
        ranked.emplace_back(quarters << 24 | ((i * 2654435761U) & 0xFFFFFFU), i);
      }
      const auto end = ranked.begin() + static_cast<std::ptrdiff_t>(quota);
      std::nth_element(ranked.begin(), end, ranked.end());
      std::sort(ranked.begin(), end);
      cell.resize(quota);
      std::transform(ranked.begin(), end, cell.begin(), [](const auto& r) { return r.second; });
    }
    for (const std::size_t i : cell) {
      const Reference& reference = references_[visible[i].reference];
      const Rigid3& T = T_ref_own[visible[i].reference];
      MapPoint point = reference.points[visible[i].point];
      point.p_ref = (T * point.p_ref.cast<double>()).cast<float>();
      point.normal_ref = (T.rotation() * point.normal_ref.cast<double>()).cast<float>();
      selected.push_back(point);
    }
  }
  // With more cells than the budget has points, even one per cell is too many.
  const auto budget = static_cast<std::size_t>(options_.max_points);
  if (selected.size() > budget) {
    for (std::size_t i = 0; i < budget; ++i) selected[i] = selected[i * selected.size() / budget];
    selected.resize(budget);
  }
  return selected;
}

std::vector<MapPoint> ReferenceMap::AllPoints() const {
  std::vector<MapPoint> all;
  for (const Reference& reference : references_) {
    for (MapPoint point : reference.points) {
      point.p_ref = (reference.T_world_ref * point.p_ref.cast<double>()).cast<float>();
      point.normal_ref = (reference.T_world_ref.rotation() * point.normal_ref.cast<double>()).cast<float>();
      all.push_back(point);
    }
  }
  return all;
}

}  // namespace devo
