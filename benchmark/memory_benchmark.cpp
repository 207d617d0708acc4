// SPDX-License-Identifier: BSD-3-Clause
//
// What the machine's memory allows, measured in the same run: the limit to read the other figures against.
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

namespace devo {
namespace {

/// Streams 128 MB to another 128 MB: the limit of whatever touches every pixel or event once.
void MemoryCopy(benchmark::State& state) {
  const std::size_t count = std::size_t{16} << 20;
  std::vector<double> from(count, 1.0), to(count, 0.0);
  for (auto _ : state) {
    std::memcpy(to.data(), from.data(), count * sizeof(double));
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
  // Read and written, as STREAM counts.
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * 2 * count * sizeof(double)));
}
BENCHMARK(MemoryCopy)->Unit(benchmark::kMillisecond);

/// One time stamp per event to a random pixel of a 640x480 image, events streamed from memory: the limit of
/// insertion (surfaces of last times need at least this).
void MemoryRandomWrite(benchmark::State& state) {
  struct Write {
    std::int64_t t;
    std::uint32_t pixel, unused;
  };
  std::mt19937 random(1);
  std::vector<Write> writes(std::size_t{4} << 20);
  for (std::size_t i = 0; i < writes.size(); ++i) {
    writes[i] = {static_cast<std::int64_t>(i), static_cast<std::uint32_t>(random() % (640 * 480)), 0};
  }
  std::vector<std::int64_t> last(640 * 480, 0);
  for (auto _ : state) {
    for (const Write& write : writes) last[write.pixel] = write.t;
    benchmark::DoNotOptimize(last.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations() * writes.size()));
}
BENCHMARK(MemoryRandomWrite)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace devo

BENCHMARK_MAIN();
