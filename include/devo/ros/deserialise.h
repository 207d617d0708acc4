// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <ros/serialization.h>

#include "devo/ros/bag_file.h"

namespace devo {

/// The message that a bag's record holds. Throws ros::serialization::StreamOverrunException when it is cut short.
template <typename Message>
Message Deserialise(const ByteSpan& bytes) {
  Message message;
  ros::serialization::IStream stream(const_cast<std::uint8_t*>(bytes.data), static_cast<std::uint32_t>(bytes.size));
  ros::serialization::deserialize(stream, message);
  return message;
}

}  // namespace devo
