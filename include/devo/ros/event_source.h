// SPDX-License-Identifier: BSD-3-Clause
//
// The events topic, whichever of the message layouts it carries, in whichever package's C++ type.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <boost/shared_ptr.hpp>

#include "devo/ros/message_conversion.h"
#include "devo/ros/topic_probe.h"

namespace devo {

/// A message as it came, shared with its publisher.
struct EventMessage {
  boost::shared_ptr<const void> message;
  std::size_t num_events = 0;  ///< for packets, which are compressed, about: known once they are decoded
  /// Appends its events. `packets` keeps what decoding packets needs of those before. Throws std::runtime_error naming
  /// an encoding that is not known.
  std::function<void(EventPacketConverter* packets, std::vector<Event>* events)> append;
  ros::WallTime arrival;
  bool after_loss = false;   ///< messages before it were dropped
  bool after_pause = false;  ///< messages before it were not wanted
};

/// Subscribes in the C++ type of the topic's publisher, as its first message names it, so that within one process the
/// publisher's object comes without a copy from the second message on: EventArray and EventPacket of this package and,
/// where they were there when this was built, of dvs_msgs, prophesee_event_msgs and event_camera_msgs. Any other
/// package's messages of the same md5 come as this package's. What is neither is named in the log and left out.
class EventSource {
 public:
  EventSource(const ros::NodeHandle& nh, const std::string& topic, int queue_size,
              std::function<void(EventMessage)> on_message);

 private:
  bool Subscribe(const topic_tools::ShapeShifter& first);  ///< false where that cannot be, which it says in the log

  ros::NodeHandle nh_;
  std::string topic_;
  int queue_size_;
  std::function<void(EventMessage)> on_message_;
  ros::Subscriber subscriber_;
  TopicProbe probe_;  // last: it ends before what it sets
};

}  // namespace devo
