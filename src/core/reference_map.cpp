// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/reference_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <optional>

#include "devo/core/alignment_problem.h"
#include "devo/core/edge_lag.h"
#include "devo/core/edge_motion.h"
#include "simd.h"

namespace devo {
namespace {

constexpr int kExplainRadius_px = 2;
// A point this share (and constant) behind what the depth camera saw is hidden.
constexpr float kHiddenShare = 0.04F, kHidden_m = 0.03F;
// A point is judged after this much expectation, and dropped below this share of fulfilment.
constexpr float kJudgeAfter = 6, kMinSupport = 0.3F;
constexpr float kSupportDistance_px = 1.5F;
// A depth that is not known to this share is a mere guess.
constexpr float kUnknownDepthShare = 0.1F;
constexpr int kSelectionCell_px = 32;
constexpr std::size_t kAhead = 8;  // points: about the time that memory takes to answer

float SupportOf(const ReferenceMap::Evidence& evidence) { return (evidence.met + 1) / (evidence.expected + 2); }

bool SamePose(const Rigid3& a, const Rigid3& b) {
  return a.rotation().coeffs() == b.rotation().coeffs() && a.translation() == b.translation();
}

/// Whether something is nearer than a point `z` metres away at the pixel u, v of the occluder's view.
bool Hides(const ReferenceMap::Occluder& occluder, float u, float v, float z) {
  if (!(z > kNearest_m)) return false;
  const auto cell_px = static_cast<float>(occluder.cell_px);
  const int column = static_cast<int>(u / cell_px), row = static_cast<int>(v / cell_px);
  const cv::Mat1f& depth_m = occluder.nearest_depth_m;
  if (column < 0 || row < 0 || column >= depth_m.cols || row >= depth_m.rows) return false;
  const float nearest = depth_m(row, column);
  return nearest > 0 && z > (1 + kHiddenShare) * nearest + kHidden_m;
}

/// Unit normals in eight classes of 22.5 degrees: a normal and its opposite are of one.
int DirectionClass(float nx, float ny) {
  // The directions between classes; the normal, or its opposite in the same half plane, is past the first few of them.
  constexpr float kBetween[7][2] = {
      {0.92387953F, 0.38268343F},  {0.70710678F, 0.70710678F},  {0.38268343F, 0.92387953F}, {0, 1},
      {-0.38268343F, 0.92387953F}, {-0.70710678F, 0.70710678F}, {-0.92387953F, 0.38268343F}};
  int past = 0;
  float nearest = std::abs(ny);
  for (const auto& d : kBetween) {
    const float side = ny * d[0] - nx * d[1];
    past += (side > 0) == (ny > 0) ? 1 : 0;
    nearest = std::min(nearest, std::abs(side));
  }
  if (nearest > 1e-5F) return past;
  // Pixels are integers, so many normals lie between two classes: there the angle decides, not how products are
  // rounded.
  return static_cast<int>(std::floor((std::atan2(ny, nx) + 2 * M_PI) / (M_PI / 8))) % 8;
}

/// To its first elements. Memory goes with them: a place seen again and again gets a few points more from each visit's
/// reference, and keeps only those that prove themselves.
template <typename T>
void Shorten(std::vector<T>* elements, std::size_t size) {
  elements->resize(size);
  if (elements->capacity() > 2 * size) elements->shrink_to_fit();
}

/// Eight bytes, the first five of which are one and the rest zero, as a word in memory.
std::uint64_t FiveBytes() {
  constexpr std::array<std::uint8_t, 8> kBytes = {1, 1, 1, 1, 1, 0, 0, 0};
  std::uint64_t word;
  std::memcpy(&word, kBytes.data(), sizeof(word));
  return word;
}

/// A point in another frame, T_frame_ref, as well as it is known by now.
MapPoint PointOf(const ReferenceMap::Reference& reference, std::size_t i, const Rigid3& T_frame_ref) {
  MapPoint point = reference.points[i];
  point.p_ref = (T_frame_ref * point.p_ref.cast<double>()).cast<float>();
  point.normal_ref = (T_frame_ref.rotation() * point.normal_ref.cast<double>()).cast<float>();
  point.sigma_px = SigmaAcross(reference.evidence[i].covariance);
  if (reference.guessed) {
    const Eigen::Vector3f along_ray = SigmaDepthShare(reference.evidence[i].covariance) * reference.points[i].p_ref;
    point.sigma_depth_ref = (T_frame_ref.rotation() * along_ray.cast<double>()).cast<float>();
  }
  return point;
}

/// An edge that a point meets.
struct Meeting {
  EdgePoint edge;
  float cosine;       // of the normals
  float distance_px;  // from the edge to the point
};

std::optional<Meeting> Meet(const Surface& surface, const ReferenceMap::Visible& point) {
  const int id = surface.NearestEdge(static_cast<int>(point.u + 0.5F), static_cast<int>(point.v + 0.5F));
  if (id < 0) return std::nullopt;
  const EdgePoint& edge = surface.edges[id];
  const float cosine = point.normal_x * edge.nx + point.normal_y * edge.ny;
  const float distance_px = edge.nx * (point.u - edge.x) + edge.ny * (point.v - edge.y);
  if (std::abs(cosine) < kMinNormalCosine || std::abs(distance_px) >= kSupportDistance_px) return std::nullopt;
  return Meeting{edge, cosine, distance_px};
}

PointSighting Sighting(const ReferenceMap::Visible& point, const Meeting& meeting, const Camera& camera,
                       float lag_strength, float weight) {
  const float share = meeting.distance_px / kSupportDistance_px, likely = (1 - share * share) * (1 - share * share);
  PointSighting sighting;
  sighting.px_per_motion = ImageVelocityAlong({meeting.edge.nx, meeting.edge.ny}, point.p_event, camera);
  sighting.distance_px = meeting.distance_px - EdgeLagAlongEdgePx(lag_strength, meeting.edge.strength, meeting.cosine);
  sighting.weight = weight * likely;
  return sighting;
}

}  // namespace

ReferenceMap::ReferenceMap(const Camera& camera, const MappingOptions& options) : camera_(camera), options_(options) {}

int ReferenceMap::Add(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points) {
  return Add(t_ns, T_world_ref, std::move(points), false);
}

int ReferenceMap::AddGuessed(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points) {
  return Add(t_ns, T_world_ref, std::move(points), true);
}

int ReferenceMap::Add(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points, bool guessed) {
  Reference reference;
  reference.guessed = guessed;
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
  Evidence none;
  if (guessed) none.covariance = CovarianceOfGuessedPoint();
  reference.evidence.assign(points.size(), none);
  reference.points = std::move(points);
  reference.points.shrink_to_fit();
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
  if (reference.guessed) return true;  // its points may have moved out of the sphere
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
    // Mostly the occluder is of the view itself: then the point is there already.
    const bool apart = occluder && !SamePose(occluder->T_world_event, T_world_event);
    const Rigid3 T_occluder_ref = apart ? occluder->T_world_event.inverse() * reference.T_world_ref : Rigid3();
    const Eigen::Matrix3f R_o = T_occluder_ref.rotation().toRotationMatrix().cast<float>();
    const Eigen::Vector3f t_o = T_occluder_ref.translation().cast<float>();
    for (std::size_t i = 0; i < reference.points.size(); ++i) {
      const MapPoint& point = reference.points[i];
      const Eigen::Vector3f p = R * point.p_ref + t;
      if (p.z() < kNearest_m) continue;
      const float u = fx * p.x() / p.z() + cx, v = fy * p.y() / p.z() + cy;
      if (!(u >= 2 && v >= 2 && u <= max_u && v <= max_v)) continue;
      if (apart) {
        const Eigen::Vector3f q = R_o * point.p_ref + t_o;
        if (Hides(*occluder, fx * q.x() / q.z() + cx, fy * q.y() / q.z() + cy, q.z())) continue;
      } else if (occluder) {
        if (Hides(*occluder, u, v, p.z())) continue;
      }
      Eigen::Vector2f normal(0, 0);
      if (!point.normal_ref.isZero()) normal = ProjectNormal(point.normal_ref, R, p);
      visible.push_back({static_cast<int>(k), static_cast<int>(i), p, u, v, normal.x(), normal.y()});
    }
  }
  return visible;
}

std::vector<bool> ReferenceMap::ExplainedEdges(const Surface& surface, const std::vector<Visible>& visible) const {
  // Points per pixel by direction: a point marks its own class of directions and both neighbours, so that normals
  // within 22.5 degrees always meet. Visible points are far enough inside for the whole square around them.
  constexpr int kWidth = 2 * kExplainRadius_px + 1;
  const int columns = surface.width();
  std::vector<std::uint8_t> classes(static_cast<std::size_t>(surface.height()) * columns + sizeof(std::uint64_t), 0);
  for (const Visible& point : visible) {
    std::uint64_t mask = 0xFF;
    if (point.normal_x != 0 || point.normal_y != 0) {
      const int c = DirectionClass(point.normal_x, point.normal_y);
      mask = 1U << c | 1U << (c + 1) % 8 | 1U << (c + 7) % 8;
    }
    const int x = static_cast<int>(point.u + 0.5F), y = static_cast<int>(point.v + 0.5F);
    // A row of the square in one word, the bytes beyond it left as they are.
    static_assert(kWidth == 5);
    const std::uint64_t row_mask = FiveBytes() * mask;
    std::uint8_t* row =
        classes.data() + static_cast<std::ptrdiff_t>(y - kExplainRadius_px) * columns + x - kExplainRadius_px;
    for (int k = 0; k < kWidth; ++k, row += columns) {
      std::uint64_t word;
      std::memcpy(&word, row, sizeof(word));
      word |= row_mask;
      std::memcpy(row, &word, sizeof(word));
    }
  }
  std::vector<bool> explained(surface.edges.size());
  for (std::size_t i = 0; i < surface.edges.size(); ++i) {
    const EdgePoint& edge = surface.edges[i];
    const bool known = edge.nx != 0 || edge.ny != 0;
    const int mask = known ? 1 << DirectionClass(edge.nx, edge.ny) : 0xFF;
    const int x = static_cast<int>(edge.x + 0.5F), y = static_cast<int>(edge.y + 0.5F);
    explained[i] = (classes[static_cast<std::size_t>(y) * columns + x] & mask) != 0;
  }
  return explained;
}

void ReferenceMap::Observe(const Surface& surface, const std::vector<Visible>& visible, const Moment& moment) {
  if (surface.nearest_edge.empty()) return;
  const bool refine = moment.new_view && options_.ideas.refine_points;
  std::vector<Eigen::Matrix3f> R_event_ref;
  for (std::size_t k = 0; refine && k < references_.size(); ++k) {
    const Reference& reference = references_[k];
    const Eigen::Quaterniond q = moment.T_world_event.rotation().conjugate() * reference.T_world_ref.rotation();
    R_event_ref.push_back(q.toRotationMatrix().cast<float>());
  }
  ++calls_;
  const auto pixel = [&](const Visible& point) {
    return surface.nearest_edge[static_cast<int>(point.v + 0.5F)] + static_cast<int>(point.u + 0.5F);
  };
  for (std::size_t k = 0; k < visible.size(); ++k) {
    // Another core wrote the surface, and points lie scattered in it: what later ones will need is fetched meanwhile.
    if (k + 2 * kAhead < visible.size()) PrefetchToRead(pixel(visible[k + 2 * kAhead]));
    if (k + kAhead < visible.size()) PrefetchToRead(surface.edges.data() + (*pixel(visible[k + kAhead]) & 0xFFFF));
    const Visible& point = visible[k];
    Reference& reference = references_[point.reference];
    reference.last_seen = calls_;
    const Eigen::Vector2f motion =
        ImageVelocity(moment.velocity_event, point.p_event, camera_) * static_cast<float>(surface.window_s);
    const float across_px = motion.x() * point.normal_x + motion.y() * point.normal_y;
    const float weight = VisibilityOfMotion(across_px);
    if (weight < 0.5F) continue;
    Evidence& evidence = reference.evidence[point.point];
    evidence.expected += weight;
    const auto meeting = Meet(surface, point);
    if (!meeting) continue;
    evidence.met += weight;
    if (!refine) continue;
    const float lag_strength = LagStrength(across_px, 0, static_cast<float>(moment.edge_lag_px));
    PointSighting sighting = Sighting(point, *meeting, camera_, lag_strength, weight);
    sighting.R_event_ref = R_event_ref[point.reference];
    RefinePoint(sighting, camera_, &reference.points[point.point], &evidence.covariance);
  }
}

void ReferenceMap::DropUnproven() {
  for (Reference& reference : references_) {
    if (reference.guessed || reference.last_seen > dropped_at_) Prune(&reference);
  }
  dropped_at_ = calls_;
  if (references_.empty()) return;
  // A map that lost all its points is one, though: the last reference of measured points stays.
  const auto last = std::find_if(references_.rbegin(), references_.rend(),
                                 [](const Reference& reference) { return !reference.guessed; });
  const int last_id = last != references_.rend() ? last->id : -1;
  const auto is_empty = [last_id](const Reference& reference) {
    return reference.points.empty() && reference.id != last_id;
  };
  references_.erase(std::remove_if(references_.begin(), references_.end(), is_empty), references_.end());
}

void ReferenceMap::Prune(Reference* reference) {
  const bool judge = options_.ideas.drop_points;
  const auto refuted = [reference, judge](std::size_t i) {
    const Evidence& evidence = reference->evidence[i];
    return evidence.given_up ||
           (judge && evidence.expected > kJudgeAfter && evidence.met < kMinSupport * evidence.expected);
  };
  std::size_t kept = 0;
  while (kept < reference->points.size() && !refuted(kept)) ++kept;
  if (kept == reference->points.size()) return;
  for (std::size_t i = kept + 1; i < reference->points.size(); ++i) {
    if (refuted(i)) continue;
    reference->points[kept] = reference->points[i];
    reference->evidence[kept] = reference->evidence[i];
    ++kept;
  }
  Shorten(&reference->points, kept);
  Shorten(&reference->evidence, kept);
}

ReferenceMap::Index ReferenceMap::MoveBestToFront(const std::vector<Visible>& visible, Index first, Index last,
                                                  std::size_t count, std::vector<Ranked>* ranked) const {
  // In quarters; a fixed scatter of the index, which no two share, breaks ties: neighbours on one edge are not taken in
  // a row.
  ranked->clear();
  for (auto i = first; i != last; ++i) {
    const float support = SupportOf(references_[visible[*i].reference].evidence[visible[*i].point]);
    const auto quarters = 4 - std::min(4U, static_cast<std::uint32_t>(support * 4));
    ranked->emplace_back(quarters << 24 | ((*i * 2654435761U) & 0xFFFFFFU), *i);
  }
  const auto end = ranked->begin() + static_cast<std::ptrdiff_t>(count);
  std::nth_element(ranked->begin(), end, ranked->end());
  std::sort(ranked->begin(), end);
  return std::transform(ranked->begin(), end, first, [](const auto& r) { return r.second; });
}

std::vector<MapPoint> ReferenceMap::Select(const std::vector<Visible>& visible, const Rigid3& T_world_ref) const {
  const int cell_px = options_.ideas.spread_points ? kSelectionCell_px : std::max(camera_.width(), camera_.height());
  const int columns = (camera_.width() + cell_px - 1) / cell_px, rows = (camera_.height() + cell_px - 1) / cell_px;
  const auto cell_of = [&](const Visible& point) {
    return static_cast<std::size_t>(point.v) / cell_px * columns + static_cast<std::size_t>(point.u) / cell_px;
  };
  // The points cell by cell, those of one cell in their order: `begin` of a cell is the end of the one before.
  std::vector<std::size_t> begin(static_cast<std::size_t>(columns) * rows + 1, 0);
  for (const Visible& point : visible) ++begin[cell_of(point) + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<std::size_t> sorted(visible.size()), next(begin.begin(), begin.end() - 1);
  for (std::size_t i = 0; i < visible.size(); ++i) sorted[next[cell_of(visible[i])]++] = i;
  // The largest quota per cell that stays within the budget: crowded cells give, sparse ones keep all.
  const auto total = [&](std::size_t quota) {
    std::size_t sum = 0;
    for (std::size_t c = 0; c + 1 < begin.size(); ++c) sum += std::min(begin[c + 1] - begin[c], quota);
    return sum;
  };
  std::size_t quota = 1;
  while (quota < visible.size() && total(quota + 1) <= static_cast<std::size_t>(options_.max_points)) ++quota;

  std::vector<Rigid3> T_ref_own;
  for (const Reference& reference : references_) T_ref_own.push_back(T_world_ref.inverse() * reference.T_world_ref);
  std::vector<MapPoint> selected;
  selected.reserve(total(quota));
  std::vector<Ranked> ranked;
  for (std::size_t c = 0; c + 1 < begin.size(); ++c) {
    const auto first = sorted.begin() + static_cast<std::ptrdiff_t>(begin[c]);
    auto last = sorted.begin() + static_cast<std::ptrdiff_t>(begin[c + 1]);
    if (begin[c + 1] - begin[c] > quota) last = MoveBestToFront(visible, first, last, quota, &ranked);
    for (auto i = first; i != last; ++i) {
      const Reference& reference = references_[visible[*i].reference];
      selected.push_back(PointOf(reference, visible[*i].point, T_ref_own[visible[*i].reference]));
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
    for (std::size_t i = 0; i < reference.points.size(); ++i) {
      if (SigmaDepthShare(reference.evidence[i].covariance) > kUnknownDepthShare) continue;
      all.push_back(PointOf(reference, i, reference.T_world_ref));
    }
  }
  return all;
}

}  // namespace devo
