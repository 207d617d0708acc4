// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/imu_input.h"

#include <algorithm>
#include <utility>

#include <ros/console.h>

#include "devo/core/inertial_buffer.h"
#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/played_again.h"

namespace devo {
namespace {

constexpr std::size_t kMaxWaiting = 4000;  // seconds of a fast IMU, while no surface comes
constexpr double kOfAnotherClock_s = 1;    // ahead; a backlog of events is made up for sooner
constexpr char kNoReading[] = "their values are not finite or beyond any sensor's range, expected rad/s and m/s^2";

}  // namespace

ImuInput::ImuInput(const ros::NodeHandle& nh, const std::string& topic, std::int64_t time_offset_ns,
                   std::function<ImuSurroundings()> surroundings, std::function<void(std::int64_t)> on_arrival)
    : topic_(topic), time_offset_ns_(time_offset_ns), surroundings_(std::move(surroundings)),
      on_arrival_(std::move(on_arrival)) {
  ros::NodeHandle handle(nh);
  transform_subscriber_ = handle.subscribe<tf2_msgs::TFMessage>(
      "/tf_static", 100, [this](const tf2_msgs::TFMessageConstPtr& message) { OnTransforms(*message); });
  imu_subscriber_ = handle.subscribe<sensor_msgs::Imu>(
      topic_, 1000, [this](const sensor_msgs::ImuConstPtr& message) { OnImu(*message); });
}

void ImuInput::OnTransforms(const tf2_msgs::TFMessage& message) {
  for (geometry_msgs::TransformStamped transform : message.transforms) {
    transform.header.frame_id = WithoutLeadingSlash(transform.header.frame_id);
    transform.child_frame_id = WithoutLeadingSlash(transform.child_frame_id);
    transforms_.setTransform(transform, "tf_static", true);
  }
}

void ImuInput::OnImu(const sensor_msgs::Imu& message) {
  on_arrival_(FromRosTime(message.header.stamp) + time_offset_ns_);
  ImuSample sample;
  try {
    sample = ToImuSample(message, PoseOfImu(message.header.frame_id, surroundings_(), transforms_), time_offset_ns_);
  } catch (const std::exception& error) {
    ROS_WARN_STREAM_THROTTLE(5, "IMU samples on " << topic_ << " are left out: " << error.what());
    const std::lock_guard<std::mutex> lock(mutex_);
    ++without_transform_;
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!IsReading(sample)) {
    ROS_WARN_STREAM_THROTTLE(5, "IMU samples on " << topic_ << " are left out: " << kNoReading);
    ++no_reading_;
    return;
  }
  if (!waiting_.empty() && SecondsFromNs(sample.t_ns - waiting_.back().t_ns) < -kPlayedAgain_s) waiting_.clear();
  if (newest_ns_ != 0) period_ns_ = std::max<std::int64_t>(0, sample.t_ns - newest_ns_);
  newest_ns_ = sample.t_ns;
  waiting_.push_back(sample);
  ++accepted_;
  if (waiting_.size() > kMaxWaiting) {
    waiting_.pop_front();
    ++overflowed_;
  }
}

std::vector<ImuSample> ImuInput::TakeUntil(std::int64_t t_ns) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (newest_ns_ != 0) behind_ms_.Add(1e3 * std::max(0.0, SecondsFromNs(t_ns - newest_ns_)));
  ahead_s_ = newest_ns_ != 0 ? SecondsFromNs(newest_ns_ - t_ns) : 0;
  std::vector<ImuSample> samples;
  while (!waiting_.empty() && waiting_.front().t_ns <= t_ns) {
    samples.push_back(waiting_.front());
    waiting_.pop_front();
  }
  return samples;
}

void ImuInput::Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  status.add("IMU samples accepted", accepted_);
  status.add("IMU samples without a transform", without_transform_);
  status.add("IMU samples that are no reading", no_reading_);
  status.add("IMU samples that waited too long", overflowed_);
  status.addf("IMU samples behind the surfaces p50 (ms)", "%.1f", behind_ms_.At(0.5));
  const double usable_ms = 1e3 * SecondsFromNs(InertialBuffer::HoldOf_ns(period_ns_));
  if (behind_ms_.At(0.5) > usable_ms) {
    status.mergeSummaryf(
        diagnostic_msgs::DiagnosticStatus::WARN,
        "IMU samples come %.0f ms after the surfaces of their time, too late to be of use beyond %.0f: "
        "its driver's latency, or imu_time_offset_s",
        behind_ms_.At(0.5), usable_ms);
  }
  if (ahead_s_ > kOfAnotherClock_s) {
    status.mergeSummaryf(diagnostic_msgs::DiagnosticStatus::WARN,
                         "stamps of the IMU are %.1f s ahead of the events, expected the same clock: its samples wait "
                         "and are not used; check the drivers' clocks and imu_time_offset_s",
                         ahead_s_);
  }
}

}  // namespace devo
