// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/surface_pool.h"

#include <deque>
#include <memory>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace devo {
namespace {

/// Takes a surface and gives it buffers of the usual size where it has none.
std::shared_ptr<Surface> TakeRendered(SurfacePool* pool, int value) {
  auto surface = pool->Take();
  surface->image.create(60, 80);
  surface->image.setTo(value);
  surface->nearest_edge.create(60, 80);
  surface->edges.resize(500);
  return surface;
}

TEST(SurfacePool, GivesTheBuffersOfAReturnedSurfaceToTheNext) {
  SurfacePool pool;
  auto surface = TakeRendered(&pool, 1);
  const void *image = surface->image.data, *field = surface->nearest_edge.data, *edges = surface->edges.data();
  surface.reset();
  surface = pool.Take();
  EXPECT_EQ(surface->image.data, image);
  EXPECT_EQ(surface->nearest_edge.data, field);
  EXPECT_TRUE(surface->edges.empty());
  surface->edges.resize(500);
  EXPECT_EQ(surface->edges.data(), edges);
}

TEST(SurfacePool, GivesSurfacesWithTheFieldsOfANewOne) {
  SurfacePool pool;
  auto used = TakeRendered(&pool, 1);
  used->t_ns = used->t_edges_ns = 7;
  used->epoch = 2;
  used->event_rate_hz = used->activity_hz = used->window_s = 3;
  used->events_used = 9;
  used->still = true;
  used.reset();
  const auto surface = pool.Take();
  ASSERT_FALSE(surface->image.empty());  // a used one
  const Surface fresh;
  EXPECT_EQ(surface->t_ns, fresh.t_ns);
  EXPECT_EQ(surface->t_edges_ns, fresh.t_edges_ns);
  EXPECT_EQ(surface->epoch, fresh.epoch);
  EXPECT_EQ(surface->event_rate_hz, fresh.event_rate_hz);
  EXPECT_EQ(surface->activity_hz, fresh.activity_hz);
  EXPECT_EQ(surface->window_s, fresh.window_s);
  EXPECT_EQ(surface->events_used, fresh.events_used);
  EXPECT_EQ(surface->still, fresh.still);
}

TEST(SurfacePool, KeepsASurfaceAsLongAsAnyoneOwnsIt) {
  SurfacePool pool;
  auto first = TakeRendered(&pool, 1);
  const SurfacePtr shared = first;
  first.reset();
  const auto second = TakeRendered(&pool, 2);
  EXPECT_NE(second->image.data, shared->image.data);
  EXPECT_EQ(cv::countNonZero(shared->image != 1), 0);
}

TEST(SurfacePool, GivesEverySurfaceBuffersOfItsOwn) {
  SurfacePool pool;
  for (int round = 0; round < 2; ++round) {
    std::vector<std::shared_ptr<Surface>> held;
    std::set<const void*> images;
    for (int k = 0; k < 100; ++k) {
      held.push_back(TakeRendered(&pool, k));
      images.insert(held.back()->image.data);
    }
    EXPECT_EQ(images.size(), held.size()) << "round " << round;
  }
}

TEST(SurfacePool, GivesUpWhatWasNotNeededForSecondsAndNothingThatIs) {
  SurfacePool pool;
  std::vector<std::shared_ptr<Surface>> backlog;
  backlog.reserve(40);
  for (int k = 0; k < 40; ++k) backlog.push_back(TakeRendered(&pool, k));
  backlog.clear();
  // Then four at once are needed, again and again.
  const auto take_four = [&] {
    std::set<const void*> images;
    std::vector<std::shared_ptr<Surface>> held;
    held.reserve(4);
    for (int k = 0; k < 4; ++k) held.push_back(TakeRendered(&pool, k));
    for (const auto& surface : held) images.insert(surface->image.data);
    return images;
  };
  for (int round = 0; round < 200; ++round) take_four();
  const std::set<const void*> needed = take_four();
  for (int round = 0; round < 1000; ++round) EXPECT_EQ(take_four(), needed);
  int used = 0;
  for (int k = 0; k < 40; ++k) {
    backlog.push_back(pool.Take());
    used += backlog.back()->image.empty() ? 0 : 1;
  }
  EXPECT_GE(used, 4);
  EXPECT_LE(used, 8);
}

TEST(SurfacePool, MayDieBeforeItsSurfaces) {
  auto pool = std::make_unique<SurfacePool>();
  auto surface = TakeRendered(pool.get(), 1), other = TakeRendered(pool.get(), 2);
  other.reset();
  pool.reset();
  EXPECT_EQ(cv::countNonZero(surface->image != 1), 0);
  surface->edges.resize(5000);
  const std::weak_ptr<Surface> watched = surface;
  surface.reset();
  EXPECT_TRUE(watched.expired());
}

/// Surfaces on their way from the threads that render them to one that lets them go.
class Queue {
 public:
  void Put(std::shared_ptr<Surface> surface) {
    const std::lock_guard<std::mutex> lock(mutex_);
    surfaces_.push_back(std::move(surface));
  }
  std::shared_ptr<Surface> Get() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (surfaces_.empty()) return nullptr;
    auto surface = std::move(surfaces_.front());
    surfaces_.pop_front();
    return surface;
  }

 private:
  std::mutex mutex_;
  std::deque<std::shared_ptr<Surface>> surfaces_;
};

TEST(SurfacePool, GivesNoBufferToTwoThreadsAtOnce) {
  constexpr int kThreads = 3, kRounds = 1000;
  SurfacePool pool;
  Queue queue;
  std::vector<std::thread> renderers;
  for (int id = 1; id <= kThreads; ++id) {
    renderers.emplace_back([&, id] {
      for (int k = 0; k < kRounds; ++k) {
        auto surface = TakeRendered(&pool, id);
        surface->epoch = id;
        queue.Put(std::move(surface));
      }
    });
  }
  int seen = 0, overwritten = 0;
  while (seen < kThreads * kRounds) {
    const auto surface = queue.Get();
    if (!surface) {
      std::this_thread::yield();
      continue;
    }
    ++seen;
    overwritten += cv::countNonZero(surface->image != static_cast<int>(surface->epoch)) > 0;
  }
  for (std::thread& renderer : renderers) renderer.join();
  EXPECT_EQ(overwritten, 0);
}

}  // namespace
}  // namespace devo
