// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/surface_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <deque>
#include <limits>
#include <optional>
#include <utility>

#include "devo/core/apparent_turn.h"
#include "devo/core/crest_threshold.h"
#include "devo/core/crests.h"
#include "devo/core/flicker_bursts.h"
#include "devo/core/lone_crests.h"
#include "devo/core/nearest_edge_field.h"
#include "devo/core/noise_filter.h"
#include "devo/core/surface_pool.h"
#include "devo/core/time.h"
#include "event_warp.h"
#include "plain_surface.h"
#include "simd.h"

namespace devo {
namespace {

constexpr std::int64_t kRateWindow_ns = 20'000'000;
// Events of noise that are expected in a moment: fewer tell nothing. This share of them are enough.
constexpr double kLeastNoise = 100, kNoiseShare = 0.1;
// Where noise is more than this share of a surface's events, not all of what chance makes of it is told by its height.
constexpr double kMuchNoise = 0.1;
constexpr std::int64_t kNoiseSpan_ns = 10'000'000;  // the moment: too little comes within less
constexpr std::size_t kFilterBatch = 1024;          // events filtered and then looked up, still in the first cache
// Shares of events that pass, and that are a lamp's, are learnt so fast, and no more extreme: more are not looked at.
constexpr double kLearns = 0.1, kLeastPass = 0.3, kMostOfLamps = 0.8;
constexpr std::size_t kMostLookedAt = 16;  // times the events of a surface
constexpr std::size_t kSightings = 12000;  // a sample of the events tells how the image moves
// Where events are so many that a surface spans a few milliseconds, the image hardly moves meanwhile: then so many of
// each surface before tell, too, as far back as this.
constexpr std::size_t kSightingsBefore = 2000;
constexpr float kLookBack_s = 0.03F;
constexpr std::size_t kAhead = 64;  // events: about the time that memory takes to answer

/// Viewing ray (x, y, 1) of each pixel; not finite in a corner that no ray of the lens model reaches.
class RayLookup {
 public:
  struct Ray {
    float x, y;
  };

  explicit RayLookup(const Camera& camera) : table_(RayTable(camera)) {
    if (camera.distortion() != DistortionModel::kNone) return;
    // Columns and rows are independent: two lines, which stay in the first cache, hold the whole table.
    for (int x = 0; x < camera.width(); ++x) x_.push_back(table_(0, x)[0]);
    for (int y = 0; y < camera.height(); ++y) y_.push_back(table_(y, 0)[1]);
    table_.release();
  }

  Ray operator()(int x, int y) const {
    if (!x_.empty()) return {x_[x], y_[y]};
    const cv::Vec2f& ray = table_(y, x);
    return {ray[0], ray[1]};
  }

  /// Has the ray fetched that will be asked for soon.
  void Expect(int x, int y) const {
    if (x_.empty()) Prefetch(table_[y] + x);
  }

 private:
  cv::Mat2f table_;
  std::vector<float> x_, y_;
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
  /// How many from `index` on lie one after the other in memory.
  std::size_t Contiguous(std::uint64_t index) const {
    return std::min<std::size_t>(end_ - index, data_.size() - (index & (data_.size() - 1)));
  }
  /// Calls `visit(pointer, count)` for those from `index` on, in at most two pieces.
  template <typename Visit>
  void ForPieces(std::uint64_t index, Visit&& visit) const {
    for (std::size_t count = 0; index < end_; index += count) {
      count = Contiguous(index);
      visit(&(*this)[index], count);
    }
  }
  void Clear() { end_ = 0; }

 private:
  std::vector<T> data_;
  std::uint64_t end_ = 0;
};

// Beyond that an acceleration is another one.
constexpr double kLongestAhead_s = 0.05;

/// Of and in the event frame: [v; omega], m/s and rad/s, at one time, and its change.
struct Motion {
  Vector6d velocity = Vector6d::Zero(), acceleration = Vector6d::Zero();

  /// From the camera `since_s` after that time to the camera then.
  Rigid3 Since(double since_s) const { return Exp(since_s * (velocity + 0.5 * since_s * acceleration)); }
};

/// The turn that moves the image as this velocity does where things are that far away; 0: at infinity.
Eigen::Vector3d AsTurn(const Vector6d& velocity_event, double depth_m) {
  Eigen::Vector3d turn = velocity_event.tail<3>();
  if (depth_m > 0) turn += Eigen::Vector3d(-velocity_event.y(), velocity_event.x(), 0) / depth_m;
  return turn;
}

}  // namespace

struct SurfaceBuilder::Impl {
  Impl(const Camera& event_camera, const SurfaceOptions& options_in)
      : options(options_in), camera(event_camera), undistorted(event_camera.Undistorted()), rays(event_camera),
        compensated(options_in.method == "motion_compensated"),
        events_per_surface(std::max<std::size_t>(
            500, static_cast<std::size_t>(options_in.event_share * event_camera.width() * event_camera.height()))),
        raw(compensated ? kMostLookedAt * events_per_surface : 1), kept(2 * events_per_surface),
        bursts(event_camera.width(), event_camera.height()),
        filter(event_camera.width(), event_camera.height(), options_in.noise_window_s, options_in.noise_neighbours,
               options_in.hot_pixel_factor),
        apparent_turn(undistorted) {
    if (!compensated) plain.emplace(camera, options.tau_s, options.delta);
  }

  std::uint64_t UsefulEvents() const;
  void FilterNewEvents();
  void FilterPiece(EventSpan piece);
  void LearnShares(std::uint64_t looked_at_now, std::uint64_t of_lamps, std::uint64_t kept_now);
  void NoteProgress(std::int64_t t_ns);
  bool NoiseGoesOn() const;
  void MeasureRates(std::int64_t t_ns, Surface* surface);
  void CollectSightings(std::uint64_t first, std::size_t most, std::int64_t t_ns, const Vector6d& velocity_event,
                        double depth_m);
  void AddSightingsBefore(std::int64_t t_ns);
  Motion MotionFor(const std::optional<ExpectedMotion>& expected, std::uint64_t first, const SceneDepth& depth,
                   const Surface& surface);
  void RenderCompensated(const std::optional<ExpectedMotion>& motion, const SceneDepth& depth, Surface* surface);
  std::uint64_t FirstKeptSince(std::int64_t oldest_ns) const;
  void Accumulate(std::uint64_t first, std::int64_t t_ns, const Motion& motion, const SceneDepth& depth);

  SurfaceOptions options;
  Camera camera, undistorted;
  RayLookup rays;
  bool compensated;
  std::size_t events_per_surface;

  Ring<Event> raw;
  std::uint64_t filtered_until = 0;
  std::uint64_t filtered_early = 0;  // events, by Filter since the last surface
  std::uint64_t looked_at = 0;       // by the filter, ever
  double pass_share = 0.5;           // of the events that the filter lately let pass
  double lamp_share = 0;             // of the events that were lately left to lamps, before
  Ring<RayEvent> kept;
  FlickerBursts bursts;
  NoiseFilter filter;
  std::array<Event, kFilterBatch> not_of_lamps;
  std::array<std::uint32_t, kFilterBatch> passed;
  ApparentTurn apparent_turn;
  std::vector<ApparentTurn::Sighting> sightings;
  struct SightingsOf {
    std::int64_t t_ns;
    std::vector<ApparentTurn::Sighting> sightings;
  };
  std::deque<SightingsOf> sightings_before;  // of the last surfaces, as long as no motion is known
  std::int64_t last_event_ns = std::numeric_limits<std::int64_t>::min();
  std::uint64_t epoch = 0;
  SurfaceCounters counters;
  SurfacePool pool;

  struct Progress {
    std::int64_t t_ns;
    std::uint64_t in, passed;
    bool knows_noise;
  };
  std::vector<Progress> progress;  // one per surface or loss, spanning the rate window: a few

  cv::Mat1w accumulated, blurred, scratch;
  SignedCounts accumulated_sign;

  std::optional<PlainSurface> plain;  // with the exponential method
};

SurfaceBuilder::SurfaceBuilder(const Camera& event_camera, const SurfaceOptions& options)
    : impl_(std::make_unique<Impl>(event_camera, options)) {}
SurfaceBuilder::~SurfaceBuilder() = default;

const SurfaceCounters& SurfaceBuilder::counters() const { return impl_->counters; }
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
  impl_->filtered_until = impl_->filtered_early = 0;
  impl_->pass_share = 0.5;
  impl_->lamp_share = 0;
  impl_->bursts.Clear();
  impl_->progress.clear();
  impl_->apparent_turn.Reset();
  impl_->sightings_before.clear();
  impl_->last_event_ns = std::numeric_limits<std::int64_t>::min();
  if (impl_->plain) impl_->plain->Reset();
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
      m.plain->Add(event);
    }
  }
  m.last_event_ns = last_ns;
  m.counters.in += events.size;
  if (m.compensated && m.options.ideas.leave_lamps) m.bursts.Look(events);
}

void SurfaceBuilder::OnLoss(std::int64_t t_ns) {
  Impl& m = *impl_;
  if (m.compensated) m.FilterNewEvents();
  m.progress.clear();
  m.NoteProgress(t_ns);
}

void SurfaceBuilder::Filter() {
  Impl& m = *impl_;
  if (!m.compensated || m.filtered_early >= m.UsefulEvents()) return;
  const std::uint64_t before = m.looked_at;
  m.FilterNewEvents();
  m.filtered_early += m.looked_at - before;
}

SurfacePtr SurfaceBuilder::Render(std::int64_t t_ns, const std::optional<ExpectedMotion>& motion,
                                  const SceneDepth& scene_depth) {
  Impl& m = *impl_;
  auto surface = m.pool.Take();
  surface->t_ns = surface->t_edges_ns = t_ns;
  surface->epoch = m.epoch;
  surface->image.create(m.undistorted.height(), m.undistorted.width());
  if (m.compensated) {
    m.FilterNewEvents();
    m.filtered_early = 0;
    m.MeasureRates(t_ns, surface.get());
    m.RenderCompensated(motion, scene_depth, surface.get());
  } else {
    m.MeasureRates(t_ns, surface.get());
    m.plain->Render(surface.get());
  }
  m.counters.used += surface->events_used;
  return surface;
}

/// No more than will fill a surface: beyond that the older ones would be filtered in vain.
std::uint64_t SurfaceBuilder::Impl::UsefulEvents() const {
  return static_cast<std::uint64_t>(1.2 * static_cast<double>(events_per_surface) / (pass_share * (1 - lamp_share)));
}

void SurfaceBuilder::Impl::FilterNewEvents() {
  const std::uint64_t useful = UsefulEvents();
  const std::uint64_t begin = std::max({filtered_until, raw.begin(), raw.end() - std::min(raw.end(), useful)});
  const std::uint64_t kept_before = kept.end(), of_lamps_before = counters.of_lamps;
  for (std::uint64_t next = begin; next < raw.end();) {
    const EventSpan piece(&raw[next], std::min<std::size_t>(raw.Contiguous(next), kFilterBatch));
    FilterPiece(piece);
    next += piece.size;
  }
  filtered_until = raw.end();
  LearnShares(raw.end() - begin, counters.of_lamps - of_lamps_before, kept.end() - kept_before);
}

/// At most kFilterBatch events.
void SurfaceBuilder::Impl::FilterPiece(EventSpan piece) {
  if (bursts.found()) {
    const auto of_lamp = [this](const Event& event) { return bursts.IsOfLamp(event); };
    Event* const end = std::remove_copy_if(piece.begin(), piece.end(), not_of_lamps.data(), of_lamp);
    const EventSpan left(not_of_lamps.data(), static_cast<std::size_t>(end - not_of_lamps.data()));
    counters.of_lamps += piece.size - left.size;
    piece = left;
  }
  const std::size_t count = piece.empty() ? 0 : filter.Pass(piece, passed.data());
  counters.noise += piece.size - count;
  for (std::size_t k = 0; k < count; ++k) {
    const Event &event = piece.data[passed[k]], &later = piece.data[passed[std::min(k + kAhead, count - 1)]];
    rays.Expect(later.x, later.y);
    const RayLookup::Ray ray = rays(event.x, event.y);
    if (std::isfinite(ray.x)) kept.Push({2 * event.t_ns + event.polarity, ray.x, ray.y});
  }
}

void SurfaceBuilder::Impl::LearnShares(std::uint64_t looked_at_now, std::uint64_t of_lamps, std::uint64_t kept_now) {
  looked_at += looked_at_now;
  if (looked_at_now < 100) return;
  lamp_share += kLearns * (static_cast<double>(of_lamps) / static_cast<double>(looked_at_now) - lamp_share);
  lamp_share = std::min(lamp_share, kMostOfLamps);
  const std::uint64_t others = looked_at_now - of_lamps;
  if (others < 100) return;
  pass_share += kLearns * (static_cast<double>(kept_now) / static_cast<double>(others) - pass_share);
  pass_share = std::max(pass_share, kLeastPass);
}

void SurfaceBuilder::Impl::NoteProgress(std::int64_t t_ns) {
  progress.push_back({t_ns, counters.in, compensated ? kept.end() : counters.in, !compensated || filter.knows_noise()});
}

bool SurfaceBuilder::Impl::NoiseGoesOn() const {
  if (!compensated || progress.size() < 2) return false;
  const Progress& now = progress.back();
  const Progress& last = *std::find_if(progress.rbegin() + 1, progress.rend() - 1,
                                       [&now](const Progress& then) { return now.t_ns - then.t_ns >= kNoiseSpan_ns; });
  const double expected = filter.noise_hz() * camera.width() * camera.height() * SecondsFromNs(now.t_ns - last.t_ns);
  return expected >= kLeastNoise && static_cast<double>(now.in - last.in) >= kNoiseShare * expected;
}

void SurfaceBuilder::Impl::MeasureRates(std::int64_t t_ns, Surface* surface) {
  NoteProgress(t_ns);
  while (progress.size() > 2 && progress[1].t_ns <= t_ns - kRateWindow_ns) progress.erase(progress.begin());
  const Progress &a = progress.front(), &b = progress.back();
  const double span_s = std::max(SecondsFromNs(b.t_ns - a.t_ns), 0.5 / options.rate_hz);
  surface->event_rate_hz = static_cast<double>(b.in - a.in) / span_s;
  surface->activity_hz = static_cast<double>(b.passed - a.passed) / span_s / (camera.width() * camera.height());
  surface->noise_goes_on = NoiseGoesOn();
  double beyond_noise_hz = surface->activity_hz;
  if (compensated) {
    beyond_noise_hz -= filter.mean_passing_noise_hz();
    surface->activity_hz = std::max(0.0, surface->activity_hz - filter.passing_noise_hz());
  }
  // Noise that is not known yet would pass for motion, and a map be made of it; so would very dense noise of before.
  const bool known = b.knows_noise && (a.knows_noise || !filter.noise_is_very_dense());
  surface->still = surface->activity_hz < options.still_activity_hz || !known;
  surface->maybe_noise = std::min(surface->activity_hz, beyond_noise_hz) < options.still_activity_hz;
}

std::uint64_t SurfaceBuilder::Impl::FirstKeptSince(std::int64_t oldest_ns) const {
  std::uint64_t before = std::max(kept.begin(), kept.end() - std::min<std::uint64_t>(kept.end(), events_per_surface));
  for (std::uint64_t count = kept.end() - before; count > 0;) {
    const std::uint64_t half = count / 2;
    const bool older = kept[before + half].t_ns() < oldest_ns;
    before += older ? half + 1 : 0;
    count = older ? count - half - 1 : half;
  }
  return before;
}

/// What the camera sees at `t_ns` of at most so many of the events, were everything that far away.
void SurfaceBuilder::Impl::CollectSightings(std::uint64_t first, std::size_t most, std::int64_t t_ns,
                                            const Vector6d& velocity_event, double depth_m) {
  sightings.clear();
  const std::uint64_t step = (kept.end() - first) / most + 1;
  const Eigen::Vector3d w = velocity_event.tail<3>();
  const Eigen::Vector3d v = depth_m > 0 ? Eigen::Vector3d(velocity_event.head<3>() / depth_m) : Eigen::Vector3d::Zero();
  for (std::uint64_t i = first; i < kept.end(); i += step) {
    const RayEvent& event = kept[i];
    const double t_s = SecondsFromNs(event.t_ns() - t_ns);
    // The flow of a few pixels: to first order.
    const Eigen::Vector3d ray(event.ray_x, event.ray_y, 1);
    const Eigen::Vector3d then = ray + t_s * (v + w.cross(ray));
    sightings.push_back({static_cast<float>(t_s), static_cast<float>(then.x() / then.z()),
                         static_cast<float>(then.y() / then.z()), event.polarity()});
  }
}

/// To those of the surface of `t_ns`, which will be among those before from now on.
void SurfaceBuilder::Impl::AddSightingsBefore(std::int64_t t_ns) {
  if (sightings.empty() || sightings.front().t_s < -kLookBack_s) return;
  SightingsOf last{t_ns, {}};
  const std::size_t step = sightings.size() / kSightingsBefore + 1;
  for (std::size_t i = 0; i < sightings.size(); i += step) last.sightings.push_back(sightings[i]);
  std::vector<ApparentTurn::Sighting> all;
  for (const SightingsOf& before : sightings_before) {
    const auto later_s = static_cast<float>(SecondsFromNs(before.t_ns - t_ns));
    for (ApparentTurn::Sighting sighting : before.sightings) {
      sighting.t_s += later_s;
      const float newest_s = all.empty() ? -kLookBack_s : all.back().t_s;
      if (sighting.t_s > newest_s && sighting.t_s < sightings.front().t_s) all.push_back(sighting);
    }
  }
  if (!all.empty()) {
    all.insert(all.end(), last.sightings.begin(), last.sightings.end());
    sightings = std::move(all);
  }
  sightings_before.push_back(std::move(last));
  while (SecondsFromNs(t_ns - sightings_before.front().t_ns) > kLookBack_s) sightings_before.pop_front();
}

/// At the time of the surface's edges.
Motion SurfaceBuilder::Impl::MotionFor(const std::optional<ExpectedMotion>& expected, std::uint64_t first,
                                       const SceneDepth& depth, const Surface& surface) {
  Motion motion;
  if (!options.ideas.move_events) return motion;
  if (!expected || expected->turn_alone) {
    if (!options.ideas.find_turn) return motion;
    const Eigen::Vector3d read = expected ? expected->velocity_event.tail<3>() : Eigen::Vector3d::Zero().eval();
    CollectSightings(first, kSightings, surface.t_ns, motion.velocity, 0);
    AddSightingsBefore(surface.t_ns);
    motion.velocity.tail<3>() = apparent_turn.Estimate(sightings, read);
    return motion;
  }
  sightings_before.clear();
  motion.velocity = expected->velocity_event;
  if (options.ideas.accelerate_events) {
    motion.acceleration = expected->acceleration_event;
    motion.velocity +=
        std::clamp(SecondsFromNs(surface.t_edges_ns - expected->t_ns), 0.0, kLongestAhead_s) * motion.acceleration;
  }
  if (!expected->of_poses || surface.still || !options.ideas.refine_turn) return motion;
  CollectSightings(first, ApparentTurn::kMostLookedAt, surface.t_edges_ns, motion.velocity, depth.median_m);
  motion.velocity.tail<3>() += apparent_turn.Beside(sightings, AsTurn(motion.velocity, depth.median_m));
  return motion;
}

void SurfaceBuilder::Impl::RenderCompensated(const std::optional<ExpectedMotion>& motion, const SceneDepth& depth,
                                             Surface* surface) {
  const std::int64_t oldest_ns = surface->t_ns - NsFromSeconds(options.max_window_s);
  const std::uint64_t first = FirstKeptSince(oldest_ns);
  surface->events_used = static_cast<std::uint32_t>(kept.end() - first);
  surface->window_s = surface->events_used ? SecondsFromNs(surface->t_ns - kept[first].t_ns()) : 0.0;

  std::int64_t age_sum_ns = 0;
  kept.ForPieces(first, [&](const RayEvent* events, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) age_sum_ns += surface->t_ns - events[i].t_ns();
  });
  if (surface->events_used && options.ideas.mean_time) surface->t_edges_ns -= age_sum_ns / surface->events_used;
  SceneDepth scene = depth;
  if (!options.ideas.depth_grid) scene.inverse_depth.release();
  const Motion used = MotionFor(motion, first, depth, *surface);
  const bool of_events = !motion || motion->of_poses || motion->turn_alone;
  surface->turn_event = of_events ? AsTurn(used.velocity, depth.median_m) : Eigen::Vector3d::Zero().eval();
  Accumulate(first, surface->t_edges_ns, used, scene);
  Blur(accumulated, options.blur_px, &scratch, &blurred);
  const double noise_per_pixel = options.ideas.above_noise ? filter.passing_noise_hz() * surface->window_s : 0;
  const int threshold = CrestThreshold(blurred, options.crest_quantile, noise_per_pixel, options.blur_px);
  FindCrests(blurred, accumulated_sign, threshold, &surface->edges, options.ideas.clear_crests);
  const double noise = noise_per_pixel * static_cast<double>(surface->image.total());
  if (noise > kMuchNoise * surface->events_used) DropLoneCrests(surface->image.size(), &surface->edges);
  surface->nearest_edge.create(surface->image.size());
  BuildNearestEdgeField(surface->edges, options.truncation_px, &surface->nearest_edge);
  // For people: three times the crest threshold is white.
  blurred.convertTo(surface->image, CV_8U, 85.0 / std::max(threshold, kEventWeight / 4));
}

void SurfaceBuilder::Impl::Accumulate(std::uint64_t first, std::int64_t t_ns, const Motion& motion,
                                      const SceneDepth& depth) {
  // Poses within a slice of this length are taken as one: at 1000 px/s half of it is 0.1 px.
  constexpr std::int64_t kSlice_ns = 200'000;
  accumulated.create(undistorted.height(), undistorted.width());
  accumulated_sign.create(undistorted.height(), undistorted.width());
  std::memset(accumulated.data, 0, accumulated.total() * accumulated.elemSize());
  std::memset(accumulated_sign.data, 0, accumulated_sign.total() * accumulated_sign.elemSize());
  EventWarp warp(undistorted, depth, &accumulated, &accumulated_sign);
  std::int64_t slice_end_ns = std::numeric_limits<std::int64_t>::min();
  kept.ForPieces(first, [&](const RayEvent* next, std::size_t count) {
    for (const RayEvent* end = next + count; next != end;) {
      if (next->t_ns() >= slice_end_ns) {
        warp.SetPose(motion.Since(SecondsFromNs(next->t_ns() + kSlice_ns / 2 - t_ns)));
        slice_end_ns = next->t_ns() + kSlice_ns;
      }
      const RayEvent* until = next;
      while (until != end && until->t_ns() < slice_end_ns) ++until;
      warp.Add(next, until);
      next = until;
    }
  });
}

}  // namespace devo
