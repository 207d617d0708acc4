// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/ground_truth.h"

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

constexpr double kPeriod_s = 0.1;
constexpr double kBackwards_s = 0.1;

Rigid3 PoseOf(const geometry_msgs::PoseStamped& message) { return FromPoseMsg(message.pose); }
Rigid3 PoseOf(const nav_msgs::Odometry& message) { return FromPoseMsg(message.pose.pose); }
Rigid3 PoseOf(const geometry_msgs::TransformStamped& message) { return FromTransformMsg(message.transform); }

}  // namespace

GroundTruth::GroundTruth(const ros::NodeHandle& nh, const std::string& topic, const Rigid3& T_body_event)
    : nh_(nh), topic_(nh.resolveName(topic)), T_body_event_(T_body_event),
      publisher_(nh_.advertise<nav_msgs::Path>(topics::kGroundTruthPath, 1, true)),
      probe_(nh_, topic_, [this](const topic_tools::ShapeShifter& first) { return Subscribe(first.getDataType()); }) {}

bool GroundTruth::Subscribe(const std::string& type) {
  if (type == "nav_msgs/Odometry") {
    SubscribeTo<nav_msgs::Odometry>();
  } else if (type == "geometry_msgs/TransformStamped") {
    SubscribeTo<geometry_msgs::TransformStamped>();
  } else if (type == "geometry_msgs/PoseStamped") {
    SubscribeTo<geometry_msgs::PoseStamped>();
  } else {
    ROS_WARN_STREAM_THROTTLE(10, "no ground truth: " << topic_ << " (key 'topics.ground_truth') is published as "
                                                     << type << ", expected PoseStamped, Odometry or TransformStamped");
    return false;
  }
  return true;
}

template <typename Message>
void GroundTruth::SubscribeTo() {
  subscriber_ = nh_.subscribe<Message>(topic_, 1000,
                                       boost::function<void(const boost::shared_ptr<const Message>&)>(
                                           [this](const boost::shared_ptr<const Message>& message) {
                                             try {
                                               Add(FromRosTime(message->header.stamp), PoseOf(*message));
                                             } catch (const std::exception& error) {
                                               ROS_WARN_STREAM_THROTTLE(10, topic_ << ": " << error.what());
                                             }
                                           }));
}

void GroundTruth::Add(std::int64_t t_ns, const Rigid3& T_world_body) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!poses_.empty()) {
    if (SecondsFromNs(t_ns - poses_.back().t_ns) < -kBackwards_s) {
      poses_.clear();
      drawn_ = 0;
    } else if (t_ns <= poses_.back().t_ns) {
      return;
    }
  }
  poses_.push_back({t_ns, T_world_body * T_body_event_});
}

Trajectory GroundTruth::poses() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return poses_;
}

void GroundTruth::PublishPath(std::int64_t t_ns, const Rigid3& T_odom_event, const std::string& odom_frame) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (std::abs(t_ns - published_ns_) < NsFromSeconds(kPeriod_s)) return;
  published_ns_ = t_ns;
  if (!T_odom_world_) {
    const auto T_world_event = PoseAt(poses_, t_ns, NsFromSeconds(0.2));
    if (!T_world_event) return;
    T_odom_world_ = T_odom_event * T_world_event->inverse();
  }
  if (drawn_ == 0) path_.poses.clear();
  for (; drawn_ < poses_.size(); ++drawn_) {
    geometry_msgs::PoseStamped pose;
    pose.header.frame_id = odom_frame;
    pose.header.stamp = ToRosTime(poses_[drawn_].t_ns);
    if (!path_.poses.empty() && (pose.header.stamp - path_.poses.back().header.stamp).toSec() < 0.05) continue;
    pose.pose = ToPoseMsg(*T_odom_world_ * poses_[drawn_].T_world_body);
    path_.poses.push_back(pose);
  }
  path_.header.frame_id = odom_frame;
  path_.header.stamp = ToRosTime(t_ns);
  publisher_.publish(path_);
}

void GroundTruth::Clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  T_odom_world_.reset();
  drawn_ = 0;
  published_ns_ = 0;
}

}  // namespace devo
