// SPDX-License-Identifier: BSD-3-Clause
//
// What the writers of all dialects share. Internal to ros.
#pragma once

#include <memory>
#include <string>

#include <ros/time.h>
#include <rosbag/bag.h>

#include "devo/ros/sim_bag_writer.h"

namespace devo {

ros::Time SimStamp(std::int64_t t_ns);
/// Throws std::runtime_error naming the file.
void OpenSimBag(const std::string& path, rosbag::compression::CompressionType compression, rosbag::Bag* bag);
void WriteSimText(const std::string& path, const std::string& text);

std::unique_ptr<SimBagWriter> MakeMvsecWriter(const std::string& stem, const sim::Sequence& sequence,
                                              const sim::Sequence* right);
std::unique_ptr<SimBagWriter> MakeVectorWriter(const std::string& stem, const sim::Sequence& sequence);

}  // namespace devo
