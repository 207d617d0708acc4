// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/ground_truth.h"

#include <algorithm>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/played_again.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

// The whole path is written each time, on the tracking's thread.
constexpr double kPeriod_s = 0.1, kPeriodUnwatched_s = 1;
constexpr std::size_t kMaxRecent = 20000;

Rigid3 PoseOf(const geometry_msgs::PoseStamped& message) { return FromPoseMsg(message.pose); }
Rigid3 PoseOf(const nav_msgs::Odometry& message) { return FromPoseMsg(message.pose.pose); }
Rigid3 PoseOf(const geometry_msgs::TransformStamped& message) { return FromTransformMsg(message.transform); }

}  // namespace

GroundTruth::GroundTruth(const ros::NodeHandle& nh, const std::string& topic, const Rigid3& T_body_event,
                         const Options& options)
    : nh_(nh), topic_(nh.resolveName(topic)), T_body_event_(T_body_event), poses_(options.max_poses),
      path_(options.path_min_distance_m), publisher_(nh_.advertise<nav_msgs::Path>(topics::kGroundTruthPath, 1, true)),
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
  if (!recent_.empty()) {
    if (SecondsFromNs(t_ns - recent_.back().t_ns) < -kPlayedAgain_s) {
      poses_.Clear();
      recent_.clear();
      path_.Clear();
      drawn_ = 0;
    } else if (t_ns <= recent_.back().t_ns) {
      return;
    }
  }
  recent_.push_back({t_ns, T_world_body * T_body_event_});
  poses_.Add(recent_.back());
  if (recent_.size() <= kMaxRecent) return;
  recent_.erase(recent_.begin(), recent_.begin() + static_cast<std::ptrdiff_t>(kMaxRecent / 2));
  drawn_ -= std::min(drawn_, kMaxRecent / 2);
}

Trajectory GroundTruth::poses() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return poses_.Poses();
}

void GroundTruth::PublishPath(std::int64_t t_ns, const Rigid3& T_odom_event, const std::string& odom_frame) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const double period_s = publisher_.getNumSubscribers() > 0 ? kPeriod_s : kPeriodUnwatched_s;
  if (std::abs(t_ns - published_ns_) < NsFromSeconds(period_s)) return;
  if (!T_odom_world_) {
    const auto T_world_event = PoseAt(recent_, t_ns, NsFromSeconds(0.2));
    if (!T_world_event) return;
    T_odom_world_ = T_odom_event * T_world_event->inverse();
  }
  if (!DrawRecent(odom_frame)) return;
  published_ns_ = t_ns;
  publisher_.publish(path_.message());
}

bool GroundTruth::DrawRecent(const std::string& odom_frame) {
  bool longer = false;
  std_msgs::Header header;
  header.frame_id = odom_frame;
  for (; drawn_ < recent_.size(); ++drawn_) {
    header.stamp = ToRosTime(recent_[drawn_].t_ns);
    longer |= path_.Extend(header, *T_odom_world_ * recent_[drawn_].T_world_body);
  }
  return longer;
}

void GroundTruth::Clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  T_odom_world_.reset();
  path_.Clear();
  drawn_ = 0;
  published_ns_ = 0;
}

}  // namespace devo
