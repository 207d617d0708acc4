// SPDX-License-Identifier: BSD-3-Clause
//
// Counts what is asked of the allocator: every new of this program, and every cv::Mat.
#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "devo/core/surface_builder.h"

namespace {

std::atomic<int> allocations{0};

void* Allocate(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}

}  // namespace

void* operator new(std::size_t size) { return Allocate(size); }
void* operator new[](std::size_t size) { return Allocate(size); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

namespace devo {
namespace {

class CountingMatAllocator : public cv::MatAllocator {
 public:
  cv::UMatData* allocate(int dims, const int* sizes, int type, void* data, size_t* step, cv::AccessFlag flags,
                         cv::UMatUsageFlags usage) const override {
    ++allocations;
    return cv::Mat::getStdAllocator()->allocate(dims, sizes, type, data, step, flags, usage);
  }
  bool allocate(cv::UMatData* data, cv::AccessFlag access, cv::UMatUsageFlags usage) const override {
    return cv::Mat::getStdAllocator()->allocate(data, access, usage);
  }
  void deallocate(cv::UMatData* data) const override { cv::Mat::getStdAllocator()->deallocate(data); }
};

/// A period's events: a thin bar that goes to and fro, with noise.
std::vector<Event> Period(int k) {
  std::mt19937 random(k);
  std::vector<Event> events(6000);
  for (std::size_t i = 0; i < events.size(); ++i) {
    const bool noise = random() % 10 == 0;
    const int bar = 50 + std::abs(k % 100 - 50) + static_cast<int>(random() % 2);
    events[i].t_ns = k * std::int64_t{10'000'000} + static_cast<std::int64_t>(i) * 1600;
    events[i].x = static_cast<std::uint16_t>(noise ? random() % 240 : bar);
    events[i].y = static_cast<std::uint16_t>(random() % 180);
    events[i].polarity = random() % 2;
  }
  return events;
}

TEST(SurfaceBuilder, AllocatesNothingForEventsOrSurfacesOnceItHasRenderedForAWhile) {
  CountingMatAllocator mat_allocator;
  cv::MatAllocator* const before = cv::Mat::getDefaultAllocator();
  for (const std::string method : {"motion_compensated", "exponential"}) {
    cv::Mat::setDefaultAllocator(&mat_allocator);
    SurfaceOptions options;
    options.method = method;
    SurfaceBuilder builder({240, 180, 200, 200, 119.5, 89.5, "none", {}}, options);
    SurfacePtr held;  // as a mapper holds them: another one is rendered meanwhile
    int later = 0;
    for (int k = 0; k < 300; ++k) {
      const std::vector<Event> events = Period(k);
      const int counted = allocations;
      builder.Insert(events);
      held = builder.Render((k + 1) * std::int64_t{10'000'000}, Vector6d::Zero(), {});
      if (k < 200) continue;
      later += allocations - counted;
      ASSERT_FALSE(held->edges.empty()) << method;
    }
    cv::Mat::setDefaultAllocator(before);
    EXPECT_EQ(later, 0) << method;
  }
}

TEST(SurfaceBuilder, IsWatchedByACounterThatCounts) {
  const int counted = allocations;
  const std::vector<int> memory(100);
  EXPECT_GT(allocations, counted) << memory.size();
}

}  // namespace
}  // namespace devo
