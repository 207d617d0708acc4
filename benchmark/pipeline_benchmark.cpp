// SPDX-License-Identifier: BSD-3-Clause
//
// The whole odometry per second of data: CPU time of all threads together, and how many times real time it runs.
#include <chrono>
#include <cstdint>
#include <ctime>
#include <vector>

#include <benchmark/benchmark.h>

#include "devo/core/odometry.h"
#include "moving_edges.h"

namespace devo {
namespace {

constexpr double kSlice_s = 0.002, kStart_s = 0.5;
constexpr int kSlicesOfStart = 250, kSlicesMeasured = 500;

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

double WallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Follows the poses and compares their way with the scene's.
struct Judge {
  explicit Judge(const MovingEdges* scene_in) : scene(scene_in) {}
  void Take(const PoseEstimate& pose) {
    const double x_m = pose.T_world_event.translation().x(), truth_m = scene->WayAt_m(pose.t_ns);
    if (poses++ == 0) {
      first_x_m = x_m;
      first_truth_m = truth_m;
    }
    way_m = x_m - first_x_m;
    truth_way_m = truth_m - first_truth_m;
  }
  const MovingEdges* scene;
  double first_x_m = 0, first_truth_m = 0, way_m = 0, truth_way_m = 0, poses = 0;
};

/// The camera starts from rest, as any does, and what is measured is the second after it reached its speed. Events are
/// made before, in slices of 2 ms, as a driver sends them; depth comes at 30 Hz.
void OdometryPerSecond(benchmark::State& state) {
  const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
  const int threads = static_cast<int>(state.range(3));
  double cpu_s = 0, wall_s = 0, poses = 0, error_percent = 0;
  for (auto _ : state) {
    MovingEdges scene(width, height, 1e6 * static_cast<double>(state.range(2)), kStart_s);
    std::vector<std::vector<Event>> slices(kSlicesOfStart + kSlicesMeasured);
    for (std::vector<Event>& slice : slices) scene.Advance(kSlice_s, &slice);
    DepthImage depth = scene.depth_image();
    Judge judge(&scene);
    Odometry odometry(scene.rig(), OdometryOptions(), threads);
    odometry.on_pose = [&](const PoseEstimate& pose, const Surface&) { judge.Take(pose); };
    double next_depth_s = 0.05;
    for (int i = 0; i < static_cast<int>(slices.size()); ++i) {
      if (i == kSlicesOfStart) {
        odometry.Finish();
        cpu_s = CpuSeconds();
        wall_s = WallSeconds();
      }
      if (kSlice_s * i >= next_depth_s) {
        depth.t_ns = static_cast<std::int64_t>(1e9 * next_depth_s);
        odometry.AddDepth(depth);
        next_depth_s += 1.0 / 30;
      }
      odometry.AddEvents(slices[static_cast<std::size_t>(i)]);
    }
    odometry.Finish();
    cpu_s = CpuSeconds() - cpu_s;
    wall_s = WallSeconds() - wall_s;
    poses = judge.poses;
    error_percent = 100 * (judge.way_m - judge.truth_way_m) / judge.truth_way_m;
    state.SetIterationTime(cpu_s);
  }
  state.counters["times_real_time"] = 1 / wall_s;
  // Cost means nothing when the odometry has lost its way.
  state.counters["poses"] = poses;
  state.counters["error_percent"] = error_percent;
}
BENCHMARK(OdometryPerSecond)
    ->ArgNames({"width", "height", "Mev_s", "threads"})
    ->Args({640, 480, 1, 1})
    ->Args({640, 480, 5, 1})
    ->Args({640, 480, 5, 2})
    ->Args({640, 480, 10, 1})
    ->Args({640, 480, 30, 1})
    ->Args({240, 180, 1, 1})
    ->Args({240, 180, 5, 1})
    ->Args({346, 260, 1, 1})
    ->Args({346, 260, 5, 1})
    ->Args({1280, 720, 1, 1})
    ->Args({1280, 720, 5, 1})
    ->Args({1280, 720, 30, 1})
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace devo
