// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/odometry.h"

#include <algorithm>
#include <chrono>
#include <future>
#include <iomanip>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "devo/core/mapper.h"
#include "devo/core/surface_builder.h"
#include "devo/core/task_thread.h"
#include "devo/core/time.h"
#include "devo/core/tracker.h"

namespace devo {
namespace {

/// A map is used from the surface so many after the next one on, whether it was ready before or not: mapping has that
/// long to run beside tracking, and the result is the same with and without threads. The next surface waits for where
/// depth saw the camera, though: in fast motion every moment that a velocity goes on uncorrected counts.
constexpr std::size_t kMapDelay = 2;

constexpr double kLongestSilence_s = 3600;

/// Milliseconds since it was made.
class Stopwatch {
 public:
  float ms() const {
    return std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

OdometryOptions Validated(const OdometryOptions& options) {
  Validate(options);
  return options;
}

struct Tracked {
  std::optional<PoseEstimate> pose;
  std::optional<ExpectedMotion> motion;  // what a next surface is to know
  float ms;
};

struct Mapped {
  LocalMapPtr map;  // null where it did not change
  SceneDepth scene_depth;
  MappingCounters counters;
  float ms;
};

}  // namespace

struct Odometry::Impl {
  Impl(const Rig& rig, const OdometryOptions& options_in, int threads)
      : options(Validated(options_in)), surfaces(rig.event_camera, options.surface), mapper(rig, options),
        tracker(rig.event_camera, options), period_ns(NsFromSeconds(1.0 / options.surface.rate_hz)),
        threaded(threads > 1), tracking_thread(threaded), mapping_thread(threaded) {}

  OdometryOptions options;
  SurfaceBuilder surfaces;
  Mapper mapper;          // mapping_thread's
  float aligning_ms = 0;  // mapping_thread's, of the surface that it maps
  Tracker tracker;        // tracking_thread's, while `tracked` is open
  std::int64_t period_ns;
  std::int64_t next_ns = 0;  // time of the next surface; 0 before the first event
  SceneDepth scene_depth;
  std::optional<ExpectedMotion> motion;       // for the next surface: as of the last but one
  std::optional<ExpectedMotion> last_motion;  // as of the last one that was tracked
  std::vector<ImuSample> imu;                 // since the last surface
  SurfacePtr surface;                         // the last one
  std::shared_future<Tracked> tracked;
  std::deque<std::future<std::vector<DepthPose>>> aligned;  // of the last surfaces, oldest first
  bool depth_came = false;                                  // the last of them that was taken had a depth image
  std::deque<std::future<Mapped>> mapped;                   // of the last surfaces, oldest first
  MappingCounters mapping_counters;
  Timings timings;
  bool threaded;
  TaskThread tracking_thread, mapping_thread;  // last: joined before what they use goes
};

Odometry::Odometry(const Rig& rig, const OdometryOptions& options, int threads)
    : impl_(std::make_unique<Impl>(rig, options, threads)) {}
Odometry::~Odometry() = default;

void Odometry::AddEvents(EventSpan events) {
  Impl& m = *impl_;
  const Event* next = events.begin();
  while (next != events.end()) {
    // Surfaces lie on multiples of the period, so that streams cut anywhere give the same times.
    if (m.next_ns == 0) m.next_ns = (next->t_ns / m.period_ns + 1) * m.period_ns;
    const Event* until = std::partition_point(next, events.end(), [&](const Event& e) { return e.t_ns < m.next_ns; });
    m.surfaces.Insert({next, static_cast<std::size_t>(until - next)});
    next = until;
    if (next == events.end()) break;
    if (SecondsFromNs(next->t_ns - m.next_ns) > kLongestSilence_s) {
      std::ostringstream message;
      message << std::fixed << std::setprecision(3) << "an event of " << SecondsFromNs(next->t_ns)
              << " s follows those up to " << SecondsFromNs(m.next_ns)
              << " s, expected times of one clock without a gap of more than " << kLongestSilence_s << " s";
      throw std::runtime_error(message.str());
    }
    Step();
  }
}

void Odometry::Step() {
  Impl& m = *impl_;
  const Stopwatch rendering;  // beside the tracking of the surface before
  SurfacePtr surface = m.surfaces.Render(m.next_ns, m.motion, m.scene_depth);
  m.timings.surface_ms.push_back(rendering.ms());
  m.next_ns += m.period_ns;
  TakePose();
  m.motion = m.last_motion;
  TakeMaps(kMapDelay);
  // The surface after one with a depth image, which is being mapped yet, hardly ever has another: it is not waited for.
  TakeDepthPoses(m.depth_came ? 1 : 0);
  for (const ImuSample& sample : m.imu) m.tracker.AddImu(sample);
  m.imu.clear();

  m.surface = surface;
  m.tracked = m.tracking_thread.Run([&m, surface]() -> Tracked {
    const Stopwatch tracking;
    auto pose = m.tracker.Track(surface);
    std::optional<ExpectedMotion> motion;
    if (pose) {
      motion.emplace(*pose);
    } else if (const auto turn = m.tracker.TurnRead(surface->t_ns)) {
      motion = ExpectedMotion::OfTurn(*turn);
    }
    return {std::move(pose), motion, tracking.ms()};
  });
  MapBeside(surface);
  if (!m.threaded) TakePose();
}

void Odometry::MapBeside(const SurfacePtr& surface) {
  Impl& m = *impl_;
  m.aligned.push_back(m.mapping_thread.Run([&m, surface, tracked = m.tracked] {
    const std::optional<PoseEstimate>& pose = tracked.get().pose;
    const Stopwatch aligning;
    m.mapper.AddSurface(surface);
    if (pose) m.mapper.AddPose(*pose);
    m.mapper.AlignDepth();
    m.aligning_ms = aligning.ms();
    // Where more than one image was due, the others were aligned with the surface before, and come first.
    return m.mapper.TakeDepthPoses();
  }));
  m.mapped.push_back(m.mapping_thread.Run([&m]() -> Mapped {
    const Stopwatch mapping;
    LocalMapPtr map = m.mapper.Update();
    return {std::move(map), m.mapper.scene_depth(), m.mapper.counters(), m.aligning_ms + mapping.ms()};
  }));
}

void Odometry::TakePose() {
  Impl& m = *impl_;
  if (!m.tracked.valid()) return;
  const Tracked tracked = std::exchange(m.tracked, {}).get();
  m.timings.tracking_ms.push_back(tracked.ms);
  m.last_motion = tracked.motion;
  if (tracked.pose && on_pose) on_pose(*tracked.pose, *m.surface);
}

void Odometry::TakeDepthPoses(std::size_t but_last) {
  Impl& m = *impl_;
  m.depth_came = false;
  while (m.aligned.size() > but_last) {
    auto next = std::move(m.aligned.front());
    m.aligned.pop_front();
    const std::vector<DepthPose> poses = next.get();
    m.depth_came = !poses.empty();
    for (const DepthPose& pose : poses) m.tracker.AddDepthPose(pose);
  }
}

void Odometry::TakeMaps(std::size_t but_last) {
  Impl& m = *impl_;
  while (m.mapped.size() > but_last) {
    auto next = std::move(m.mapped.front());
    m.mapped.pop_front();
    const Mapped mapped = next.get();
    m.timings.mapping_ms.push_back(mapped.ms);
    m.scene_depth = mapped.scene_depth;
    m.mapping_counters = mapped.counters;
    if (!mapped.map) continue;
    m.tracker.SetMap(mapped.map);
    if (on_local_map) on_local_map(mapped.map);
  }
}

void Odometry::Finish() {
  TakePose();
  TakeMaps(0);
  TakeDepthPoses(0);
}

void Odometry::AddDepth(const DepthImage& depth) {
  Impl& m = *impl_;
  m.mapping_thread.Run([&m, depth] { m.mapper.AddDepth(depth); });
}

void Odometry::AddSweep(LidarSweep sweep) {
  Impl& m = *impl_;
  m.mapping_thread.Run([&m, sweep = std::move(sweep)]() mutable { m.mapper.AddSweep(std::move(sweep)); });
}

void Odometry::AddImu(const ImuSample& sample) { impl_->imu.push_back(sample); }

std::vector<MapPoint> Odometry::GlobalMap() const {
  Impl& m = *impl_;
  return m.mapping_thread.Run([&m] { return m.mapper.GlobalMap(); }).get();
}

const Odometry::Timings& Odometry::timings() const { return impl_->timings; }

Odometry::Counters Odometry::counters() const { return {impl_->surfaces.counters(), impl_->mapping_counters}; }

}  // namespace devo
