// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/worker.h"

#include <utility>

#include "devo/ros/scheduling.h"

namespace devo {

Worker::Worker(Urgency urgency, std::function<bool()> step)
    : urgency_(urgency), step_(std::move(step)), thread_([this] { Run(); }) {}

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

ros::NodeHandle Worker::HandleOf(const ros::NodeHandle& nh) {
  ros::NodeHandle handle(nh);
  handle.setCallbackQueue(&callbacks_);
  return handle;
}

bool Worker::RunCallbacksUntil(const std::function<bool()>& done, ros::WallDuration timeout) {
  const ros::WallTime end = ros::WallTime::now() + timeout;
  while (!done()) {
    const ros::WallDuration left = end - ros::WallTime::now();
    if (left <= ros::WallDuration(0)) return false;
    callbacks_.callAvailable(left);
  }
  return true;
}

void Worker::Queue::addCallback(const ros::CallbackInterfacePtr& callback, std::uint64_t id) {
  CallbackQueue::addCallback(callback, id);
  worker_->Wake();
}

void Worker::Run() {
  if (urgency_ == Urgency::kUrgent) PreferShortWaits();
  while (true) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [this] { return woken_ || stop_; });
      if (stop_) return;
      woken_ = false;
    }
    do {
      callbacks_.callAvailable();
      const std::lock_guard<std::mutex> lock(mutex_);
      if (stop_) return;
    } while (step_());
  }
}

}  // namespace devo
