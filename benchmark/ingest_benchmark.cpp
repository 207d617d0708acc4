// SPDX-License-Identifier: BSD-3-Clause
//
// From the bytes of a message to decoded events, and on into the surface's buffers.
#include <cstdint>
#include <vector>

#include <benchmark/benchmark.h>
#include <ros/serialization.h>

#include "devo/core/surface_builder.h"
#include "devo/io/evt_decoder.h"
#include "devo/ros/message_conversion.h"
#include "moving_edges.h"

namespace devo {
namespace {

constexpr double kRate_hz = 10e6;

std::vector<std::uint8_t> SerializedEventArray(MovingEdges* scene) {
  std::vector<Event> events;
  scene->Advance(0.01, &events);
  const EventArray message = ToEventArrayMsg(events, 640, 480, "event_camera");
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

void DecodeEventArray(benchmark::State& state) {
  MovingEdges scene(640, 480, kRate_hz);
  const std::vector<std::uint8_t> bytes = SerializedEventArray(&scene);
  std::vector<Event> events;
  std::int64_t count = 0;
  for (auto _ : state) {
    events.clear();
    AppendSerializedEvents(bytes.data(), bytes.size(), &events);
    benchmark::DoNotOptimize(events.data());
    count += static_cast<std::int64_t>(events.size());
  }
  state.SetItemsProcessed(count);
}
BENCHMARK(DecodeEventArray)->Unit(benchmark::kMillisecond);

/// The same with what follows at 100 surfaces per second: insertion, noise filter, surface, crests and field.
void EventArrayToSurface(benchmark::State& state) {
  MovingEdges scene(640, 480, kRate_hz);
  std::vector<std::vector<std::uint8_t>> messages(20);
  for (std::vector<std::uint8_t>& message : messages) message = SerializedEventArray(&scene);
  std::vector<Event> events;
  std::int64_t count = 0;
  for (auto _ : state) {
    state.PauseTiming();
    SurfaceBuilder builder(scene.camera(), SurfaceOptions());
    state.ResumeTiming();
    for (const std::vector<std::uint8_t>& bytes : messages) {
      events.clear();
      AppendSerializedEvents(bytes.data(), bytes.size(), &events);
      builder.Insert(events);
      benchmark::DoNotOptimize(
          builder.Render(events.back().t_ns + 1, scene.velocity_event(), scene.scene_depth()).get());
      count += static_cast<std::int64_t>(events.size());
    }
  }
  state.SetItemsProcessed(count);
}
BENCHMARK(EventArrayToSurface)->Unit(benchmark::kMillisecond);

/// EVT 3.0 words (Prophesee, "Data encoding formats") as a sensor would send them: time, row, single events.
std::vector<std::uint8_t> Evt3Words(MovingEdges* scene) {
  std::vector<Event> events;
  scene->Advance(0.01, &events);
  std::vector<std::uint8_t> bytes;
  const auto put = [&bytes](unsigned type, unsigned value) {
    const unsigned word = (type << 12) | (value & 0xfff);
    bytes.push_back(static_cast<std::uint8_t>(word & 0xff));
    bytes.push_back(static_cast<std::uint8_t>(word >> 8));
  };
  unsigned low = ~0U, high = ~0U, row = ~0U;
  for (const Event& event : events) {
    const auto t_us = static_cast<std::uint64_t>(event.t_ns / 1000);
    const auto event_high = static_cast<unsigned>((t_us >> 12) & 0xfff),
               event_low = static_cast<unsigned>(t_us & 0xfff);
    if (event_high != high) put(0x8, high = event_high);
    if (event_low != low) put(0x6, low = event_low);
    if (event.y != row) put(0x0, row = event.y);
    put(0x2, event.x | (static_cast<unsigned>(event.polarity) << 11));
  }
  return bytes;
}

void DecodeEvt3(benchmark::State& state) {
  MovingEdges scene(640, 480, kRate_hz);
  const std::vector<std::uint8_t> bytes = Evt3Words(&scene);
  std::vector<Event> events;
  std::int64_t count = 0;
  for (auto _ : state) {
    events.clear();
    EvtDecoder decoder("evt3");
    decoder.Decode(bytes.data(), bytes.size(), &events);
    benchmark::DoNotOptimize(events.data());
    count += static_cast<std::int64_t>(events.size());
  }
  state.SetItemsProcessed(count);
}
BENCHMARK(DecodeEvt3)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace devo
