// SPDX-License-Identifier: BSD-3-Clause
//
// The simulator as a live sensor: the same sequence that devo_simulate writes, published in real time.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>

#include "devo/ros/health.h"
#include "devo/sim/sequence.h"

namespace devo {

/// Publishes the topics of the plain dialect (devo/sim/rig_file.h) on a thread of its own. When rendering is slower
/// than real time the sensor's clock runs slower, too (and says so): no data are left out. With `clock` it publishes
/// /clock, so that everything else follows.
class SimulatedSensorNode {
 public:
  /// Throws std::invalid_argument naming the parameter that is wrong.
  SimulatedSensorNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~SimulatedSensorNode();

 private:
  void Run();
  void Publish(const sim::Chunk& chunk);
  void PublishStatic();
  void PublishCameraInfo(std::int64_t t_ns);
  void FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status);

  ros::NodeHandle nh_, private_nh_;
  sim::SequenceOptions options_;
  std::unique_ptr<sim::Sequence> sequence_;  // made by the thread; others look only when ready_
  std::atomic<bool> ready_{false};
  bool clock_, wait_for_subscribers_;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> events_{0};
  std::atomic<double> behind_s_{0};
  std::int64_t next_camera_info_ns_ = 0;

  Health health_;
  ros::Publisher event_publisher_, event_info_publisher_, depth_publisher_, depth_info_publisher_, imu_publisher_,
      frame_publisher_, points_publisher_, truth_publisher_, clock_publisher_, transform_publisher_;
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace devo
