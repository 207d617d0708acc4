// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#include "devo/core/surface.h"

namespace devo {

/// Surfaces whose buffers return when the last owner lets go, in whatever thread: fresh memory would cost more page
/// faults than a surface costs to render. What a moment of backlog needed and nobody does any more is given up after
/// some seconds. The pool may die before its surfaces. Thread-safe.
class SurfacePool {
 public:
  /// A surface with the fields of a new one; its buffers are those of an old one, contents undefined.
  std::shared_ptr<Surface> Take() {
    std::unique_ptr<Surface> surface, surplus;
    {
      const std::lock_guard<std::mutex> lock(store_->mutex);
      if (!store_->free.empty()) {
        surface = std::move(store_->free.back());
        store_->free.pop_back();
      }
      surplus = store_->TakeSurplus();
    }
    if (!surface) surface = std::make_unique<Surface>();
    Surface fresh;
    std::swap(fresh.image, surface->image);
    std::swap(fresh.nearest_edge, surface->nearest_edge);
    std::swap(fresh.edges, surface->edges);
    fresh.edges.clear();
    *surface = std::move(fresh);
    return {surface.release(), [store = store_](Surface* used) { store->Return(std::unique_ptr<Surface>(used)); },
            BlockAllocator<Surface>(store_)};
  }

 private:
  struct Store {
    static constexpr std::size_t kMaxFree = 48;
    static constexpr std::size_t kSpare = 2;  // more than was needed of late is kept of these
    static constexpr int kWatched = 256;      // surfaces: some seconds

    void Return(std::unique_ptr<Surface> surface) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (free.size() < kMaxFree) free.push_back(std::move(surface));
    }

    /// After each surface taken, one that was free whenever one was taken of late; most often null.
    std::unique_ptr<Surface> TakeSurplus() {
      least_free = std::min(least_free, free.size());
      if (++taken == kWatched) {
        surplus = least_free > kSpare ? least_free - kSpare : 0;
        taken = 0;
        least_free = kMaxFree;
      }
      if (surplus == 0 || free.empty()) return nullptr;
      --surplus;
      auto oldest = std::move(free.front());
      free.erase(free.begin());
      return oldest;
    }

    ~Store() {
      for (void* block : free_blocks) ::operator delete(block);
    }
    std::mutex mutex;
    std::vector<std::unique_ptr<Surface>> free;  // the last returned, whose memory is in the nearest cache, at the end
    std::size_t least_free = kMaxFree, surplus = 0;
    int taken = 0;
    std::vector<void*> free_blocks;  // where shared pointers count their owners: all of one size
  };

  /// Memory for the counts of owners, which returns like the surfaces.
  template <typename T>
  struct BlockAllocator {
    using value_type = T;
    explicit BlockAllocator(std::shared_ptr<Store> store_in) : store(std::move(store_in)) {}
    template <typename U>
    BlockAllocator(const BlockAllocator<U>& other) : store(other.store) {}  // NOLINT(google-explicit-constructor)

    T* allocate(std::size_t count) {
      const std::lock_guard<std::mutex> lock(store->mutex);
      if (store->free_blocks.empty()) return static_cast<T*>(::operator new(count * sizeof(T)));
      void* block = store->free_blocks.back();
      store->free_blocks.pop_back();
      return static_cast<T*>(block);
    }
    void deallocate(T* block, std::size_t) {
      const std::lock_guard<std::mutex> lock(store->mutex);
      if (store->free_blocks.size() < Store::kMaxFree) {
        store->free_blocks.push_back(block);
      } else {
        ::operator delete(block);
      }
    }
    template <typename U>
    bool operator==(const BlockAllocator<U>& other) const {
      return store == other.store;
    }
    template <typename U>
    bool operator!=(const BlockAllocator<U>& other) const {
      return store != other.store;
    }
    std::shared_ptr<Store> store;
  };
  std::shared_ptr<Store> store_ = std::make_shared<Store>();
};

}  // namespace devo
