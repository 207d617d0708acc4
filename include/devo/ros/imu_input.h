// SPDX-License-Identifier: BSD-3-Clause
//
// The IMU's messages as samples in the event frame. Never with a guessed rotation.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <ros/node_handle.h>
#include <sensor_msgs/Imu.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "devo/core/imu.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/statistics.h"

namespace devo {

/// Samples arrive on the callback queue of the node handle; they may be taken from another thread.
class ImuInput {
 public:
  /// `surroundings` is asked per sample, on the callback queue. `on_arrival` hears every message's time.
  ImuInput(const ros::NodeHandle& nh, const std::string& topic, std::int64_t time_offset_ns,
           std::function<ImuSurroundings()> surroundings, std::function<void(std::int64_t)> on_arrival);

  /// The waiting samples up to and with a surface's `t_ns`, oldest first.
  std::vector<ImuSample> TakeUntil(std::int64_t t_ns);

  /// Warns where samples come too late to be of use, or are of a clock that is ahead.
  void Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  void OnImu(const sensor_msgs::Imu& message);
  void OnTransforms(const tf2_msgs::TFMessage& message);

  std::string topic_;
  std::int64_t time_offset_ns_;
  std::function<ImuSurroundings()> surroundings_;
  std::function<void(std::int64_t)> on_arrival_;
  tf2::BufferCore transforms_;
  mutable std::mutex mutex_;
  std::deque<ImuSample> waiting_;
  std::int64_t newest_ns_ = 0, period_ns_ = 0;
  double ahead_s_ = 0;   // the newest sample, of the last surface that asked
  Quantiles behind_ms_;  // the newest sample, when a surface asks
  std::uint64_t accepted_ = 0, without_transform_ = 0, no_reading_ = 0, overflowed_ = 0;
  ros::Subscriber imu_subscriber_, transform_subscriber_;
};

}  // namespace devo
