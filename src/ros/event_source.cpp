// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/event_source.h"

#include <utility>

#include <ros/master.h>

namespace devo {
namespace {

/// Whether the master knows the topic as one of EventPackets.
bool IsPacketTopic(const std::string& topic) {
  ros::master::V_TopicInfo known;
  ros::master::getTopics(known);
  for (const ros::master::TopicInfo& info : known) {
    if (info.name == topic) return info.datatype.find("/EventPacket") != std::string::npos;
  }
  return false;
}

}  // namespace

std::size_t EventMessage::MostEvents() const {
  // Two bytes are the least that an event takes, but for EVT3's vectors (12 events in two words).
  return array ? array->events.size() : 3 * packet->events.size();
}

void EventDecoder::Append(const EventMessage& message, std::vector<Event>* events) {
  if (message.array) {
    AppendEvents(*message.array, events);
  } else {
    packets_.Append(*message.packet, events);
  }
}

EventSource::EventSource(const ros::NodeHandle& nh, const std::string& topic, int queue_size,
                         std::function<void(EventMessage)> on_message)
    : nh_(nh), topic_(nh.resolveName(topic)), queue_size_(queue_size), on_message_(std::move(on_message)) {
  SubscribeTo(IsPacketTopic(topic_));
  timer_ = nh_.createWallTimer(ros::WallDuration(0.5), [this](const ros::WallTimerEvent&) { CheckType(); });
}

void EventSource::SubscribeTo(bool packets) {
  packets_ = packets;
  // roscpp refuses two types on one topic within a process.
  subscriber_.shutdown();
  if (packets) {
    subscriber_ = nh_.subscribe<EventPacket>(topic_, queue_size_, [this](const EventPacketConstPtr& message) {
      arrived_ = true;
      on_message_({nullptr, message, ros::WallTime::now()});
    });
  } else {
    subscriber_ = nh_.subscribe<EventArray>(topic_, queue_size_, [this](const EventArrayConstPtr& message) {
      arrived_ = true;
      on_message_({message, nullptr, ros::WallTime::now()});
    });
  }
}

void EventSource::CheckType() {
  if (arrived_) {
    timer_.stop();
    return;
  }
  if (!packets_ && IsPacketTopic(topic_)) SubscribeTo(true);
}

}  // namespace devo
