// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/surface_builder.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <stdexcept>

#include "devo/core/crests.h"
#include "devo/core/noise_filter.h"
#include "devo/core/surface_pool.h"
#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kRateWindow_ns = 20'000'000;

/// An event that passed the noise filter, with its viewing ray (x, y, 1).
struct RayEvent {
  std::int64_t t_ns;
  float ray_x, ray_y;
  std::uint8_t polarity;
};

/// Fixed-capacity history of the newest elements, no allocation after construction.
template <typename T>
class Ring {
 public:
  explicit Ring(std::size_t min_capacity) {
    std::size_t capacity = 1;
    while (capacity < min_capacity) capacity *= 2;
    data_.resize(capacity);
  }
  void Push(const T& value) { data_[end_++ & (data_.size() - 1)] = value; }
  /// Elements are numbered from the first ever pushed; the last `capacity` of them are kept.
  const T& operator[](std::uint64_t index) const { return data_[index & (data_.size() - 1)]; }
  std::uint64_t begin() const { return end_ > data_.size() ? end_ - data_.size() : 0; }
  std::uint64_t end() const { return end_; }
  void Clear() { end_ = 0; }

 private:
  std::vector<T> data_;
  std::uint64_t end_ = 0;
};

}  // namespace

struct SurfaceBuilder::Impl {
  Impl(const Camera& event_camera, const SurfaceOptions& options_in)
      : options(options_in), camera(event_camera), undistorted(event_camera.Undistorted()),
        rays(RayTable(event_camera)), compensated(options_in.method == "motion_compensated"),
        events_per_surface(std::max<std::size_t>(
            500, static_cast<std::size_t>(options_in.event_share * event_camera.width() * event_camera.height()))),
        raw(compensated ? 4 * events_per_surface : 1), kept(2 * events_per_surface),
        filter(event_camera.width(), event_camera.height(), options_in.noise_window_s, options_in.noise_neighbours,
               options_in.hot_pixel_factor) {
    if (!compensated) PreparePlainSurface();
  }

  void PreparePlainSurface();
  void FilterNewEvents();
  void MeasureRates(std::int64_t t_ns, Surface* surface);
  void RenderCompensated(const Vector6d& velocity_event, const SceneDepth& depth, Surface* surface);
  void Accumulate(std::uint64_t first, std::int64_t t_ns, const Vector6d& velocity_event, const SceneDepth& depth);
  void RenderExponential(Surface* surface) const;

  SurfaceOptions options;
  Camera camera, undistorted;
  cv::Mat2f rays;
  bool compensated;
  std::size_t events_per_surface;

  Ring<Event> raw;
  std::uint64_t filtered_until = 0;
  double pass_share = 0.5;  // of the events that the filter lately let pass
  Ring<RayEvent> kept;
  NoiseFilter filter;
  std::int64_t last_event_ns = std::numeric_limits<std::int64_t>::min();
  std::uint64_t epoch = 0;
  Counters counters;
  SurfacePool pool;

  struct Progress {
    std::int64_t t_ns;
    std::uint64_t in, passed;
  };
  std::deque<Progress> progress;  // one per surface, spanning the rate window

  cv::Mat1w accumulated, blurred, scratch;
  cv::Mat1s accumulated_sign;

  // The paper's surface: last event of each raw pixel, and the raw pixel that each undistorted one shows.
  std::vector<std::int64_t> last_ns;
  cv::Mat1i source_pixel;
};

SurfaceBuilder::SurfaceBuilder(const Camera& event_camera, const SurfaceOptions& options)
    : impl_(std::make_unique<Impl>(event_camera, options)) {}
SurfaceBuilder::~SurfaceBuilder() = default;

const SurfaceBuilder::Counters& SurfaceBuilder::counters() const { return impl_->counters; }
std::uint64_t SurfaceBuilder::epoch() const { return impl_->epoch; }

void SurfaceBuilder::SetOptions(const SurfaceOptions& options) {
  const SurfaceOptions before = impl_->options;
  impl_->options = options;
  impl_->options.method = before.method;
  impl_->options.event_share = before.event_share;
  impl_->filter.SetCriteria(options.noise_window_s, options.noise_neighbours, options.hot_pixel_factor);
}

void SurfaceBuilder::Reset() {
  impl_->raw.Clear();
  impl_->kept.Clear();
  impl_->filter.Reset();
  impl_->filtered_until = 0;
  impl_->pass_share = 0.5;
  impl_->progress.clear();
  impl_->last_event_ns = std::numeric_limits<std::int64_t>::min();
  std::fill(impl_->last_ns.begin(), impl_->last_ns.end(), std::numeric_limits<std::int64_t>::min());
  ++impl_->epoch;
}

void SurfaceBuilder::Insert(EventSpan events) {
  Impl& m = *impl_;
  const int w = m.camera.width(), h = m.camera.height();
  std::int64_t last_ns = m.last_event_ns;
  for (const Event& event : events) {
    if (event.x >= w || event.y >= h) {
      ++m.counters.outside;
      continue;
    }
    if (event.t_ns < last_ns) {
      ++m.counters.unordered;
      continue;
    }
    last_ns = event.t_ns;
    if (m.compensated) {
      m.raw.Push(event);
    } else {
      m.last_ns[static_cast<std::size_t>(event.y) * w + event.x] = event.t_ns;
    }
  }
  m.last_event_ns = last_ns;
  m.counters.in += events.size;
}

SurfacePtr SurfaceBuilder::Render(std::int64_t t_ns, const Vector6d& velocity_event, const SceneDepth& scene_depth) {
  Impl& m = *impl_;
  auto surface = m.pool.Take();
  surface->t_ns = surface->t_edges_ns = t_ns;
  surface->epoch = m.epoch;
  surface->image.create(m.camera.height(), m.camera.width());
  if (m.compensated) {
    m.FilterNewEvents();
    m.MeasureRates(t_ns, surface.get());
    m.RenderCompensated(velocity_event, scene_depth, surface.get());
  } else {
    m.MeasureRates(t_ns, surface.get());
    m.RenderExponential(surface.get());
  }
  m.counters.used += surface->events_used;
  return surface;
}

void SurfaceBuilder::Impl::FilterNewEvents() {
  // No more than will fill a surface: beyond that the older ones would be filtered in vain.
  const auto useful = static_cast<std::uint64_t>(1.2 * static_cast<double>(events_per_surface) / pass_share);
  const std::uint64_t begin = std::max({filtered_until, raw.begin(), raw.end() - std::min(raw.end(), useful)});
  const std::uint64_t kept_before = kept.end();
  for (std::uint64_t i = begin; i < raw.end(); ++i) {
    const Event& event = raw[i];
    if (!filter.Pass(event)) {
      ++counters.noise;
      continue;
    }
    const cv::Vec2f& ray = rays(event.y, event.x);
    if (!std::isfinite(ray[0])) continue;  // a corner that no ray of the lens model reaches
    kept.Push({event.t_ns, ray[0], ray[1], event.polarity});
  }
  filtered_until = raw.end();
  const std::uint64_t looked_at = raw.end() - begin;
  if (looked_at < 100) return;
  pass_share += 0.1 * (static_cast<double>(kept.end() - kept_before) / static_cast<double>(looked_at) - pass_share);
  pass_share = std::max(pass_share, 0.3);
}

void SurfaceBuilder::Impl::MeasureRates(std::int64_t t_ns, Surface* surface) {
  // When events come faster than surfaces use them, only some went through the filter: scale by the share.
  progress.push_back({t_ns, counters.in, compensated ? kept.end() : counters.in});
  while (progress.size() > 2 && progress[1].t_ns <= t_ns - kRateWindow_ns) progress.pop_front();
  const Progress &a = progress.front(), &b = progress.back();
  const double span_s = std::max(SecondsFromNs(b.t_ns - a.t_ns), 0.5 / options.rate_hz);
  surface->event_rate_hz = static_cast<double>(b.in - a.in) / span_s;
  surface->activity_hz = static_cast<double>(b.passed - a.passed) / span_s / (camera.width() * camera.height());
  if (compensated) surface->activity_hz = std::max(0.0, surface->activity_hz - filter.passing_noise_hz());
  surface->still = surface->activity_hz < options.still_activity_hz;
}

void SurfaceBuilder::Impl::RenderCompensated(const Vector6d& velocity_event, const SceneDepth& depth,
                                             Surface* surface) {
  const std::int64_t oldest_ns = surface->t_ns - NsFromSeconds(options.max_window_s);
  std::uint64_t first = kept.end();
  const std::uint64_t limit =
      std::max(kept.begin(), kept.end() - std::min<std::uint64_t>(kept.end(), events_per_surface));
  while (first > limit && kept[first - 1].t_ns >= oldest_ns) --first;
  surface->events_used = static_cast<std::uint32_t>(kept.end() - first);
  surface->window_s = surface->events_used ? SecondsFromNs(surface->t_ns - kept[first].t_ns) : 0.0;

  std::int64_t age_sum_ns = 0;
  for (std::uint64_t i = first; i < kept.end(); ++i) age_sum_ns += surface->t_ns - kept[i].t_ns;
  if (surface->events_used) surface->t_edges_ns -= age_sum_ns / surface->events_used;
  Accumulate(first, surface->t_edges_ns, velocity_event, depth);
  Blur(accumulated, options.blur_px, &scratch, &blurred);
  const int threshold = OccupiedQuantile(blurred, options.crest_quantile);
  FindCrests(blurred, accumulated_sign, threshold, &surface->edges);
  surface->nearest_edge.create(surface->image.size());
  BuildNearestEdgeField(surface->edges, options.truncation_px, &surface->nearest_edge);
  // For people: three times the crest threshold is white.
  blurred.convertTo(surface->image, CV_8U, 85.0 / std::max(threshold, kEventWeight / 4));
}

void SurfaceBuilder::Impl::Accumulate(std::uint64_t first, std::int64_t t_ns, const Vector6d& velocity_event,
                                      const SceneDepth& depth) {
  // Poses within a slice of this length are taken as one: at 1000 px/s half of it is 0.1 px.
  constexpr std::int64_t kSlice_ns = 200'000;
  constexpr int kSub = 8;  // positions are split between four pixels in steps of 1/8: weights sum to 64
  static_assert(kSub * kSub == kEventWeight);
  accumulated.create(camera.height(), camera.width());
  accumulated_sign.create(camera.height(), camera.width());
  accumulated.setTo(0);
  accumulated_sign.setTo(0);
  const auto fx = static_cast<float>(undistorted.fx()), fy = static_cast<float>(undistorted.fy());
  const auto cx = static_cast<float>(undistorted.cx()), cy = static_cast<float>(undistorted.cy());
  const auto max_x = static_cast<float>(camera.width() - 1), max_y = static_cast<float>(camera.height() - 1);
  const float inverse_median = depth.median_m > 0 ? static_cast<float>(1.0 / depth.median_m) : 0.0F;
  const cv::Mat1f& grid = depth.inverse_depth;
  const float grid_x = grid.empty() ? 0.0F : grid.cols / (max_x + 1),
              grid_y = grid.empty() ? 0.0F : grid.rows / (max_y + 1);

  std::int64_t slice_end_ns = std::numeric_limits<std::int64_t>::min();
  Eigen::Matrix3f R = Eigen::Matrix3f::Identity();
  Eigen::Vector3f t = Eigen::Vector3f::Zero();
  for (std::uint64_t i = first; i < kept.end(); ++i) {
    const RayEvent& event = kept[i];
    if (event.t_ns >= slice_end_ns) {
      // T_event(t)_event(t_e) under constant velocity in the event frame.
      const Rigid3 T_now_then = Exp(velocity_event * SecondsFromNs(event.t_ns + kSlice_ns / 2 - t_ns));
      R = T_now_then.rotation().toRotationMatrix().cast<float>();
      t = T_now_then.translation().cast<float>();
      slice_end_ns = event.t_ns + kSlice_ns;
    }
    float inverse_depth = inverse_median;
    if (!grid.empty()) {
      const int gx = static_cast<int>((fx * event.ray_x + cx) * grid_x),
                gy = static_cast<int>((fy * event.ray_y + cy) * grid_y);
      if (gx >= 0 && gy >= 0 && gx < grid.cols && gy < grid.rows) inverse_depth = grid(gy, gx);
    }
    const float X = R(0, 0) * event.ray_x + R(0, 1) * event.ray_y + R(0, 2) + t.x() * inverse_depth;
    const float Y = R(1, 0) * event.ray_x + R(1, 1) * event.ray_y + R(1, 2) + t.y() * inverse_depth;
    const float Z = R(2, 0) * event.ray_x + R(2, 1) * event.ray_y + R(2, 2) + t.z() * inverse_depth;
    if (!(Z > 0.1F)) continue;
    const float u = fx * X / Z + cx, v = fy * Y / Z + cy;
    if (!(u >= 0 && v >= 0 && u < max_x && v < max_y)) continue;
    const int u8 = static_cast<int>(u * kSub + 0.5F), v8 = static_cast<int>(v * kSub + 0.5F);
    const int x = u8 / kSub, y = v8 / kSub, ax = u8 % kSub, ay = v8 % kSub;
    if (x + 1 > max_x || y + 1 > max_y) continue;
    const std::uint16_t w00 = (kSub - ax) * (kSub - ay), w10 = ax * (kSub - ay), w01 = (kSub - ax) * ay, w11 = ax * ay;
    std::uint16_t *p = accumulated[y] + x, *q = accumulated[y + 1] + x;
    if (p[0] > 3900 || p[1] > 3900 || q[0] > 3900 || q[1] > 3900) continue;  // keeps the blur within 16 bits
    p[0] += w00;
    p[1] += w10;
    q[0] += w01;
    q[1] += w11;
    const int nearest_x = ax * 2 >= kSub ? x + 1 : x, nearest_y = ay * 2 >= kSub ? y + 1 : y;
    accumulated_sign(nearest_y, nearest_x) += event.polarity ? kEventWeight : -kEventWeight;
  }
}

void SurfaceBuilder::Impl::PreparePlainSurface() {
  last_ns.assign(static_cast<std::size_t>(camera.width()) * camera.height(), std::numeric_limits<std::int64_t>::min());
  source_pixel.create(camera.height(), camera.width());
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const Eigen::Vector3d ray((x - undistorted.cx()) / undistorted.fx(), (y - undistorted.cy()) / undistorted.fy(),
                                1);
      const auto u = camera.Project(ray);
      source_pixel(y, x) = u && camera.Contains(*u) ? static_cast<int>(std::lround(u->y())) * camera.width() +
                                                          static_cast<int>(std::lround(u->x()))
                                                    : -1;
    }
  }
}

void SurfaceBuilder::Impl::RenderExponential(Surface* surface) const {
  // exp(-age / tau) in 255 levels is exactly 0 beyond this age.
  const double max_age_s = options.tau_s * std::log(2 * 255.0);
  const std::int64_t oldest_ns = surface->t_ns - NsFromSeconds(max_age_s);
  const auto decay = static_cast<float>(-1e-9 / options.tau_s);
  const double threshold = 255 * options.delta;
  std::int64_t oldest_used_ns = surface->t_ns;
  for (int y = 0; y < surface->height(); ++y) {
    const int* source = source_pixel[y];
    std::uint8_t* value = surface->image[y];
    for (int x = 0; x < surface->width(); ++x) {
      const std::int64_t t_ns = source[x] < 0 ? std::numeric_limits<std::int64_t>::min() : last_ns[source[x]];
      value[x] = 0;
      if (t_ns < oldest_ns) continue;
      value[x] =
          static_cast<std::uint8_t>(std::lround(255 * std::exp(decay * static_cast<float>(surface->t_ns - t_ns))));
      oldest_used_ns = std::min(oldest_used_ns, t_ns);
      ++surface->events_used;
      const bool inner = x >= 3 && y >= 3 && x < surface->width() - 3 && y < surface->height() - 3;
      if (inner && value[x] > threshold) {
        surface->edges.push_back({static_cast<float>(x), static_cast<float>(y), 0, 0, value[x] / 255.0F, 0});
      }
    }
  }
  surface->window_s = SecondsFromNs(surface->t_ns - oldest_used_ns);
}

}  // namespace devo
