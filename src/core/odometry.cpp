// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/odometry.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "devo/core/mapper.h"
#include "devo/core/surface_builder.h"
#include "devo/core/time.h"
#include "devo/core/tracker.h"

namespace devo {
namespace {

/// Appends the milliseconds of its lifetime.
class Stopwatch {
 public:
  explicit Stopwatch(std::vector<float>* out_ms) : out_ms_(out_ms), begin_(std::chrono::steady_clock::now()) {}
  ~Stopwatch() {
    out_ms_->push_back(std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - begin_).count());
  }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  std::vector<float>* out_ms_;
  std::chrono::steady_clock::time_point begin_;
};

OdometryOptions Validated(const OdometryOptions& options) {
  Validate(options);
  return options;
}

}  // namespace

struct Odometry::Impl {
  Impl(const Rig& rig, const OdometryOptions& options_in)
      : options(Validated(options_in)), surfaces(rig.event_camera, options.surface), mapper(rig, options),
        tracker(rig.event_camera, options), period_ns(NsFromSeconds(1.0 / options.surface.rate_hz)) {}

  OdometryOptions options;
  SurfaceBuilder surfaces;
  Mapper mapper;
  Tracker tracker;
  std::int64_t period_ns;
  std::int64_t next_ns = 0;  // time of the next surface; 0 before the first event
  Timings timings;
  mutable Counters counters;
};

Odometry::Odometry(const Rig& rig, const OdometryOptions& options) : impl_(std::make_unique<Impl>(rig, options)) {}
Odometry::~Odometry() = default;

void Odometry::AddEvents(EventSpan events) {
  Impl& m = *impl_;
  const Event* next = events.begin();
  while (next != events.end()) {
    // Surfaces lie on multiples of the period, so that streams cut anywhere give the same times.
    if (m.next_ns == 0) m.next_ns = (next->t_ns / m.period_ns + 1) * m.period_ns;
    const Event* until = std::partition_point(next, events.end(), [&](const Event& e) { return e.t_ns < m.next_ns; });
    {
      m.surfaces.Insert({next, static_cast<std::size_t>(until - next)});
      next = until;
    }
    if (next == events.end()) break;
    Step();
  }
}

void Odometry::Step() {
  Impl& m = *impl_;
  SurfacePtr surface;
  {
    Stopwatch watch(&m.timings.surface_ms);
    surface = m.surfaces.Render(m.next_ns, m.tracker.MeanVelocity(), m.mapper.scene_depth());
  }
  m.next_ns += m.period_ns;
  std::optional<PoseEstimate> pose;
  {
    Stopwatch watch(&m.timings.tracking_ms);
    pose = m.tracker.Track(*surface);
  }
  {
    Stopwatch watch(&m.timings.mapping_ms);
    m.mapper.AddSurface(surface);
    if (pose) m.mapper.AddPose(*pose);
    if (const LocalMapPtr map = m.mapper.Update()) {
      m.tracker.SetMap(map);
      if (on_local_map) on_local_map(map);
    }
  }
  if (pose && on_pose) on_pose(*pose, *surface);
}

void Odometry::AddDepth(const DepthImage& depth) { impl_->mapper.AddDepth(depth); }

void Odometry::AddSweep(LidarSweep sweep) { impl_->mapper.AddSweep(std::move(sweep)); }

void Odometry::AddImu(const ImuSample& sample) { impl_->tracker.AddImu(sample); }

std::vector<MapPoint> Odometry::GlobalMap() const { return impl_->mapper.GlobalMap(); }
const Odometry::Timings& Odometry::timings() const { return impl_->timings; }

const Odometry::Counters& Odometry::counters() const {
  const Impl& m = *impl_;
  const auto& s = m.surfaces.counters();
  const auto& d = m.mapper.counters();
  m.counters = {s.in,        s.used, s.outside, s.unordered, d.depth_in, d.depth_used, d.depth_without_valid_pixel,
                d.references};
  return m.counters;
}

}  // namespace devo
