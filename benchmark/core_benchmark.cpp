// SPDX-License-Identifier: BSD-3-Clause
//
// The three modules, one thread each: insertion and surface, depth warp and mapping, alignment.
#include <algorithm>
#include <cstdint>
#include <vector>

#include <benchmark/benchmark.h>

#include "devo/core/alignment.h"
#include "devo/core/depth_registration.h"
#include "devo/core/local_map.h"
#include "devo/core/mapper.h"
#include "devo/core/nearest_edge_field.h"
#include "devo/core/noise_filter.h"
#include "devo/core/relocalizer.h"
#include "devo/core/surface_builder.h"
#include "moving_edges.h"
#include "simulated_table.h"

namespace devo {
namespace {

/// Resolutions of DAVIS240, DAVIS346, Gen3 and Gen4, each at the rate that a scene of one kind gives it.
void Resolutions(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"width", "height"})->Unit(benchmark::kMillisecond);
  benchmark->Args({240, 180})->Args({346, 260})->Args({640, 480})->Args({1280, 720});
}

double RateOf(const benchmark::State& state) {
  return 5e6 * static_cast<double>(state.range(0) * state.range(1)) / (640 * 480);
}

/// 0.1 s of events, in slices of one surface period.
std::vector<std::vector<Event>> Slices(MovingEdges* scene) {
  std::vector<std::vector<Event>> slices(10);
  for (std::vector<Event>& slice : slices) scene->Advance(0.01, &slice);
  return slices;
}

/// So that time goes on from round to round.
void Shift(std::vector<std::vector<Event>>* slices, std::int64_t by_ns) {
  for (std::vector<Event>& slice : *slices) {
    for (Event& event : slice) event.t_ns += by_ns;
  }
}

void Insert(benchmark::State& state) {
  MovingEdges scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), RateOf(state));
  std::vector<std::vector<Event>> slices = Slices(&scene);
  SurfaceBuilder builder(scene.camera(), SurfaceOptions());
  std::int64_t events = 0;
  for (auto _ : state) {
    for (const std::vector<Event>& slice : slices) {
      builder.Insert(slice);
      events += static_cast<std::int64_t>(slice.size());
    }
    state.PauseTiming();
    Shift(&slices, 100000000);
    state.ResumeTiming();
  }
  state.SetItemsProcessed(events);
}
BENCHMARK(Insert)->Apply(Resolutions);

void NoiseFilterPass(benchmark::State& state) {
  MovingEdges scene(640, 480, 5e6);
  std::vector<std::vector<Event>> slices = Slices(&scene);
  const SurfaceOptions options;
  NoiseFilter filter(640, 480, options.noise_window_s, options.noise_neighbours, options.hot_pixel_factor);
  std::int64_t events = 0;
  std::vector<std::uint32_t> passed;
  for (const std::vector<Event>& slice : slices) passed.resize(std::max(passed.size(), slice.size()));
  for (auto _ : state) {
    for (const std::vector<Event>& slice : slices) {
      benchmark::DoNotOptimize(filter.Pass(slice, passed.data()));
      events += static_cast<std::int64_t>(slice.size());
    }
    state.PauseTiming();
    Shift(&slices, 100000000);
    state.ResumeTiming();
  }
  state.SetItemsProcessed(events);
}
BENCHMARK(NoiseFilterPass)->Unit(benchmark::kMillisecond);

/// Insertion of one period's events is not counted; what is left is the surface from scratch to ready for tracking.
void RenderSurface(benchmark::State& state, const char* method, double delta = SurfaceOptions().delta) {
  MovingEdges scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), RateOf(state));
  SurfaceOptions options;
  options.method = method;
  options.delta = delta;
  SurfaceBuilder builder(scene.camera(), options);
  std::vector<Event> events;
  double edges = 0, used = 0;
  for (int i = 0; i < 10; ++i) scene.Advance(0.01, &events);
  builder.Insert(events);
  for (auto _ : state) {
    state.PauseTiming();
    events.clear();
    scene.Advance(0.01, &events);
    builder.Insert(events);
    state.ResumeTiming();
    const SurfacePtr surface = builder.Render(scene.t_ns(), scene.velocity_event(), scene.scene_depth());
    edges = static_cast<double>(surface->edges.size());
    used = surface->events_used;
  }
  state.counters["edges"] = edges;
  state.counters["events"] = used;
}
BENCHMARK_CAPTURE(RenderSurface, motion_compensated, "motion_compensated")->Apply(Resolutions);
BENCHMARK_CAPTURE(RenderSurface, exponential, "exponential")->Apply(Resolutions);
/// The image alone: no pixel is above the threshold of the semi-dense region.
BENCHMARK_CAPTURE(RenderSurface, exponential_alone, "exponential", 1.0)->Apply(Resolutions);

/// The same on edges as a room has them, with the sensor's noise: the first half second, over and over. The mean over
/// quiet and fast parts.
void RenderSimulatedTable(benchmark::State& state) {
  static const SimulatedTable table(0.5);
  std::vector<SimulatedTable::Period> periods = table.periods();
  const std::int64_t length_ns = periods.back().end_ns - periods.front().end_ns + 10'000'000;
  SurfaceBuilder builder(table.camera(), SurfaceOptions());
  double edges = 0, used = 0, in = 0;
  std::size_t next = 0;
  for (auto _ : state) {
    state.PauseTiming();
    SimulatedTable::Period& period = periods[next++ % periods.size()];
    builder.Insert(period.events);
    state.ResumeTiming();
    const SurfacePtr surface = builder.Render(period.end_ns, period.velocity_event, table.scene_depth());
    state.PauseTiming();
    edges += static_cast<double>(surface->edges.size());
    used += surface->events_used;
    in += static_cast<double>(period.events.size());
    for (Event& event : period.events) event.t_ns += length_ns;  // so that time goes on from round to round
    period.end_ns += length_ns;
    state.ResumeTiming();
  }
  state.counters["edges"] = benchmark::Counter(edges, benchmark::Counter::kAvgIterations);
  state.counters["events"] = benchmark::Counter(used, benchmark::Counter::kAvgIterations);
  state.counters["Mev_s"] = benchmark::Counter(1e-4 * in, benchmark::Counter::kAvgIterations);
}
BENCHMARK(RenderSimulatedTable)->Unit(benchmark::kMillisecond);

SurfacePtr SurfaceOf(MovingEdges* scene) {
  SurfaceBuilder builder(scene->camera(), SurfaceOptions());
  SurfacePtr surface;
  for (int i = 0; i < 10; ++i) {  // rates, which tell standstill, are known after some surfaces
    std::vector<Event> events;
    scene->Advance(0.01, &events);
    builder.Insert(events);
    surface = builder.Render(scene->t_ns(), scene->velocity_event(), scene->scene_depth());
  }
  return surface;
}

/// A depth image at the time that the surface's edges are at.
DepthImage DepthOf(const MovingEdges& scene, const Surface& surface) {
  DepthImage depth = scene.depth_image();
  depth.t_ns = surface.t_edges_ns;
  return depth;
}

void NearestEdgeField(benchmark::State& state) {
  MovingEdges scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), RateOf(state));
  const SurfacePtr surface = SurfaceOf(&scene);
  cv::Mat1i nearest(surface->height(), surface->width());
  for (auto _ : state) {
    BuildNearestEdgeField(surface->edges, SurfaceOptions().truncation_px, &nearest);
    benchmark::DoNotOptimize(nearest.data);
  }
  state.counters["edges"] = static_cast<double>(surface->edges.size());
}
BENCHMARK(NearestEdgeField)->Apply(Resolutions);

/// 640x576 depth image to the event image, edges listed.
void WarpDepth(benchmark::State& state) {
  MovingEdges scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), RateOf(state));
  const SurfacePtr surface = SurfaceOf(&scene);
  const Rig rig = scene.rig();
  DepthRegistration registration(scene.camera(), rig.depth_camera, MappingOptions());
  const DepthImage depth = scene.depth_image();
  for (auto _ : state) benchmark::DoNotOptimize(registration.Warp(depth, rig.T_event_depth, surface->edges));
}
BENCHMARK(WarpDepth)->Apply(Resolutions);

/// A depth image to a new local map: warp, depth of every edge, choice of points. Every image makes a reference.
void MakeLocalMap(benchmark::State& state) {
  MovingEdges scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), RateOf(state));
  const SurfacePtr surface = SurfaceOf(&scene);
  const DepthImage depth = DepthOf(scene, *surface);
  double points = 0;
  for (auto _ : state) {
    state.PauseTiming();
    Mapper mapper(scene.rig(), OdometryOptions());
    state.ResumeTiming();
    mapper.AddSurface(surface);
    mapper.AddDepth(depth);
    const LocalMapPtr map = mapper.Update();
    points = map ? static_cast<double>(map->points.size()) : 0;
  }
  if (points == 0) state.SkipWithError("no local map was made");
  state.counters["points"] = points;
}
BENCHMARK(MakeLocalMap)->Apply(Resolutions);

/// The map of one depth image at the surface's time; null, and the benchmark marked as failed, where none was made.
LocalMapPtr LocalMapOf(const MovingEdges& scene, const SurfacePtr& surface, const OdometryOptions& options,
                       benchmark::State* state) {
  Mapper mapper(scene.rig(), options);
  mapper.AddSurface(surface);
  mapper.AddDepth(DepthOf(scene, *surface));
  LocalMapPtr map = mapper.Update();
  if (!map) state->SkipWithError("no local map was made");
  return map;
}

/// From a start 1.5 px and 0.2 deg away, as a sudden change of motion leaves it, to convergence.
void AlignPoints(benchmark::State& state) {
  MovingEdges scene(640, 480, 5e6);
  const SurfacePtr surface = SurfaceOf(&scene);
  OdometryOptions options;
  options.mapping.max_points = static_cast<int>(state.range(0));
  const LocalMapPtr map = LocalMapOf(scene, surface, options, &state);
  if (!map) return;
  Vector6d start;
  start << 1.5 * MovingEdges::kDepth_m / scene.camera().fx(), 0, 0, 0, 0, 0.2 * M_PI / 180;
  PosePrior prior;
  prior.T_event_ref = Exp(start);
  AlignmentResult result;
  for (auto _ : state) {
    result = Align(map->points, *surface, scene.camera(), prior, scene.velocity_event(), OdometryOptions());
    benchmark::DoNotOptimize(result);
  }
  state.counters["points"] = static_cast<double>(map->points.size());
  state.counters["iterations"] = result.iterations;
  state.counters["error_mm"] = 1e3 * result.T_event_ref.translation().norm();
}
BENCHMARK(AlignPoints)
    ->ArgName("points")
    ->Arg(500)
    ->Arg(1000)
    ->Arg(2000)
    ->Arg(4000)
    ->Arg(8000)
    ->Unit(benchmark::kMillisecond);

/// What one surface pays while tracking is lost, in vain: no hypothesis is near.
void SearchWhenLost(benchmark::State& state) {
  MovingEdges scene(640, 480, 5e6);
  const SurfacePtr surface = SurfaceOf(&scene);
  const LocalMapPtr map = LocalMapOf(scene, surface, OdometryOptions(), &state);
  if (!map) return;
  Relocalizer relocalizer(scene.camera(), OdometryOptions());
  Vector6d off;
  off << 0.5, 0.3, 0, 0.3, -0.4, 0.5;
  const Relocalizer::Expectation where{{Exp(off), Exp(-off)}, Matrix6d::Identity(), 0};
  for (auto _ : state) benchmark::DoNotOptimize(relocalizer.Search(*surface, map, where, true, 0.9));
}
BENCHMARK(SearchWhenLost)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace devo
