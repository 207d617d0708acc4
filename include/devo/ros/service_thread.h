// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

namespace devo {

/// A thread for services that take long: written on the thread of a nodelet's callbacks, an hour's trajectory would
/// keep its data waiting for a second.
class ServiceThread {
 public:
  ServiceThread() { spinner_.start(); }

  /// A handle like `nh` whose services are called on this thread.
  ros::NodeHandle HandleOf(const ros::NodeHandle& nh) {
    ros::NodeHandle handle(nh);
    handle.setCallbackQueue(&queue_);
    return handle;
  }

  /// After the services have been shut down: waits for a call that runs.
  void Stop() { spinner_.stop(); }

 private:
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_{1, &queue_};
};

}  // namespace devo
