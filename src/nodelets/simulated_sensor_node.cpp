// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/simulated_sensor_node.h"

#include <rosgraph_msgs/Clock.h>
#include <tf2_msgs/TFMessage.h>
#include <algorithm>
#include <boost/make_shared.hpp>
#include <chrono>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/parameters.h"
#include "devo/ros/sim_bag_writer.h"
#include "devo/sim/rig_file.h"

namespace devo {
namespace {

using Names = sim::PlainTopics;
constexpr std::int64_t kCameraInfoPeriodNs = 100'000'000;

sim::SequenceOptions ReadOptions(const ros::NodeHandle& nh) {
  sim::SequenceOptions o;
  o.scene = ReadString(nh, "scene", "table");
  o.sensor = ReadString(nh, "sensor", "davis346");
  o.light = ReadString(nh, "light", "bright");
  o.speed = ReadString(nh, "speed", "slow");
  o.trajectory_file = ReadString(nh, "trajectory", "");
  o.duration_s = ReadDouble(nh, "duration", 300, 0.1, 1e6);
  o.rest_s = ReadDouble(nh, "rest", 0.3, 0, 1e6);
  o.seed = static_cast<std::uint64_t>(ReadInt(nh, "seed", 1, 0, 1 << 30));
  o.start_s = ReadDouble(nh, "start_stamp", 1000, 1, 4e9);
  o.depth_rate_hz = ReadDouble(nh, "depth_rate", 15, 0.1, 30);
  o.lidar = ReadBool(nh, "lidar", false);
  o.frames = ReadBool(nh, "frames", false);
  o.imu = ReadBool(nh, "imu", false);
  RefuseUnknown(nh, {"scene", "sensor", "light", "speed", "trajectory", "duration", "rest", "seed", "start_stamp",
                     "depth_rate", "lidar", "frames", "imu", "clock", "wait_for_subscribers", "diagnostic_period"});
  return o;
}

}  // namespace

SimulatedSensorNode::SimulatedSensorNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), options_(ReadOptions(private_nh)), clock_(ReadBool(private_nh, "clock", true)),
      wait_for_subscribers_(ReadBool(private_nh, "wait_for_subscribers", true)), health_(nh, private_nh) {
  event_publisher_ = nh_.advertise<EventArray>(Names::kEvents, 1000);
  event_info_publisher_ = nh_.advertise<sensor_msgs::CameraInfo>(Names::kEventCameraInfo, 10);
  depth_publisher_ = nh_.advertise<sensor_msgs::Image>(Names::kDepth, 10);
  depth_info_publisher_ = nh_.advertise<sensor_msgs::CameraInfo>(Names::kDepthCameraInfo, 10);
  truth_publisher_ = nh_.advertise<geometry_msgs::PoseStamped>(Names::kGroundTruth, 100);
  if (options_.imu) imu_publisher_ = nh_.advertise<sensor_msgs::Imu>(Names::kImu, 100);
  if (options_.frames) frame_publisher_ = nh_.advertise<sensor_msgs::Image>(Names::kFrames, 10);
  if (options_.lidar) points_publisher_ = nh_.advertise<sensor_msgs::PointCloud2>(Names::kPoints, 10);
  if (clock_) clock_publisher_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", 100);
  transform_publisher_ = nh_.advertise<tf2_msgs::TFMessage>("/tf_static", 10, true);
  health_.AddTask("simulated sensor", [this](auto& status) { FillStatus(status); });
  health_.Start();
  thread_ = std::thread([this] { Run(); });
}

SimulatedSensorNode::~SimulatedSensorNode() {
  stop_ = true;
  thread_.join();
}

void SimulatedSensorNode::PublishStatic() {
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  geometry_msgs::TransformStamped& transform = message.transforms.front();
  transform.header.stamp = ToRosTime(sequence_->begin_ns());
  transform.header.frame_id = Names::kEventFrame;
  transform.child_frame_id = Names::kDepthFrame;
  transform.transform = ToTransformMsg(sequence_->rig().T_event_depth);
  transform_publisher_.publish(message);
}

void SimulatedSensorNode::PublishCameraInfo(std::int64_t t_ns) {
  if (t_ns < next_camera_info_ns_) return;
  next_camera_info_ns_ = t_ns + kCameraInfoPeriodNs;
  const Rig& rig = sequence_->rig();
  event_info_publisher_.publish(ToCameraInfoMsg(rig.event_camera, t_ns, Names::kEventFrame));
  depth_info_publisher_.publish(ToCameraInfoMsg(rig.depth_camera, t_ns, Names::kDepthFrame));
}

void SimulatedSensorNode::Publish(const sim::Chunk& chunk) {
  const Rig& rig = sequence_->rig();
  if (clock_) {
    rosgraph_msgs::Clock clock;
    clock.clock = ToRosTime(chunk.end_ns);
    clock_publisher_.publish(clock);
  }
  PublishCameraInfo(chunk.begin_ns);
  for (const DepthImage& depth : chunk.depth) {
    depth_publisher_.publish(boost::make_shared<sensor_msgs::Image>(ToDepthMsg(depth, "16UC1", Names::kDepthFrame)));
  }
  for (const sim::Frame& frame : chunk.frames) frame_publisher_.publish(ToFrameMsg(frame, Names::kEventFrame));
  for (const ImuSample& sample : chunk.imu) imu_publisher_.publish(ToImuMsg(sample, Names::kEventFrame));
  for (const sim::LidarScan& scan : chunk.scans) points_publisher_.publish(ToPointCloudMsg(scan, Names::kLidarFrame));
  for (const sim::TimedPose& pose : chunk.poses) {
    truth_publisher_.publish(ToPoseMsg(pose.t_ns, pose.T_world_event, "world"));
  }
  if (!chunk.events.empty()) {
    event_publisher_.publish(boost::make_shared<EventArray>(
        ToEventArrayMsg(chunk.events, rig.event_camera.width(), rig.event_camera.height(), Names::kEventFrame)));
    events_ += chunk.events.size();
  }
}

void SimulatedSensorNode::Run() {
  try {
    // Building scene and motion takes a while: not for onInit, which holds up the manager.
    sequence_ = std::make_unique<sim::Sequence>(options_);
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh_.getNamespace() << " does not run: " << error.what());
    return;
  }
  ready_ = true;
  PublishStatic();
  while (!stop_ && wait_for_subscribers_ && event_publisher_.getNumSubscribers() == 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  try {
    sim::Chunk chunk;
    using Clock = std::chrono::steady_clock;
    auto due = Clock::now();
    while (!stop_ && sequence_->Next(&chunk)) {
      due += std::chrono::nanoseconds(chunk.end_ns - chunk.begin_ns);
      const auto now = Clock::now();
      if (now > due) {
        behind_s_ = behind_s_ + std::chrono::duration<double>(now - due).count();
        due = now;
      }
      std::this_thread::sleep_until(due);
      Publish(chunk);
    }
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM(private_nh_.getNamespace() << ": " << error.what());
  }
}

void SimulatedSensorNode::FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status) {
  if (!ready_) {
    status.summary(diagnostic_msgs::DiagnosticStatus::WARN, "building scene and motion");
    return;
  }
  const double behind_s = behind_s_;
  if (behind_s > 0.5) {
    status.summary(diagnostic_msgs::DiagnosticStatus::WARN,
                   "slower than real time: the simulation's clock has fallen behind, nothing was left out");
  } else {
    status.summary(diagnostic_msgs::DiagnosticStatus::OK, "simulating");
  }
  status.add("events", events_.load());
  status.addf("behind real time (s)", "%.2f", behind_s);
  status.add("events lost in the sensor's readout", sequence_->statistics().events_lost_in_readout);
}

}  // namespace devo
