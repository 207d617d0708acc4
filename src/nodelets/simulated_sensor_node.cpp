// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/simulated_sensor_node.h"

#include <algorithm>

#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/parameters.h"
#include "devo/ros/sim_bag_writer.h"
#include "devo/sim/rig_file.h"

namespace devo {
namespace {

using Names = sim::PlainTopics;
constexpr std::int64_t kCameraInfoPeriodNs = 100'000'000;
constexpr std::chrono::seconds kLongestDelay(1);  // then data are dropped
constexpr double kPreparedDuration_s = 10, kDuration_s = 300;

double Seconds(std::chrono::steady_clock::duration d) { return std::chrono::duration<double>(d).count(); }

sim::SequenceOptions ReadOptions(const ros::NodeHandle& nh) {
  sim::SequenceOptions o;
  o.scene = ReadString(nh, "scene", "table");
  o.sensor = ReadString(nh, "sensor", "davis346");
  o.light = ReadString(nh, "light", "bright");
  o.speed = ReadString(nh, "speed", "slow");
  o.trajectory_file = ReadString(nh, "trajectory", "");
  const bool prepare = ReadBool(nh, "prepare", true);
  o.closed = prepare && ReadBool(nh, "loop", true) && o.trajectory_file.empty();
  o.duration_s = ReadDouble(nh, "duration", prepare ? kPreparedDuration_s : kDuration_s, 0.1, 1e6);
  o.rest_s = ReadDouble(nh, "rest", 0.3, 0, 1e6);
  o.seed = static_cast<std::uint64_t>(ReadInt(nh, "seed", 1, 0, 1 << 30));
  o.start_s = ReadDouble(nh, "start_stamp", 1000, 1, 4e9);
  o.depth_rate_hz = ReadDouble(nh, "depth_rate", 15, 0.1, 30);
  o.lidar = ReadBool(nh, "lidar", false);
  o.frames = ReadBool(nh, "frames", false);
  o.imu = ReadBool(nh, "imu", false);
  RefuseUnknown(nh, {"scene", "sensor", "light", "speed", "trajectory", "duration", "rest", "seed", "start_stamp",
                     "depth_rate", "lidar", "frames", "imu", "prepare", "loop", "memory_limit_mb", "clock",
                     "wait_for_subscribers", "diagnostic_period"});
  return o;
}

}  // namespace

SimulatedSensorNode::SimulatedSensorNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), options_(ReadOptions(private_nh)),
      prepare_(ReadBool(private_nh, "prepare", true)), loop_(options_.closed),
      clock_(ReadBool(private_nh, "clock", true)),
      wait_for_subscribers_(ReadBool(private_nh, "wait_for_subscribers", true)),
      memory_limit_bytes_(static_cast<std::size_t>(ReadInt(private_nh, "memory_limit_mb", 4000, 1, 1 << 20)) << 20),
      health_(nh, private_nh) {
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

void SimulatedSensorNode::PublishCameraInfo(std::int64_t t_ns) {
  if (t_ns < next_camera_info_ns_) return;
  next_camera_info_ns_ = t_ns + kCameraInfoPeriodNs;
  event_info_publisher_.publish(ToCameraInfoMsg(rig_.event_camera, t_ns, Names::kEventFrame));
  depth_info_publisher_.publish(ToCameraInfoMsg(rig_.depth_camera, t_ns, Names::kDepthFrame));
}

void SimulatedSensorNode::Publish(const SensorMessages& m) {
  if (clock_) {
    rosgraph_msgs::Clock clock;
    clock.clock = ToRosTime(m.end_ns);
    clock_publisher_.publish(clock);
  }
  PublishCameraInfo(m.begin_ns);
  for (const auto& depth : m.depth) depth_publisher_.publish(depth);
  for (const auto& frame : m.frames) frame_publisher_.publish(frame);
  for (const auto& sample : m.imu) imu_publisher_.publish(sample);
  for (const auto& scan : m.scans) points_publisher_.publish(scan);
  for (const auto& pose : m.truth) truth_publisher_.publish(pose);
  if (m.events) event_publisher_.publish(m.events);
  events_ += m.event_count();
}

void SimulatedSensorNode::Run() {
  try {
    // Building scene and motion takes a while: not for onInit, which holds up the manager.
    auto sequence = std::make_unique<sim::Sequence>(options_);
    rig_ = sequence->rig();
    transform_publisher_.publish(StaticTransforms(*sequence));
    if (!prepare_) {
      WaitForSubscribers();
      StreamWhileRendering(sequence.get());
    } else if (Prepare(sequence.get())) {
      sequence.reset();
      WaitForSubscribers();
      StreamPrepared();
    }
    state_ = State::kEnded;
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh_.getNamespace() << " does not run: " << error.what());
    failure_ = error.what();
    state_ = State::kFailed;
  }
}

bool SimulatedSensorNode::Prepare(sim::Sequence* sequence) {
  state_ = State::kPreparing;
  ROS_INFO(
      "simulated sensor: rendering %.1f s of '%s' with %s before streaming them in real time (`prepare`: false "
      "streams at once, as slowly as it renders)",
      options_.duration_s, options_.scene.c_str(), options_.sensor.c_str());
  prepared_ = std::make_unique<PreparedMessages>(rig_);
  const auto started = WallClock::now();
  auto told = started;
  sim::Chunk chunk;
  while (!stop_ && sequence->Next(&chunk)) {
    prepared_->Add(chunk);
    if (prepared_->bytes() > memory_limit_bytes_) {
      throw std::runtime_error(
          "the prepared sequence needs more than memory_limit_mb = " + std::to_string(memory_limit_bytes_ >> 20) +
          " MB; expected a shorter `duration`, or more");
    }
    const double share = static_cast<double>(chunk.end_ns - sequence->begin_ns()) /
                         static_cast<double>(sequence->end_ns() - sequence->begin_ns());
    prepared_percent_ = static_cast<int>(100 * share);
    const auto now = WallClock::now();
    if (now - told < std::chrono::seconds(2)) continue;
    told = now;
    ROS_INFO("simulated sensor: %d %% rendered, about %.0f s to go", prepared_percent_.load(),
             Seconds(now - started) * (1 / share - 1));
  }
  lost_in_readout_ = sequence->statistics().events_lost_in_readout;
  if (stop_) return false;
  ROS_INFO("simulated sensor: %.2f Mev (%.2f Mev/s) prepared in %.1f s, %.0f MB",
           1e-6 * static_cast<double>(prepared_->events()),
           1e-6 * static_cast<double>(prepared_->events()) / options_.duration_s, Seconds(WallClock::now() - started),
           1e-6 * static_cast<double>(prepared_->bytes()));
  return true;
}

void SimulatedSensorNode::WaitForSubscribers() {
  state_ = State::kWaiting;
  while (!stop_ && wait_for_subscribers_ && event_publisher_.getNumSubscribers() == 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  state_ = State::kStreaming;
}

void SimulatedSensorNode::StreamPrepared() {
  auto due = WallClock::now();
  for (int pass = 0; !stop_ && (pass == 0 || loop_); ++pass) {
    const auto started = due;
    const std::int64_t later_ns = pass * (NsFromSeconds(options_.duration_s) / 1000 * 1000);
    latest_late_s_ = 0;
    for (std::size_t i = 0; i < prepared_->chunks() && !stop_; ++i) {
      const SensorMessages messages = prepared_->At(i, later_ns);
      due += std::chrono::nanoseconds(messages.end_ns - messages.begin_ns);
      std::this_thread::sleep_until(due);
      const auto late = WallClock::now() - due;
      latest_late_s_ = std::max(latest_late_s_.load(), Seconds(late));
      if (late > kLongestDelay) {
        dropped_events_ += messages.event_count();
        continue;
      }
      Publish(messages);
    }
    if (!stop_) ReportPass(pass, started);
  }
}

void SimulatedSensorNode::ReportPass(int pass, WallClock::time_point started) {
  const double wall_s = Seconds(WallClock::now() - started);
  ROS_INFO(
      "simulated sensor: pass %d, %.2f s in %.2f s, %llu events so far, %llu of them dropped, at most %.0f ms late",
      pass + 1, options_.duration_s, wall_s, static_cast<unsigned long long>(events_ + dropped_events_),
      static_cast<unsigned long long>(dropped_events_.load()), 1e3 * latest_late_s_);
}

void SimulatedSensorNode::StreamWhileRendering(sim::Sequence* sequence) {
  sim::Chunk chunk;
  auto due = WallClock::now();
  while (!stop_ && sequence->Next(&chunk)) {
    due += std::chrono::nanoseconds(chunk.end_ns - chunk.begin_ns);
    const auto now = WallClock::now();
    if (now > due) {
      behind_s_ = behind_s_ + Seconds(now - due);
      due = now;
    }
    std::this_thread::sleep_until(due);
    Publish(ToMessages(chunk, rig_));
    lost_in_readout_ = sequence->statistics().events_lost_in_readout;
  }
}

void SimulatedSensorNode::FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using Level = diagnostic_msgs::DiagnosticStatus;
  switch (state_.load()) {
    case State::kBuilding: status.summary(Level::WARN, "building scene and motion"); break;
    case State::kPreparing: status.summaryf(Level::WARN, "preparing: %d %% rendered", prepared_percent_.load()); break;
    case State::kWaiting: status.summary(Level::OK, "waiting for a subscriber of the events"); break;
    case State::kFailed: status.summary(Level::ERROR, failure_); break;
    case State::kEnded: status.summary(Level::OK, "the sequence has ended"); break;
    case State::kStreaming:
      status.summary(Level::OK, "streaming");
      if (behind_s_ > 0.5) {
        status.summary(Level::WARN,
                       "slower than real time: the simulation's clock has fallen behind, nothing was left out");
      } else if (dropped_events_ > 0) {
        status.summary(Level::WARN, "events were dropped: they were more than a second late");
      }
  }
  status.add("events", events_.load());
  status.add("events dropped", dropped_events_.load());
  status.add("events lost in the sensor's readout", lost_in_readout_.load());
  if (prepare_) {
    status.addf("latest chunk of this pass (ms)", "%.1f", 1e3 * latest_late_s_);
  } else {
    status.addf("behind real time (s)", "%.2f", behind_s_.load());
  }
}

}  // namespace devo
