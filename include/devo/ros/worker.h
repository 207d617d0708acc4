// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>

namespace devo {

/// A thread that works through what callbacks leave for it and sleeps when there is nothing: callbacks stay short, so
/// that no nodelet holds up the manager's threads.
class Worker {
 public:
  enum class Urgency {
    kUrgent,  ///< a pose waits for it
    kUsual    ///< as the process
  };

  /// `step` does one piece of work and returns whether there may be more. It is called on the worker's thread only.
  Worker(Urgency urgency, std::function<bool()> step);

  /// Joins the thread after the current step. What was subscribed with `HandleOf` must be shut down before.
  ~Worker();

  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// There is something to do.
  void Wake();

  /// A handle like `nh` whose subscriptions call back on the worker's thread, between steps: a message within the
  /// manager then passes from one thread to one other, not through two of the manager's.
  ros::NodeHandle HandleOf(const ros::NodeHandle& nh);

  /// On the worker's thread: runs such callbacks until `done`. Returns whether it was within `timeout`.
  bool RunCallbacksUntil(const std::function<bool()>& done, ros::WallDuration timeout);

 private:
  class Queue : public ros::CallbackQueue {
   public:
    explicit Queue(Worker* worker) : worker_(worker) {}
    void addCallback(const ros::CallbackInterfacePtr& callback, std::uint64_t id) override;

   private:
    Worker* worker_;
  };

  void Run();

  Urgency urgency_;
  std::function<bool()> step_;
  Queue callbacks_{this};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool woken_ = false;
  bool stop_ = false;
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace devo
