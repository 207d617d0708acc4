// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/relocalizer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "devo/core/nearest_edge_field.h"
#include "edge_nearness.h"

namespace devo {
namespace {

constexpr std::size_t kMaxPlaces = 100, kPlacesPerSearch = 3;
constexpr double kSameView_m = 0.15, kSameView_rad = 0.15;
// The attraction reaches this share of the image's width at first, then narrows to the tracker's own.
constexpr double kWideShare = 0.035, kMiddleShare = 0.012;
constexpr int kCellsPerRadius = 6;
// Turns about the image's axes are tried on a grid: a turn moves all points alike, and most of what is missed in a
// gap is turning. The grid's step is within the attraction.
constexpr int kTurnSteps = 6;
constexpr std::size_t kTurnsTried = 3, kPointsPerTurn = 300;
// Starts are compared with so many points; only the best is aligned with all of them. A search must not hold up the
// surfaces that follow.
constexpr std::size_t kPointsPerTry = 500;
// From far enough the whole map is a speck, which matches any edge: no pose is farther from its start than this share
// of the map's mean distance.
constexpr double kMaxShiftShare = 1;
// No prediction is in what a search finds: fewer points do not hold the six unknowns of a pose, of which about 15 that
// err together are one measurement, and among many edges some pose is met by most of them.
constexpr int kLeastMatched = 6 * 15;

/// With a field that reaches `radius_px` and tells nearest edges apart to a twelfth of that: a field to the pixel took
/// longer than all else of a search.
Surface WithWideField(const Surface& surface, double radius_px) {
  const int cell_px = std::max(1, static_cast<int>(std::ceil(radius_px / kCellsPerRadius)));
  const auto scale = 1 / static_cast<float>(cell_px);
  std::vector<EdgePoint> edges = surface.edges;  // in cells, whose centres are whole numbers
  for (EdgePoint& edge : edges) {
    edge.x = (edge.x + 0.5F) * scale - 0.5F;
    edge.y = (edge.y + 0.5F) * scale - 0.5F;
  }
  const auto cells = [cell_px](int pixels) { return (pixels + cell_px - 1) / cell_px; };
  cv::Mat1i coarse(cells(surface.height()), cells(surface.width()));
  BuildNearestEdgeField(edges, std::ceil(radius_px / cell_px), &coarse);
  Surface wide = surface;  // images are shared, edges copied
  wide.nearest_edge = cv::Mat1i(surface.height(), surface.width());
  for (int y = 0; y < surface.height(); ++y) {
    const std::int32_t* from = coarse[y / cell_px];
    std::int32_t* to = wide.nearest_edge[y];
    for (int x = 0; x < surface.width(); ++x) to[x] = from[x / cell_px];
  }
  return wide;
}

double MeanDistance(const std::vector<MapPoint>& points) {
  double sum = 0;
  for (const MapPoint& point : points) sum += point.p_ref.norm();
  return sum / static_cast<double>(std::max<std::size_t>(points.size(), 1));
}

std::vector<MapPoint> Thinned(const std::vector<MapPoint>& points) {
  const std::size_t stride = (points.size() + kPointsPerTry - 1) / kPointsPerTry;
  std::vector<MapPoint> thinned;
  for (std::size_t i = 0; i < points.size(); i += stride) thinned.push_back(points[i]);
  return thinned;
}

}  // namespace

bool Relocalizer::Expectation::IsPlausible(const Rigid3& T_world_event, int of_chapter) const {
  // How chapters lie to each other is a guess.
  if (of_chapter != chapter) return true;
  return std::any_of(starts.begin(), starts.end(), [&](const Rigid3& start) {
    return NormalisedSquare(Log(start.inverse() * T_world_event), covariance) < most_square;
  });
}

void Relocalizer::Clear() {
  places_.clear();
  next_place_ = 0;
}

void Relocalizer::Remember(const LocalMapPtr& map) {
  for (LocalMapPtr& place : places_) {
    if (place->chapter != map->chapter) continue;
    const Rigid3 T_place_map = place->T_world_ref.inverse() * map->T_world_ref;
    if (T_place_map.translation().norm() > kSameView_m || RotationAngle(T_place_map) > kSameView_rad) continue;
    place = map;  // the newer map of a view has more of it
    return;
  }
  places_.push_back(map);
  if (places_.size() > kMaxPlaces) places_.pop_front();
}

std::vector<Rigid3> Relocalizer::TurnedStarts(const Surface& wide, const LocalMap& map,
                                              const Rigid3& T_world_event) const {
  const double step_rad = 1.5 * kWideShare * camera_.width() / camera_.fx();
  const auto radius_px = static_cast<float>(kWideShare * camera_.width());
  const Rigid3 T_event_ref = T_world_event.inverse() * map.T_world_ref;
  const std::size_t stride = std::max<std::size_t>(1, map.points.size() / kPointsPerTurn);
  std::vector<Eigen::Vector3f> points_event;
  for (std::size_t i = 0; i < map.points.size(); i += stride) {
    points_event.emplace_back((T_event_ref * map.points[i].p_ref.cast<double>()).cast<float>());
  }
  const EdgeNearness nearness(camera_);
  std::vector<std::pair<float, Rigid3>> turns;  // score, T_world_event
  for (int yaw = -kTurnSteps; yaw <= kTurnSteps; ++yaw) {
    for (int pitch = -kTurnSteps; pitch <= kTurnSteps; ++pitch) {
      const Rigid3 turn = Rigid3::Rotation(ExpSO3({pitch * step_rad, yaw * step_rad, 0}));
      const Eigen::Matrix3f R = turn.rotation().toRotationMatrix().cast<float>();
      float score = 0;
      for (const Eigen::Vector3f& p_event : points_event) score += nearness.Of(wide, R * p_event, radius_px);
      turns.emplace_back(score, T_world_event * turn.inverse());
    }
  }
  const std::size_t kept = std::min(kTurnsTried, turns.size());
  std::partial_sort(turns.begin(), turns.begin() + kept, turns.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Rigid3> starts;
  for (std::size_t i = 0; i < kept; ++i) starts.push_back(turns[i].second);
  return starts;
}

void Relocalizer::Try(const Surface& surface, const Surface& wide, const LocalMapPtr& map,
                      const std::vector<MapPoint>& points, const Rigid3& T_world_event, const Expectation& where,
                      Found* best) const {
  // From wide to narrow; without prior, as what moved since is unknown.
  OdometryOptions options = options_;
  options.tracking.ideas.fine_alignment = false;
  PosePrior start;
  start.T_event_ref = T_world_event.inverse() * map->T_world_ref;
  start.sqrt_information = kNoPrior * Matrix6d::Identity();
  options.surface.truncation_px = kWideShare * surface.width();
  start.T_event_ref = Align(points, wide, camera_, start, Vector6d::Zero(), options).T_event_ref;
  options.surface.truncation_px = std::max(options_.surface.truncation_px, kMiddleShare * surface.width());
  start.T_event_ref = Align(points, wide, camera_, start, Vector6d::Zero(), options).T_event_ref;
  const AlignmentResult result = Align(points, surface, camera_, start, Vector6d::Zero(), options_);
  if (result.matched * map->points.size() < kLeastMatched * points.size()) return;  // of all points as many
  if (best->map && result.inlier_share <= best->alignment.inlier_share) return;
  const Rigid3 T_world_found = map->WorldFromEvent(result.T_event_ref);
  const double shift_m = (T_world_event.inverse() * T_world_found).translation().norm();
  if (!(shift_m < kMaxShiftShare * MeanDistance(points))) return;
  if (!where.IsPlausible(T_world_found, map->chapter)) return;
  *best = {T_world_found, map, result};
}

void Relocalizer::AlignAllPoints(const Surface& surface, Found* found) const {
  PosePrior start;
  start.T_event_ref = found->alignment.T_event_ref;
  start.sqrt_information = kNoPrior * Matrix6d::Identity();
  found->alignment = Align(found->map->points, surface, camera_, start, Vector6d::Zero(), options_);
  found->T_world_event = found->map->WorldFromEvent(found->alignment.T_event_ref);
}

std::optional<Relocalizer::Found> Relocalizer::Search(const Surface& surface, const LocalMapPtr& map,
                                                      const Expectation& where, bool search_places, double min_share) {
  if (surface.nearest_edge.empty() || surface.edges.empty()) return std::nullopt;
  const Surface wide = WithWideField(surface, kWideShare * surface.width());
  Found best;
  const std::vector<MapPoint> points = Thinned(map->points);
  for (const Rigid3& T_world_event : where.starts) {
    Try(surface, wide, map, points, T_world_event, where, &best);
    for (const Rigid3& start : TurnedStarts(wide, *map, T_world_event))
      Try(surface, wide, map, points, start, where, &best);
  }
  if (search_places) {
    for (std::size_t k = 0; k < std::min(kPlacesPerSearch, places_.size()); ++k) {
      const LocalMapPtr& place = places_[next_place_++ % places_.size()];
      Try(surface, wide, place, Thinned(place->points), place->T_world_ref, where, &best);
    }
  }
  if (!best.map) return std::nullopt;
  AlignAllPoints(surface, &best);
  // All of them may have led on to another view.
  if (!where.IsPlausible(best.T_world_event, best.map->chapter)) return std::nullopt;
  if (best.alignment.inlier_share < min_share || best.alignment.matched < kLeastMatched) return std::nullopt;
  return best;
}

}  // namespace devo
