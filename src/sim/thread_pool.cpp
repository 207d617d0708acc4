// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/thread_pool.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace devo::sim {

struct ThreadPool::Impl {
  std::mutex mutex;
  std::condition_variable work, done;
  const std::function<void(int)>* function = nullptr;
  int count = 0, running = 0;
  std::uint64_t round = 0;
  std::atomic<int> next{0};
  bool stop = false;
  std::exception_ptr error;
  std::vector<std::thread> threads;

  void Drain(const std::function<void(int)>& f, int n) {
    try {
      for (int i = next++; i < n; i = next++) f(i);
    } catch (...) {
      next = n;
      const std::lock_guard<std::mutex> lock(mutex);
      if (!error) error = std::current_exception();
    }
  }

  void Work() {
    std::uint64_t seen = 0;
    std::unique_lock<std::mutex> lock(mutex);
    while (true) {
      work.wait(lock, [&] { return stop || round != seen; });
      if (stop) return;
      seen = round;
      const auto* f = function;
      const int n = count;
      lock.unlock();
      Drain(*f, n);
      lock.lock();
      if (--running == 0) done.notify_all();
    }
  }
};

ThreadPool::ThreadPool(int threads) : impl_(new Impl) {
  if (threads <= 0) threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  for (int i = 1; i < threads; ++i) impl_->threads.emplace_back([this] { impl_->Work(); });
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->work.notify_all();
  for (auto& t : impl_->threads) t.join();
}

int ThreadPool::threads() const { return static_cast<int>(impl_->threads.size()) + 1; }

void ThreadPool::ForEach(int count, const std::function<void(int)>& function) {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->function = &function;
    impl_->count = count;
    impl_->next = 0;
    impl_->running = static_cast<int>(impl_->threads.size());
    impl_->error = nullptr;
    ++impl_->round;
  }
  impl_->work.notify_all();
  impl_->Drain(function, count);
  std::unique_lock<std::mutex> lock(impl_->mutex);
  impl_->done.wait(lock, [&] { return impl_->running == 0; });
  if (impl_->error) std::rethrow_exception(impl_->error);
}

}  // namespace devo::sim
