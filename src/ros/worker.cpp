// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/worker.h"

#include <utility>

namespace devo {

Worker::Worker(std::function<bool()> step) : step_(std::move(step)), thread_([this] { Run(); }) {}

Worker::~Worker() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void Worker::Wake() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    woken_ = true;
  }
  wake_.notify_one();
}

void Worker::Run() {
  while (true) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [this] { return woken_ || stop_; });
      if (stop_) return;
      woken_ = false;
    }
    while (step_()) {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (stop_) return;
    }
  }
}

}  // namespace devo
