// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace devo {

/// A thread that works through what callbacks leave for it and sleeps when there is nothing: callbacks stay short, so
/// that no nodelet holds up the manager's threads.
class Worker {
 public:
  /// `step` does one piece of work and returns whether there may be more. It is called on the worker's thread only.
  explicit Worker(std::function<bool()> step);

  /// Joins the thread after the current step.
  ~Worker();

  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// There is something to do.
  void Wake();

 private:
  void Run();

  std::function<bool()> step_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool woken_ = false;
  bool stop_ = false;
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace devo
