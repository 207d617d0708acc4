// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "devo/ros/bag_reader.h"

namespace devo {

/// The items of a reader in the same order, read by a thread of its own while the caller computes.
class ReadAhead {
 public:
  struct Item {
    BagItem item;
    double progress;
  };

  /// `threaded` false: read in Next(). The reader is the thread's until this object is destroyed.
  ReadAhead(BagReader* reader, bool threaded);
  ~ReadAhead();

  /// Empty at the end. Throws what the reader threw, after the items before it.
  std::optional<Item> Next();

 private:
  std::optional<Item> Read();
  void Work();

  BagReader* reader_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> queue_;
  bool finished_ = false, stop_ = false;
  std::exception_ptr error_;
  std::thread thread_;
};

}  // namespace devo
