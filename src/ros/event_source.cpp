// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/event_source.h"

#include <type_traits>
#include <utility>

#include <ros/console.h>
#include <ros/exception.h>
#include <ros/message_traits.h>

#include "devo/ros/event_message_types.h"
#include "devo/ros/known_topics.h"

namespace devo {
namespace {

using OnMessage = std::function<void(EventMessage)>;

/// EventPacket's events are bytes.
template <typename Message>
constexpr bool kIsPacket = std::is_same_v<typename decltype(Message::events)::value_type, std::uint8_t>;

// EVT2's; EVT3's take 2.5 in dense scenes and 6.5 in sparse ones.
constexpr std::size_t kBytesPerEvent = 4;

template <typename Message>
EventMessage Wrap(const boost::shared_ptr<const Message>& message) {
  EventMessage result;
  result.message = message;
  result.arrival = ros::WallTime::now();
  if constexpr (kIsPacket<Message>) {
    result.num_events = message->events.size() / kBytesPerEvent;
    result.append = [message](EventPacketConverter* packets, std::vector<Event>* events) {
      packets->Append(*message, events);
    };
  } else {
    result.num_events = message->events.size();
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
  const auto known = AskForTopics();
  for (const ros::master::TopicInfo& info : *known) {
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
  if (Subscribe()) return;
  timer_ = nh_.createWallTimer(ros::WallDuration(0.5), [this](const ros::WallTimerEvent&) {
    if (Subscribe()) timer_.stop();
  });
}

bool EventSource::Subscribe() {
  // Not before the type is known: roscpp refuses a second type on a topic within a process, and whoever is there with
  // the right one would be stopped by ours.
  const EventMessageType* type = TypeFor(topic_);
  if (!type) return false;
  try {
    subscriber_ = type->subscribe(nh_, topic_, queue_size_, on_message_);
    return true;
  } catch (const ros::Exception& error) {
    ROS_WARN_STREAM_THROTTLE(10, "cannot subscribe to " << topic_ << " as " << type->name << ", expected one type of "
                                                        << "messages on it within this process: " << error.what());
    return false;
  }
}

}  // namespace devo
