// SPDX-License-Identifier: BSD-3-Clause
//
// The events topic, whichever of the two message layouts it carries.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "devo/EventArray.h"
#include "devo/EventPacket.h"
#include "devo/ros/message_conversion.h"

namespace devo {

/// A message as it came, shared with its publisher: exactly one of the two is set.
struct EventMessage {
  EventArrayConstPtr array;
  EventPacketConstPtr packet;
  ros::WallTime arrival;

  /// Events in the message; for packets, which are compressed, the most that its bytes can hold.
  std::size_t MostEvents() const;
};

/// Messages to events; keeps the state that packets need.
class EventDecoder {
 public:
  /// Appends the message's events. Throws std::runtime_error naming an encoding that is not known.
  void Append(const EventMessage& message, std::vector<Event>* events);

 private:
  EventPacketConverter packets_;
};

/// Subscribes to EventArray, or to EventPacket where the master says that the topic has that type (also when its
/// publisher starts later).
class EventSource {
 public:
  EventSource(const ros::NodeHandle& nh, const std::string& topic, int queue_size,
              std::function<void(EventMessage)> on_message);

 private:
  void SubscribeTo(bool packets);
  void CheckType();

  ros::NodeHandle nh_;
  std::string topic_;
  int queue_size_;
  std::function<void(EventMessage)> on_message_;
  bool packets_ = false;
  bool arrived_ = false;
  ros::Subscriber subscriber_;
  ros::WallTimer timer_;
};

}  // namespace devo
