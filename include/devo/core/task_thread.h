// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

namespace devo {

/// Runs tasks one after the other in the order in which they are given, on a thread of its own or, with `threaded`
/// false, at once on the caller's: a schedule written with it gives the same results with and without threads.
class TaskThread {
 public:
  explicit TaskThread(bool threaded) {
    if (threaded) thread_ = std::thread(&TaskThread::Work, this);
  }

  /// Joins the thread after all tasks that were given.
  ~TaskThread();

  TaskThread(const TaskThread&) = delete;
  TaskThread& operator=(const TaskThread&) = delete;

  /// The result, or the exception, comes through the future.
  template <typename Task>
  auto Run(Task task) -> std::future<decltype(task())> {
    std::packaged_task<decltype(task())()> job(std::move(task));
    auto result = job.get_future();
    if (thread_.joinable()) {
      // std::function wants what can be copied.
      Give([shared = std::make_shared<decltype(job)>(std::move(job))] { (*shared)(); });
    } else {
      job();
    }
    return result;
  }

 private:
  void Give(std::function<void()> job);
  void Work();

  std::mutex mutex_;
  std::condition_variable given_;
  std::deque<std::function<void()>> jobs_;
  bool stop_ = false;
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace devo
