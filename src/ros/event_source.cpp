// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/event_source.h"

#include <type_traits>
#include <utility>

#include <ros/master.h>
#include <ros/message_traits.h>

#include "devo/ros/event_message_types.h"

namespace devo {
namespace {

using OnMessage = std::function<void(EventMessage)>;

/// EventPacket's events are bytes.
template <typename Message>
constexpr bool kIsPacket = std::is_same_v<typename decltype(Message::events)::value_type, std::uint8_t>;

template <typename Message>
EventMessage Wrap(const boost::shared_ptr<const Message>& message) {
  EventMessage result;
  result.message = message;
  result.arrival = ros::WallTime::now();
  if constexpr (kIsPacket<Message>) {
    // Two bytes are the least that an event takes, but for EVT3's vectors (12 events in two words).
    result.most_events = 3 * message->events.size();
    result.append = [message](EventPacketConverter* packets, std::vector<Event>* events) {
      packets->Append(*message, events);
    };
  } else {
    result.most_events = message->events.size();
    result.append = [message](EventPacketConverter*, std::vector<Event>* events) { AppendEvents(*message, events); };
  }
  return result;
}

template <typename Message>
ros::Subscriber SubscribeTo(ros::NodeHandle nh, const std::string& topic, int queue_size, OnMessage on_message) {
  return nh.subscribe<Message>(
      topic, static_cast<std::uint32_t>(queue_size),
      boost::function<void(const boost::shared_ptr<const Message>&)>(
          [on_message = std::move(on_message)](const boost::shared_ptr<const Message>& message) {
            on_message(Wrap(message));
          }));
}

}  // namespace

struct EventMessageType {
  std::string name;
  ros::Subscriber (*subscribe)(ros::NodeHandle nh, const std::string& topic, int queue_size, OnMessage on_message);
};

namespace {

template <typename Message>
EventMessageType TypeOf() {
  return {ros::message_traits::DataType<Message>::value(), &SubscribeTo<Message>};
}

template <typename... Messages>
std::vector<EventMessageType> TypesOf(MessageTypes<Messages...>) {
  return {TypeOf<Messages>()...};
}

const std::vector<EventMessageType>& KnownTypes() {
  static const std::vector<EventMessageType> types = TypesOf(EventMessageTypes());
  return types;
}

/// In which type to subscribe a topic; null when the master does not know the topic yet.
const EventMessageType* TypeFor(const std::string& topic) {
  const std::vector<EventMessageType>& types = KnownTypes();
  ros::master::V_TopicInfo known;
  ros::master::getTopics(known);
  for (const ros::master::TopicInfo& info : known) {
    if (info.name != topic) continue;
    for (const EventMessageType& type : types) {
      if (type.name == info.datatype) return &type;
    }
    return &types[info.datatype.find("/EventPacket") != std::string::npos ? 1 : 0];
  }
  return nullptr;
}

}  // namespace

EventSource::EventSource(const ros::NodeHandle& nh, const std::string& topic, int queue_size, OnMessage on_message)
    : nh_(nh), topic_(nh.resolveName(topic)), queue_size_(queue_size), on_message_(std::move(on_message)) {
  const EventMessageType* type = TypeFor(topic_);
  Subscribe(type ? *type : KnownTypes().front());
  if (type) return;
  timer_ = nh_.createWallTimer(ros::WallDuration(0.5), [this](const ros::WallTimerEvent&) { CheckType(); });
}

void EventSource::Subscribe(const EventMessageType& type) {
  if (type.name == type_) return;
  type_ = type.name;
  // roscpp refuses two types of different md5 on one topic within a process.
  subscriber_.shutdown();
  subscriber_ = type.subscribe(nh_, topic_, queue_size_, on_message_);
}

void EventSource::CheckType() {
  // Messages of a publisher that has just come may be here already, as copies.
  if (const EventMessageType* type = TypeFor(topic_)) {
    Subscribe(*type);
    timer_.stop();
  }
}

}  // namespace devo
