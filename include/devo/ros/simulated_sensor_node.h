// SPDX-License-Identifier: BSD-3-Clause
//
// The simulator as a live sensor: the same sequence that devo_simulate writes, published in real time.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include <ros/node_handle.h>

#include "devo/ros/health.h"
#include "devo/ros/prepared_messages.h"
#include "devo/sim/sequence.h"

namespace devo {

/// Publishes the topics of the plain dialect (devo/sim/rig_file.h) on a thread of its own, and, with `clock`, /clock,
/// so that everything else follows.
///
/// `prepare`: renders the whole sequence into memory first, then streams it at the speed of the wall clock; with `loop`
/// the motion is closed and repeats without end, stamps going on. What is more than a second late is dropped, counted
/// and reported, as a sensor's full buffer would. Otherwise it streams while it renders: when rendering is slower than
/// real time the sensor's clock runs slower, too, and nothing is left out.
class SimulatedSensorNode {
 public:
  /// Throws std::invalid_argument naming the parameter that is wrong.
  SimulatedSensorNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~SimulatedSensorNode();

 private:
  using WallClock = std::chrono::steady_clock;
  enum class State { kBuilding, kPreparing, kWaiting, kStreaming, kEnded, kFailed };

  void Run();
  bool Prepare(sim::Sequence* sequence);
  void WaitForSubscribers();
  void StreamPrepared();
  void StreamWhileRendering(sim::Sequence* sequence);
  void Publish(const SensorMessages& messages);
  void PublishCameraInfo(std::int64_t t_ns);
  void ReportPass(int pass, WallClock::time_point started);
  void FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status);

  ros::NodeHandle nh_, private_nh_;
  sim::SequenceOptions options_;
  bool prepare_, loop_, clock_, wait_for_subscribers_;
  std::size_t memory_limit_bytes_;
  Rig rig_;
  std::unique_ptr<PreparedMessages> prepared_;
  std::int64_t next_camera_info_ns_ = 0;

  // Written by the thread, read by diagnostics.
  std::atomic<State> state_{State::kBuilding};
  std::string failure_;  ///< set before kFailed is
  std::atomic<int> prepared_percent_{0};
  std::atomic<std::uint64_t> events_{0}, dropped_events_{0}, lost_in_readout_{0};
  std::atomic<double> behind_s_{0};       ///< streaming while rendering: wall time in which the sensor's clock stood
  std::atomic<double> latest_late_s_{0};  ///< prepared: how late the latest chunk of this pass was
  std::atomic<bool> stop_{false};

  Health health_;
  ros::Publisher event_publisher_, event_info_publisher_, depth_publisher_, depth_info_publisher_, imu_publisher_,
      frame_publisher_, points_publisher_, truth_publisher_, clock_publisher_, transform_publisher_;
  std::thread thread_;  // last: starts when everything else is there
};

}  // namespace devo
