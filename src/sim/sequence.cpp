// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/sequence.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <mutex>
#include <stdexcept>

#include "devo/core/time.h"
#include "devo/sim/event_sensor.h"
#include "devo/sim/frame_sensor.h"
#include "devo/sim/ray_tracer.h"
#include "devo/sim/thread_pool.h"

namespace devo::sim {
namespace {

constexpr std::int64_t kTick_ns = 1000;
constexpr double kLongestStep_s = 0.005;
constexpr double kShortestStep_s = 20e-6;
constexpr double kLongestOfFlicker = 0.05;  // periods of light that flickers: a step's parabola follows it to 1e-4
constexpr double kRamp_s = 0.4;             // to reach full speed, and to stop
constexpr int kSubSteps = 16;               // finest grid of EventPixels' probes: four halvings

void Expect(bool condition, const std::string& what) {
  if (!condition) throw std::invalid_argument(what);
}

void Validate(const SequenceOptions& o) {
  const auto text = [](double v) { return std::to_string(v); };
  Expect(o.duration_s > 0, "duration = " + text(o.duration_s) + "; expected > 0 s");
  Expect(o.depth_rate_hz > 0 && o.depth_rate_hz <= 60, "depth rate = " + text(o.depth_rate_hz) + "; expected 0..60 Hz");
  Expect(o.frame_rate_hz > 0 && o.frame_rate_hz <= 40, "frame rate = " + text(o.frame_rate_hz) + "; expected 0..40 Hz");
  Expect(o.pose_rate_hz > 0 && o.pose_rate_hz <= 1000, "pose rate = " + text(o.pose_rate_hz) + "; expected 0..1000 Hz");
  Expect(o.max_flow_px > 0 && o.max_flow_px <= 1, "max_flow_px = " + text(o.max_flow_px) + "; expected 0..1 px");
  Expect(o.flicker >= 0 && o.flicker < 1, "flicker = " + text(o.flicker) + "; expected 0..1, below 1");
  Expect(o.flicker_hz >= 10 && o.flicker_hz <= 1000, "flicker_hz = " + text(o.flicker_hz) + "; expected 10..1000 Hz");
  Expect(o.accuracy.contrast > 0 && o.accuracy.straightness > 0, "accuracy; expected contrast and straightness > 0");
  Expect(o.chunk_s >= 1e-4 && o.chunk_s <= 1, "chunk = " + text(o.chunk_s) + "; expected 0.0001..1 s");
  Expect(o.rest_s >= 0, "rest = " + text(o.rest_s) + "; expected >= 0 s");
  Expect(std::isfinite(o.duration_s) && std::isfinite(o.rest_s), "duration and rest; expected finite numbers");
  Expect(o.lidar_rate_hz >= 1 && o.lidar_rate_hz <= 30,
         "LiDAR rate = " + text(o.lidar_rate_hz) + "; expected 1..30 Hz");
  Expect(std::abs(o.depth_time_offset_s) <= 10,
         "depth offset = " + text(o.depth_time_offset_s) + "; expected -10..10 s");
  Expect(o.multipath >= 0 && o.multipath <= 10, "multipath = " + text(o.multipath) + "; expected 0..10");
  for (const Stop& stop : o.stops) {
    Expect(std::isfinite(stop.begin_s) && stop.duration_s >= 0 && std::isfinite(stop.duration_s),
           "stop at " + text(stop.begin_s) + " s for " + text(stop.duration_s) +
               " s; expected finite numbers, not less "
               "than 0 s");
  }
  Expect(!o.closed || o.trajectory_file.empty(), "closed motion is random; expected no trajectory file with it");
  Expect(!o.closed || o.stops.empty(), "closed motion stops at its end only; expected no other stops");
  Expect(!o.closed || o.duration_s >= o.rest_s + 3 * kRamp_s,
         "duration = " + text(o.duration_s) + " of a closed motion; expected at least " + text(o.rest_s + 3 * kRamp_s) +
             " s, to start and stop in");
  Expect(o.start_s > 0, "start = " + text(o.start_s) + "; expected > 0 s");
}

Scene BuildScene(const SequenceOptions& o) {
  const bool is_file = o.scene.size() > 5 && o.scene.substr(o.scene.size() - 5) == ".yaml";
  Scene scene = is_file ? LoadScene(o.scene) : MakeScene(o.scene);
  Illuminate(MakeLight(o.light), &scene);
  return scene;
}

Trajectory BuildTrajectory(const SequenceOptions& o, const Scene& scene) {
  if (o.closed) {
    const bool rests = o.rest_s > 0;  // without, it passes its begin at full speed
    // Each of the two ramps covers half of what full speed would.
    const double at_speed_s = rests ? o.duration_s - o.rest_s - kRamp_s : o.duration_s;
    Trajectory loop = ClosedTrajectory(scene.motion, LimitsOf(o.speed), at_speed_s, o.seed);
    if (rests) loop.SetPauses(o.rest_s, {{o.duration_s, 0}}, kRamp_s);
    return loop.MovedTo(o.T_motion_event);
  }
  Trajectory t = o.trajectory_file.empty() ? RandomTrajectory(scene.motion, LimitsOf(o.speed), o.duration_s, o.seed)
                                           : TrajectoryFromTum(o.trajectory_file);
  t.SetPauses(o.rest_s, o.stops, kRamp_s);
  return t.MovedTo(o.T_motion_event);
}

std::uint64_t NoiseSeed(const SequenceOptions& o) { return o.noise_seed != 0 ? o.noise_seed : o.seed; }

EventSensor BuildSensor(const SequenceOptions& o) {
  EventSensor sensor = MakeEventSensor(o.sensor);
  if (o.ideal_pixels) sensor.pixel = IdealPixel(sensor.pixel.threshold_on);
  return sensor;
}

DepthModel BuildDepth(const SequenceOptions& o, const EventSensor& sensor) {
  DepthModel m = AzureKinect();
  if (o.depth == SequenceOptions::Depth::kRegistered || o.depth == SequenceOptions::Depth::kNone)
    m = RegisteredDepth(sensor.camera);
  m.exact = o.depth != SequenceOptions::Depth::kKinect;
  m.rate_hz = o.depth_rate_hz;
  m.time_offset_s = o.depth_time_offset_s;
  m.multipath = o.multipath;
  return m;
}

LidarModel BuildLidar(const SequenceOptions& o) {
  LidarModel model;
  model.rate_hz = o.lidar_rate_hz;
  return model;
}

ImuModel BuildImu(const SequenceOptions& o) {
  ImuModel model;
  model.T_event_imu = o.T_event_imu;
  return model;
}

/// From a point, to a surface where it stands at rest. Not more than it is; exact for rectangles.
double DistanceTo(const Surface& s, const Eigen::Vector3d& p) {
  const Eigen::Vector3d d = p - s.origin;
  if (s.kind == SurfaceKind::kDisc) return d.norm() - s.size_u;
  const double along = std::clamp(d.dot(s.kind == SurfaceKind::kCylinder ? s.n : s.v), 0.0, s.size_v);
  if (s.kind == SurfaceKind::kCylinder) return (d - along * s.n).norm() - s.size_u;
  return (d - along * s.v - std::clamp(d.dot(s.u), 0.0, s.size_u) * s.u).norm();
}

double Seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

}  // namespace

struct Sequence::Impl {
  explicit Impl(const SequenceOptions& options_in)
      : options((Validate(options_in), options_in)), scene(BuildScene(options)),
        trajectory(BuildTrajectory(options, scene)), sensor(BuildSensor(options)), pool(options.threads),
        rays(sensor.camera), pixels(sensor, rays.stride(), NoiseSeed(options)), readout(sensor.pixel),
        depth_sensor(scene, BuildDepth(options, sensor), NoiseSeed(options)),
        lidar(scene, BuildLidar(options), NoiseSeed(options)), imu(BuildImu(options), NoiseSeed(options)),
        frame_sensor(MakeLight(options.light), rays.stride(), sensor.camera, NoiseSeed(options)),
        regular_camera(scene, VectorRegularCamera(), MakeLight(options.light), NoiseSeed(options)),
        event_frames(options.frames && !options.regular_camera) {
    begin_ns = NsFromSeconds(options.start_s) / kTick_ns * kTick_ns;
    end_ns = begin_ns + NsFromSeconds(options.duration_s) / kTick_ns * kTick_ns;
    now_ns = begin_ns;
    luminance.assign(static_cast<std::size_t>(rays.stride()) * rays.height(), 0);
    nearest.assign(static_cast<std::size_t>(rays.tile_rows()) * rays.tile_columns(), 1);
    rig.event_camera = sensor.camera;
    rig.depth_camera = depth_sensor.model().camera;
    rig.T_event_depth = depth_sensor.model().T_event_depth;
    rig.depth_registered = options.depth == SequenceOptions::Depth::kRegistered;
    if (event_frames) frame_sensor.Start(begin_ns + 5000000, options.frame_rate_hz);
    RenderFirst();
  }

  SequenceOptions options;
  Scene scene;
  Trajectory trajectory;
  EventSensor sensor;
  ThreadPool pool;
  RayGrid rays;
  EventPixels pixels;
  Readout readout;
  DepthSensor depth_sensor;
  Lidar lidar;
  ImuSensor imu;
  FrameSensor frame_sensor;
  RegularCamera regular_camera;
  bool event_frames;
  Rig rig;
  SequenceStatistics statistics;

  std::int64_t begin_ns = 0, end_ns = 0, now_ns = 0;
  std::uint64_t depth_count = 0, scan_count = 0, imu_count = 0, pose_count = 0, frame_count = 0;
  std::vector<float> luminance, nearest;
  std::vector<Event> left_chip;  // events that left the readout, in order

  std::mutex renderers_mutex;
  std::vector<std::unique_ptr<BandRenderer>> renderers;

  double TimeOf(std::int64_t t_ns) const { return SecondsFromNs(t_ns - begin_ns); }
  std::int64_t StampOf(double t_s) const { return begin_ns + NsFromSeconds(t_s); }

  /// How many times its mean the light is.
  float BrightnessAt(double t_s) const {
    if (options.flicker == 0) return 1;  // asked for each probe
    return static_cast<float>(1 + options.flicker * std::sin(2 * M_PI * options.flicker_hz * t_s));
  }

  double LongestStep_s() const {
    return options.flicker > 0 ? std::min(kLongestStep_s, kLongestOfFlicker / options.flicker_hz) : kLongestStep_s;
  }

  /// A renderer of nobody else's for the time of one call.
  template <typename Use>
  void WithRenderer(Use&& use) {
    std::unique_ptr<BandRenderer> renderer;
    {
      const std::lock_guard<std::mutex> lock(renderers_mutex);
      if (!renderers.empty()) {
        renderer = std::move(renderers.back());
        renderers.pop_back();
      }
    }
    if (!renderer) renderer = std::make_unique<BandRenderer>(scene, rays);
    use(renderer.get());
    const std::lock_guard<std::mutex> lock(renderers_mutex);
    renderers.push_back(std::move(renderer));
  }

  void RenderFirst() {
    const View view(scene, trajectory.PoseAt(0));
    pool.ForEach(rays.tile_rows(), [&](int band) {
      WithRenderer([&](BandRenderer* renderer) {
        const int first = band * RayGrid::kTile, last = std::min(first + RayGrid::kTile, rays.height());
        renderer->Render(view, band, &luminance[static_cast<std::size_t>(first) * rays.stride()],
                         &nearest[static_cast<std::size_t>(band) * rays.tile_columns()]);
        for (int row = first; row < last; ++row)
          pixels.StartRow(row, now_ns, &luminance[static_cast<std::size_t>(row) * rays.stride()]);
      });
    });
  }

  /// Fastest image motion anywhere, px/s, from the nearest surface of each tile of the last rendering.
  double FastestFlow(const Vector6d& twist) const {
    double fastest = 0;
    for (int i = 0; i < rays.tile_rows() * rays.tile_columns(); ++i) {
      const auto& tile = rays.tile(i / rays.tile_columns(), i % rays.tile_columns());
      const double x = tile.centre[0] / tile.centre[2], y = tile.centre[1] / tile.centre[2];
      const Eigen::Vector2d turning(x * y * twist[3] - (1 + x * x) * twist[4] + y * twist[5],
                                    (1 + y * y) * twist[3] - x * y * twist[4] - x * twist[5]);
      const Eigen::Vector2d moving = Eigen::Vector2d(x * twist[2] - twist[0], y * twist[2] - twist[1]) /
                                     std::max(0.05, static_cast<double>(nearest[i]));
      fastest = std::max({fastest, turning.squaredNorm(), (turning + moving).squaredNorm()});
    }
    return std::sqrt(fastest) / rays.pixel_angle();
  }

  /// What things that move by themselves may add to that.
  double FastestSway(double t_s) const {
    const Eigen::Vector3d camera = trajectory.PoseAt(t_s).translation();
    double fastest = 0;
    for (const Surface& s : scene.surfaces()) {
      if (!s.sway) continue;
      const double nearest_m = DistanceTo(s, camera - s.sway->OffsetAt(t_s));
      fastest = std::max(fastest, s.sway->SpeedAt(t_s) / std::max(0.1, nearest_m));
    }
    return fastest / rays.pixel_angle();
  }

  void Step(std::int64_t t1_ns);
  void Advance(std::int64_t chunk_end_ns);
  void Measure(Chunk* chunk);
};

void Sequence::Impl::Step(std::int64_t t1_ns) {
  const std::int64_t t0_ns = now_ns;
  const View view(scene, trajectory.PoseAt(TimeOf(t1_ns)), TimeOf(t1_ns));
  std::array<std::once_flag, kSubSteps> made;
  std::array<std::unique_ptr<View>, kSubSteps> between;
  const auto view_between = [&](double share) -> const View& {
    const int k = static_cast<int>(share * kSubSteps);
    std::call_once(made[k], [&] {
      const double t = TimeOf(t0_ns) + share * SecondsFromNs(t1_ns - t0_ns);
      between[k] = std::make_unique<View>(scene, trajectory.PoseAt(t), t);
    });
    return *between[k];
  };
  const float exposed_s = frame_sensor.ExposedShare(t0_ns, t1_ns) * static_cast<float>(SecondsFromNs(t1_ns - t0_ns));
  const float brightness = BrightnessAt(TimeOf(t1_ns));
  std::vector<std::vector<Event>> events(rays.tile_rows());
  pool.ForEach(rays.tile_rows(), [&](int band) {
    WithRenderer([&](BandRenderer* renderer) {
      const int first = band * RayGrid::kTile, last = std::min(first + RayGrid::kTile, rays.height());
      thread_local std::vector<float> next;
      next.assign(static_cast<std::size_t>(RayGrid::kTile) * rays.stride(), 0);
      renderer->Render(view, band, next.data(), &nearest[static_cast<std::size_t>(band) * rays.tile_columns()]);
      if (options.flicker > 0) {
        for (float& light : next) light *= brightness;
      }
      for (int row = first; row < last; ++row) {
        float* old_row = &luminance[static_cast<std::size_t>(row) * rays.stride()];
        const float* new_row = &next[static_cast<std::size_t>(row - first) * rays.stride()];
        const EventPixels::Probe probe = [&](double share, int column) {
          return BrightnessAt(TimeOf(t0_ns) + share * SecondsFromNs(t1_ns - t0_ns)) *
                 renderer->LuminanceOf(view_between(share), row, column);
        };
        pixels.AdvanceRow(row, t0_ns, t1_ns, new_row, options.accuracy, probe, &events[band]);
        if (exposed_s > 0) frame_sensor.ExposeRow(row, exposed_s, old_row, new_row);
        std::copy(new_row, new_row + rays.stride(), old_row);
      }
    });
  });
  std::vector<Event> all;
  for (const auto& e : events) all.insert(all.end(), e.begin(), e.end());
  readout.Pass(&all, &left_chip);
  now_ns = t1_ns;
  ++statistics.renderings;
}

void Sequence::Impl::Advance(std::int64_t chunk_end_ns) {
  const auto started = std::chrono::steady_clock::now();
  const std::int64_t block_begin_ns = now_ns;
  pool.ForEach(rays.height(), [&](int row) { pixels.BeginNoiseBlock(row, block_begin_ns, chunk_end_ns); });
  while (now_ns < chunk_end_ns) {
    const double t = TimeOf(now_ns);
    const double ahead_s = t + 5e-4;
    const Vector6d twist = trajectory.VelocityAt(ahead_s);
    const double flow = FastestFlow(twist) + FastestSway(ahead_s);
    const double dt = std::clamp(options.max_flow_px / std::max(flow, 1e-6), kShortestStep_s, LongestStep_s());
    std::int64_t next_ns = std::min(chunk_end_ns, now_ns + NsFromSeconds(dt) / kTick_ns * kTick_ns);
    // A remainder of a few microseconds is not worth a rendering of its own.
    const std::int64_t left_ns = chunk_end_ns - now_ns;
    if (next_ns < chunk_end_ns && left_ns < 2 * (next_ns - now_ns))
      next_ns = now_ns + (left_ns / 2 + kTick_ns - 1) / kTick_ns * kTick_ns;
    if (event_frames) next_ns = frame_sensor.BoundStep(now_ns, next_ns);
    statistics.path_m += twist.head<3>().norm() * SecondsFromNs(next_ns - now_ns);
    statistics.max_speed_m_s = std::max(statistics.max_speed_m_s, twist.head<3>().norm());
    statistics.max_rate_rad_s = std::max(statistics.max_rate_rad_s, twist.tail<3>().norm());
    Step(next_ns);
  }
  statistics.render_s += Seconds(started);
}

void Sequence::Impl::Measure(Chunk* chunk) {
  const double until_s = TimeOf(chunk->end_ns);
  const auto started = std::chrono::steady_clock::now();
  const DepthModel& depth = depth_sensor.model();
  while (options.depth != SequenceOptions::Depth::kNone) {
    // The first image is taken shortly after the begin; stamps, not captures, decide which chunk an image is in.
    const double capture_s = 0.02 + static_cast<double>(depth_count) / depth.rate_hz;
    if (capture_s + depth.time_offset_s > until_s) break;
    const double stamp_s = capture_s + depth.time_offset_s;
    if (stamp_s > 0)
      chunk->depth.push_back({StampOf(stamp_s), depth_sensor.Capture(trajectory, capture_s, depth_count, &pool)});
    ++depth_count;
  }
  while (options.frames && options.regular_camera) {
    const double t = 0.005 + static_cast<double>(frame_count) / regular_camera.model().rate_hz;
    if (t + regular_camera.exposure_s() > until_s) break;
    chunk->frames.push_back(regular_camera.Capture(trajectory, t, StampOf(t), &pool));
    ++frame_count;
  }
  while (options.lidar) {
    const double t = 0.01 + static_cast<double>(scan_count) / lidar.model().rate_hz;
    if (t > until_s) break;
    chunk->scans.push_back(lidar.Capture(trajectory, t, scan_count, &pool));
    chunk->scans.back().t_ns = StampOf(t);
    ++scan_count;
  }
  statistics.depth_s += Seconds(started);
  while (options.imu) {
    const double t = static_cast<double>(imu_count + 1) / imu.model().rate_hz;
    if (t > until_s) break;
    chunk->imu.push_back(imu.Measure(trajectory, t));
    chunk->imu.back().t_ns = StampOf(t);
    ++imu_count;
  }
  for (;; ++pose_count) {
    const double t = static_cast<double>(pose_count + 1) / options.pose_rate_hz;
    if (t > until_s) break;
    chunk->poses.push_back({StampOf(t), trajectory.PoseAt(t)});
  }
}

Sequence::Sequence(const SequenceOptions& options) : impl_(new Impl(options)) {}
Sequence::~Sequence() = default;

bool Sequence::Next(Chunk* chunk) {
  Impl& s = *impl_;
  if (s.now_ns >= s.end_ns) return false;
  chunk->begin_ns = s.now_ns;
  chunk->end_ns = std::min(s.end_ns, s.now_ns + NsFromSeconds(s.options.chunk_s) / kTick_ns * kTick_ns);
  chunk->events.clear();
  chunk->depth.clear();
  chunk->scans.clear();
  chunk->frames.clear();
  chunk->imu.clear();
  chunk->poses.clear();
  s.Advance(chunk->end_ns);
  if (s.event_frames) s.frame_sensor.TakeFinished(chunk->end_ns, &chunk->frames);
  s.Measure(chunk);
  const auto split =
      std::find_if(s.left_chip.begin(), s.left_chip.end(), [&](const Event& e) { return e.t_ns > chunk->end_ns; });
  chunk->events.assign(s.left_chip.begin(), split);
  s.left_chip.erase(s.left_chip.begin(), split);
  s.statistics.events += chunk->events.size();
  s.statistics.events_lost_in_readout = s.readout.lost();
  return true;
}

const SequenceOptions& Sequence::options() const { return impl_->options; }
const Rig& Sequence::rig() const { return impl_->rig; }
const EventSensor& Sequence::sensor() const { return impl_->sensor; }
const DepthModel& Sequence::depth_model() const { return impl_->depth_sensor.model(); }
const LidarModel& Sequence::lidar_model() const { return impl_->lidar.model(); }
const RegularCameraModel& Sequence::regular_camera_model() const { return impl_->regular_camera.model(); }
const Trajectory& Sequence::trajectory() const { return impl_->trajectory; }
const SequenceStatistics& Sequence::statistics() const { return impl_->statistics; }
std::int64_t Sequence::begin_ns() const { return impl_->begin_ns; }
std::int64_t Sequence::end_ns() const { return impl_->end_ns; }

}  // namespace devo::sim
