// SPDX-License-Identifier: BSD-3-Clause
//
// Of which type a topic is, learnt from its first message.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/serialization.h>
#include <topic_tools/shape_shifter.h>
#include <boost/make_shared.hpp>
#include <boost/shared_ptr.hpp>

namespace devo {

/// Listens to a topic in any type, so that nothing asks the master again and again and no type is guessed: roscpp
/// refuses a second one on a topic within a process, and whoever is there with the right one would be stopped by ours.
class TopicProbe {
 public:
  using OnMessage = std::function<bool(const topic_tools::ShapeShifter&)>;

  /// `on_message` gets the first message, on the callback queue of `nh`, and returns whether it is served, by a
  /// subscription in the message's type; if not, it gets another one a second later.
  TopicProbe(const ros::NodeHandle& nh, const std::string& topic, OnMessage on_message);

  /// `on_message` is not called any more, nor is it running.
  ~TopicProbe();

  TopicProbe(const TopicProbe&) = delete;
  TopicProbe& operator=(const TopicProbe&) = delete;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

/// The content as a message of the same layout (md5), whichever package's it is. Throws ros::serialization's exception
/// where the bytes are not one.
template <typename Message>
boost::shared_ptr<const Message> ContentAs(const topic_tools::ShapeShifter& any) {
  std::vector<std::uint8_t> bytes(any.size());
  ros::serialization::OStream writer(bytes.data(), any.size());
  any.write(writer);
  ros::serialization::IStream reader(bytes.data(), any.size());
  const auto message = boost::make_shared<Message>();
  ros::serialization::deserialize(reader, *message);
  return message;
}

}  // namespace devo
