// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/prepared_messages.h"

#include <boost/make_shared.hpp>

#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/sim_bag_writer.h"
#include "devo/sim/rig_file.h"

namespace devo {
namespace {

using Names = sim::PlainTopics;
constexpr std::uint16_t kPolarityBit = 0x8000;

std::string DepthFrame(const Rig& rig) { return rig.depth_registered ? Names::kEventFrame : Names::kDepthFrame; }

/// Copies of messages with later stamps.
template <typename Pointers>
Pointers Later(const Pointers& from, const ros::Duration& later) {
  Pointers to;
  to.reserve(from.size());
  for (const auto& message : from) {
    to.push_back(boost::make_shared<typename Pointers::value_type::element_type>(*message));
    to.back()->header.stamp += later;
  }
  return to;
}

SensorMessages AllButEvents(const sim::Chunk& chunk, const Rig& rig) {
  SensorMessages m;
  m.begin_ns = chunk.begin_ns;
  m.end_ns = chunk.end_ns;
  for (const auto& d : chunk.depth)
    m.depth.push_back(boost::make_shared<sensor_msgs::Image>(ToDepthMsg(d, "16UC1", DepthFrame(rig))));
  for (const auto& f : chunk.frames)
    m.frames.push_back(boost::make_shared<sensor_msgs::Image>(ToFrameMsg(f, Names::kEventFrame)));
  for (const auto& s : chunk.scans)
    m.scans.push_back(boost::make_shared<sensor_msgs::PointCloud2>(ToPointCloudMsg(s, Names::kLidarFrame)));
  for (const auto& s : chunk.imu)
    m.imu.push_back(boost::make_shared<sensor_msgs::Imu>(ToImuMsg(s, Names::kEventFrame)));
  for (const auto& p : chunk.poses)
    m.truth.push_back(boost::make_shared<geometry_msgs::PoseStamped>(ToPoseMsg(p.t_ns, p.T_world_event, "world")));
  return m;
}

}  // namespace

SensorMessages ToMessages(const sim::Chunk& chunk, const Rig& rig) {
  SensorMessages m = AllButEvents(chunk, rig);
  if (!chunk.events.empty()) {
    m.events = boost::make_shared<EventArray>(
        ToEventArrayMsg(chunk.events, rig.event_camera.width(), rig.event_camera.height(), Names::kEventFrame));
  }
  return m;
}

void PreparedMessages::Add(const sim::Chunk& chunk) {
  Stored stored{AllButEvents(chunk, rig_), {}};
  stored.events.reserve(chunk.events.size());
  for (const Event& e : chunk.events) {
    stored.events.push_back({static_cast<std::uint32_t>((e.t_ns - chunk.begin_ns) / 1000), e.x,
                             static_cast<std::uint16_t>(e.y | (e.polarity != 0 ? kPolarityBit : 0))});
  }
  events_ += chunk.events.size();
  bytes_ += stored.events.size() * sizeof(PackedEvent);
  for (const auto& image : stored.others.depth) bytes_ += image->data.size();
  for (const auto& image : stored.others.frames) bytes_ += image->data.size();
  for (const auto& scan : stored.others.scans) bytes_ += scan->data.size();
  chunks_.push_back(std::move(stored));
}

EventArrayPtr PreparedMessages::UnpackedEvents(const Stored& stored, std::int64_t later_ns) const {
  auto m = boost::make_shared<EventArray>();
  m->header.frame_id = Names::kEventFrame;
  m->width = static_cast<std::uint32_t>(rig_.event_camera.width());
  m->height = static_cast<std::uint32_t>(rig_.event_camera.height());
  m->events.resize(stored.events.size());
  const ros::Time begin = ToRosTime(stored.others.begin_ns + later_ns);
  for (std::size_t i = 0; i < stored.events.size(); ++i) {
    const PackedEvent& from = stored.events[i];
    auto& to = m->events[i];
    to.x = from.x;
    to.y = from.y_and_polarity & static_cast<std::uint16_t>(~kPolarityBit);
    to.polarity = (from.y_and_polarity & kPolarityBit) != 0 ? 1 : 0;
    const std::uint64_t nsec = begin.nsec + std::uint64_t{1000} * from.after_us;
    to.ts = ros::Time(begin.sec + static_cast<std::uint32_t>(nsec / 1000000000), nsec % 1000000000);
  }
  m->header.stamp = m->events.back().ts;
  return m;
}

SensorMessages PreparedMessages::At(std::size_t chunk, std::int64_t later_ns) const {
  const Stored& stored = chunks_.at(chunk);
  const ros::Duration later = ros::Duration().fromNSec(later_ns);
  SensorMessages m;
  m.begin_ns = stored.others.begin_ns + later_ns;
  m.end_ns = stored.others.end_ns + later_ns;
  if (!stored.events.empty()) m.events = UnpackedEvents(stored, later_ns);
  m.depth = Later(stored.others.depth, later);
  m.frames = Later(stored.others.frames, later);
  m.scans = Later(stored.others.scans, later);
  m.imu = Later(stored.others.imu, later);
  m.truth = Later(stored.others.truth, later);
  return m;
}

}  // namespace devo
