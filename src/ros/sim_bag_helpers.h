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

/// A bag that has its name once it is complete; until then it is PATH.active, as rosbag record has it. What cannot be
/// written, as on a full disk, is thrown as std::runtime_error naming the file.
class SimBag {
 public:
  /// Once, before all else; removes what has the name.
  void Open(const std::string& path, rosbag::CompressionType compression);
  template <typename Message>
  void Write(const std::string& topic, const ros::Time& time, const Message& message) {
    try {
      bag_->write(topic, time, message);
    } catch (const rosbag::BagException& e) {
      ThrowCannotBeWritten(e.what());
    }
  }
  void Close();

 private:
  /// rosbag::Bag closes in its destructor, where throwing ends the program.
  struct CloseOrLeak {
    void operator()(rosbag::Bag* bag) const noexcept;
  };
  std::string ActivePath() const { return path_ + ".active"; }
  [[noreturn]] void ThrowCannotBeWritten(const std::string& reason) const;

  std::string path_;
  std::unique_ptr<rosbag::Bag, CloseOrLeak> bag_;
};

ros::Time SimStamp(std::int64_t t_ns);
/// Throws std::runtime_error naming the file.
void WriteSimText(const std::string& path, const std::string& text);

std::unique_ptr<SimBagWriter> MakeMvsecWriter(const std::string& stem, const sim::Sequence& sequence,
                                              const sim::Sequence* right);
std::unique_ptr<SimBagWriter> MakeVectorWriter(const std::string& stem, const sim::Sequence& sequence);

}  // namespace devo
