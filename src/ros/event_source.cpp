// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/event_source.h"

#include <type_traits>
#include <utility>

#include <ros/console.h>
#include <ros/exception.h>
#include <ros/message_traits.h>

#include "devo/ros/event_message_types.h"

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
  std::string name, md5;
  EventMessage (*wrap)(const topic_tools::ShapeShifter& message);
  ros::Subscriber (*subscribe)(ros::NodeHandle nh, const std::string& topic, int queue_size, OnMessage on_message);
};

namespace {

template <typename Message>
EventMessageType TypeOf() {
  return {ros::message_traits::DataType<Message>::value(), ros::message_traits::MD5Sum<Message>::value(),
          [](const topic_tools::ShapeShifter& message) { return Wrap<Message>(ContentAs<Message>(message)); },
          &SubscribeTo<Message>};
}

template <typename... Messages>
std::vector<EventMessageType> TypesOf(MessageTypes<Messages...>) {
  return {TypeOf<Messages>()...};
}

const std::vector<EventMessageType>& KnownTypes() {
  static const std::vector<EventMessageType> types = TypesOf(EventMessageTypes());
  return types;
}

/// In which type to subscribe a topic: its own where that is built in, else one of the same layout; null for none.
const EventMessageType* TypeFor(const topic_tools::ShapeShifter& message) {
  const EventMessageType* same_layout = nullptr;
  for (const EventMessageType& type : KnownTypes()) {
    if (type.name == message.getDataType()) return &type;
    if (!same_layout && type.md5 == message.getMD5Sum()) same_layout = &type;
  }
  return same_layout;
}

}  // namespace

EventSource::EventSource(const ros::NodeHandle& nh, const std::string& topic, int queue_size, OnMessage on_message)
    : nh_(nh), topic_(nh.resolveName(topic)), queue_size_(queue_size), on_message_(std::move(on_message)),
      probe_(nh_, topic_, [this](const topic_tools::ShapeShifter& message) { return Subscribe(message); }) {}

bool EventSource::Subscribe(const topic_tools::ShapeShifter& first) {
  const EventMessageType* type = TypeFor(first);
  try {
    if (!type) throw ros::Exception("that is neither an EventArray nor an EventPacket");
    subscriber_ = type->subscribe(nh_, topic_, queue_size_, on_message_);
    on_message_(type->wrap(first));
    return true;
  } catch (const std::exception& error) {
    ROS_WARN_STREAM_THROTTLE(
        10, "events on " << topic_ << " are not taken as " << first.getDataType() << ": " << error.what());
    return subscriber_;
  }
}

}  // namespace devo
