// SPDX-License-Identifier: BSD-3-Clause
//
// One topic's messages out of all bags of a recording, in the order in which they were made.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "devo/ros/bag_file.h"

namespace devo {

/// A message and the bag that it lies in.
struct BagMessage {
  BagFile* bag = nullptr;
  BagEntry entry;

  const BagTopic& topic() const { return bag->topics()[entry.topic]; }
};

/// Bags that follow each other in time, as `rosbag record --split` writes them: one stream.
struct BagRun {
  std::vector<BagMessage> messages;
  std::int64_t begin_ns = 0, end_ns = 0;  ///< data time: of the first event of an array, else header.stamp
  std::string bags;                       ///< their paths, for a sentence
};

/// The runs of a topic, by their begin; bags that overlap in time are runs of their own. Of a type that begins with a
/// std_msgs/Header. Bags that do not hold the topic are left out.
std::vector<BagRun> RunsOf(const std::vector<std::unique_ptr<BagFile>>& bags, const std::string& topic);

/// What is wrong where a topic that can have one source only has two runs.
std::string ComplaintOfOverlap(const std::string& topic, const BagRun& first, const BagRun& second);

}  // namespace devo
