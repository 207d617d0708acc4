// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/lidar_accumulator.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "devo/core/time.h"

namespace devo {
namespace {

// Poses are looked up once per slot: within it, 1 m/s and 200 deg/s make 0.13 mm and 0.03 deg.
constexpr std::int64_t kSlot_ns = 250000;
// Points at the ends of a sweep may lie outside the history by a surface's period.
constexpr double kExtrapolate_s = 0.02;
// Longer than any turn, and than poses are kept.
constexpr std::int64_t kMostApart_ns = 10'000'000'000;
constexpr float kMinDepth_m = 0.01F;
constexpr float kMinSplat_px = 0.5F, kMaxSplat_px = 3;

/// Layers of one surface: range noise of the LiDAR and errors of the poses between sweeps.
float LayerGap(float z_m) { return 0.025F * z_m + 0.04F; }

/// Whole pixels of an image's axis; empty when first > last.
struct Span {
  int first, last;
};
Span SpanOf(float from, float to, int size) {
  const auto max = static_cast<float>(size - 1);
  if (!(to >= 0 && from <= max)) return {0, -1};
  return {static_cast<int>(std::ceil(std::max(from, 0.0F))), static_cast<int>(std::floor(std::min(to, max)))};
}

/// Poses of the event camera by the time of points, each looked up once per slot.
class SlottedPoses {
 public:
  SlottedPoses(const PoseHistory& poses, std::int64_t anchor_ns, const Rigid3& T_anchor_world)
      : poses_(poses), anchor_ns_(anchor_ns), T_anchor_world_(T_anchor_world) {}

  /// Empty where the history does not hold the time.
  std::optional<Rigid3> At(std::int64_t t_ns) {
    // One point with a time of another clock or unit, and the slots up to there would be more than memory holds.
    if (std::abs(t_ns - anchor_ns_) > kMostApart_ns) return std::nullopt;
    const std::int64_t slot = t_ns / kSlot_ns;
    if (slots_.empty()) first_ = slot;
    while (slot < first_) {
      slots_.emplace_front();
      --first_;
    }
    const auto index = static_cast<std::size_t>(slot - first_);
    if (index >= slots_.size()) slots_.resize(index + 1);
    Slot& found = slots_[index];
    if (!found.known) {
      found.known = true;
      const auto T_world_event = poses_.At(slot * kSlot_ns + kSlot_ns / 2, kExtrapolate_s);
      if (T_world_event) found.T_anchor_event = T_anchor_world_ * *T_world_event;
    }
    return found.T_anchor_event;
  }

 private:
  struct Slot {
    bool known = false;
    std::optional<Rigid3> T_anchor_event;
  };
  const PoseHistory& poses_;
  std::int64_t anchor_ns_;
  Rigid3 T_anchor_world_;
  std::deque<Slot> slots_;
  std::int64_t first_ = 0;
};

}  // namespace

LidarAccumulator::LidarAccumulator(const Camera& camera, const Rigid3& T_event_lidar, const MappingOptions& options)
    : camera_(camera), T_event_lidar_(T_event_lidar), options_(options) {}

std::optional<std::int64_t> LidarAccumulator::TimeInView(const LidarSweep& sweep) const {
  double sum_ns = 0;
  std::size_t count = 0;
  for (const LidarPoint& point : sweep.points) {
    const auto u = camera_.Project(T_event_lidar_ * point.p_lidar.cast<double>());
    if (!u || !camera_.Contains(*u)) continue;
    sum_ns += static_cast<double>(point.t_ns - sweep.end_ns);
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sweep.end_ns + std::llround(sum_ns / static_cast<double>(count));
}

void LidarAccumulator::Add(const LidarSweep& sweep, const PoseHistory& poses) {
  if (started_without_poses_) Clear();
  started_without_poses_ = false;
  const auto T_world_anchor = poses.At(sweep.end_ns, kExtrapolate_s);
  if (!T_world_anchor) return;
  SlottedPoses slots(poses, sweep.end_ns, T_world_anchor->inverse());
  std::vector<Eigen::Vector3f> moved(sweep.points.size());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const auto T_anchor_event = slots.At(sweep.points[i].t_ns);
    const Eigen::Vector3d p_event = T_event_lidar_ * sweep.points[i].p_lidar.cast<double>();
    // What was behind the camera will not come into view within the window.
    if (T_anchor_event && p_event.z() > 0) {
      moved[i] = (*T_anchor_event * p_event).cast<float>();
    } else {
      moved[i].setConstant(std::numeric_limits<float>::quiet_NaN());
    }
  }
  Append(sweep, *T_world_anchor, moved);
}

void LidarAccumulator::Start(const LidarSweep& sweep, const Rigid3& T_world_event) {
  Clear();
  started_without_poses_ = true;
  std::vector<Eigen::Vector3f> moved;
  for (const LidarPoint& point : sweep.points) {
    moved.push_back((T_event_lidar_ * point.p_lidar.cast<double>()).cast<float>());
  }
  Append(sweep, T_world_event, moved);
}

void LidarAccumulator::Append(const LidarSweep& sweep, const Rigid3& T_world_anchor,
                              const std::vector<Eigen::Vector3f>& moved) {
  const SweepMesh mesh = ConnectRings(sweep.points);
  Sweep added;
  added.end_ns = sweep.end_ns;
  added.T_world_anchor = T_world_anchor;
  added.spacing_rad = static_cast<float>(mesh.spacing_rad);
  std::vector<std::int32_t> kept_as(moved.size(), -1);
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (!moved[i].allFinite()) continue;
    kept_as[i] = static_cast<std::int32_t>(added.p_anchor.size());
    added.p_anchor.push_back(moved[i]);
  }
  const auto keep = [&](const std::vector<Triangle>& all, std::vector<Triangle>* kept) {
    for (const Triangle& corners : all) {
      const Triangle of_kept = {kept_as[corners[0]], kept_as[corners[1]], kept_as[corners[2]]};
      if (of_kept[0] >= 0 && of_kept[1] >= 0 && of_kept[2] >= 0) kept->push_back(of_kept);
    }
  };
  keep(mesh.triangles, &added.triangles);
  keep(mesh.gaps, &added.gaps);
  sweeps_.push_back(std::move(added));
  while (SecondsFromNs(sweeps_.back().end_ns - sweeps_.front().end_ns) > options_.lidar_window_s) sweeps_.pop_front();
}

void LidarAccumulator::Project(const Sweep& sweep, const Rigid3& T_world_event,
                               std::vector<Projected>* projected) const {
  const Rigid3 T_event_anchor = T_world_event.inverse() * sweep.T_world_anchor;
  const Eigen::Matrix3f R = T_event_anchor.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_event_anchor.translation().cast<float>();
  const auto fx = static_cast<float>(camera_.fx()), fy = static_cast<float>(camera_.fy());
  const auto cx = static_cast<float>(camera_.cx()), cy = static_cast<float>(camera_.cy());
  projected->resize(sweep.p_anchor.size());
  for (std::size_t i = 0; i < sweep.p_anchor.size(); ++i) {
    const Eigen::Vector3f p = R * sweep.p_anchor[i] + t;
    Projected& out = (*projected)[i];
    out.inverse_depth = p.z() > kMinDepth_m ? 1 / p.z() : 0;
    out.u = fx * p.x() * out.inverse_depth + cx;
    out.v = fy * p.y() * out.inverse_depth + cy;
  }
}

template <typename Visit>
void LidarAccumulator::VisitTriangle(const Projected& a, const Projected& b, const Projected& c, Visit&& visit) const {
  if (!(a.inverse_depth > 0 && b.inverse_depth > 0 && c.inverse_depth > 0)) return;
  const float area = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
  if (!(std::abs(area) > 1e-3F)) return;
  const Span x = SpanOf(std::min({a.u, b.u, c.u}), std::max({a.u, b.u, c.u}), camera_.width());
  const Span y = SpanOf(std::min({a.v, b.v, c.v}), std::max({a.v, b.v, c.v}), camera_.height());
  for (int row = y.first; row <= y.last; ++row) {
    for (int column = x.first; column <= x.last; ++column) {
      const float du = static_cast<float>(column) - a.u, dv = static_cast<float>(row) - a.v;
      // Barycentric coordinates of b and c.
      const float wb = (du * (c.v - a.v) - dv * (c.u - a.u)) / area, wc = ((b.u - a.u) * dv - (b.v - a.v) * du) / area;
      if (wb >= 0 && wc >= 0 && wb + wc <= 1) visit(column, row, wb, wc);
    }
  }
}

template <typename Visit>
void LidarAccumulator::VisitPixels(const Sweep& sweep, const std::vector<Projected>& projected, Visit&& visit) const {
  const float splat =
      std::clamp(0.5F * sweep.spacing_rad * static_cast<float>(camera_.fx()), kMinSplat_px, kMaxSplat_px);
  for (const Projected& p : projected) {
    if (!(p.inverse_depth > 0)) continue;
    const Span x = SpanOf(p.u - splat, p.u + splat, camera_.width());
    const Span y = SpanOf(p.v - splat, p.v + splat, camera_.height());
    for (int row = y.first; row <= y.last; ++row) {
      for (int column = x.first; column <= x.last; ++column) visit(column, row, p.inverse_depth);
    }
  }
  for (const Triangle& corners : sweep.triangles) {
    const Projected &a = projected[corners[0]], &b = projected[corners[1]], &c = projected[corners[2]];
    VisitTriangle(a, b, c, [&](int column, int row, float wb, float wc) {
      visit(column, row,
            a.inverse_depth + wb * (b.inverse_depth - a.inverse_depth) + wc * (c.inverse_depth - a.inverse_depth));
    });
  }
}

void LidarAccumulator::ContinueForeground(DepthImage* depth) const {
  for (std::size_t k = 0; k < sweeps_.size(); ++k) {
    const std::vector<Projected>& projected = projected_[k];
    for (const Triangle& corners : sweeps_[k].gaps) {
      const Projected &a = projected[corners[0]], &b = projected[corners[1]], &c = projected[corners[2]];
      const float nearest_m = 1 / std::max({a.inverse_depth, b.inverse_depth, c.inverse_depth});
      VisitTriangle(a, b, c, [&](int column, int row, float, float) {
        if (count_(row, column) > 0) return;
        float& z_m = depth->depth_m(row, column);
        if (z_m == 0 || nearest_m < z_m) z_m = nearest_m;
      });
    }
  }
}

DepthImage LidarAccumulator::Render(std::int64_t t_ns, const Rigid3& T_world_event) {
  nearest_.create(camera_.height(), camera_.width());
  sum_.create(nearest_.size());
  count_.create(nearest_.size());
  nearest_.setTo(0);
  sum_.setTo(0);
  count_.setTo(0);
  projected_.resize(sweeps_.size());
  for (std::size_t k = 0; k < sweeps_.size(); ++k) {
    Project(sweeps_[k], T_world_event, &projected_[k]);
    VisitPixels(sweeps_[k], projected_[k], [this](int x, int y, float inverse_depth) {
      nearest_(y, x) = std::max(nearest_(y, x), inverse_depth);
    });
  }
  for (std::size_t k = 0; k < sweeps_.size(); ++k) {
    VisitPixels(sweeps_[k], projected_[k], [this](int x, int y, float inverse_depth) {
      const float nearest_m = 1 / nearest_(y, x);
      if (1 / inverse_depth > nearest_m + LayerGap(nearest_m)) return;  // hidden
      sum_(y, x) += inverse_depth;
      count_(y, x) += 1;
    });
  }
  DepthImage depth{t_ns, cv::Mat1f(nearest_.size(), 0.0F)};
  for (int y = 0; y < nearest_.rows; ++y) {
    for (int x = 0; x < nearest_.cols; ++x) {
      if (count_(y, x) > 0) depth.depth_m(y, x) = count_(y, x) / sum_(y, x);
    }
  }
  ContinueForeground(&depth);
  return depth;
}

}  // namespace devo
