// SPDX-License-Identifier: BSD-3-Clause
//
// The whole odometry: CPU time per second of data, all threads together.
#include <cstdint>
#include <ctime>
#include <vector>

#include <benchmark/benchmark.h>

#include "devo/core/odometry.h"
#include "moving_edges.h"

namespace devo {
namespace {

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// One second of data, depth at 30 Hz; making the data is not counted.
void OdometryPerSecond(benchmark::State& state) {
  constexpr double kSlice_s = 0.002;
  const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
  double poses = 0, error_percent = 0;
  for (auto _ : state) {
    MovingEdges scene(width, height, 1e6 * static_cast<double>(state.range(2)));
    Odometry odometry(scene.rig(), OdometryOptions());
    Rigid3 T_world_event;
    std::int64_t t_first_ns = -1, t_last_ns = 0;
    double first_x_m = 0;
    odometry.on_pose = [&](const PoseEstimate& pose, const Surface&) {
      if (t_first_ns < 0) {
        t_first_ns = pose.t_ns;
        first_x_m = pose.T_world_event.translation().x();
      }
      T_world_event = pose.T_world_event;
      t_last_ns = pose.t_ns;
      ++poses;
    };
    poses = 0;
    double cpu_s = 0, next_depth_s = 0.05;
    std::vector<Event> events;
    for (int slice = 0; slice < static_cast<int>(1 / kSlice_s); ++slice) {
      events.clear();
      scene.Advance(kSlice_s, &events);
      const bool depth_due = 1e-9 * static_cast<double>(scene.t_ns()) >= next_depth_s;
      const DepthImage depth = depth_due ? scene.depth_image() : DepthImage();
      if (depth_due) next_depth_s += 1.0 / 30;
      const double start_s = CpuSeconds();
      if (depth_due) odometry.AddDepth(depth);
      odometry.AddEvents(events);
      cpu_s += CpuSeconds() - start_s;
    }
    state.SetIterationTime(cpu_s);
    const double truth_m = scene.velocity_event()[0] * 1e-9 * static_cast<double>(t_last_ns - t_first_ns);
    error_percent = 100 * (T_world_event.translation().x() - first_x_m - truth_m) / truth_m;
  }
  // Cost means nothing when the odometry has lost its way.
  state.counters["poses"] = poses;
  state.counters["error_percent"] = error_percent;
}
BENCHMARK(OdometryPerSecond)
    ->ArgNames({"width", "height", "Mev_s"})
    ->Args({640, 480, 1})
    ->Args({640, 480, 5})
    ->Args({640, 480, 10})
    ->Args({640, 480, 30})
    ->Args({240, 180, 1})
    ->Args({346, 260, 1})
    ->Args({1280, 720, 5})
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace devo
