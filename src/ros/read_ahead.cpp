// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/read_ahead.h"

namespace devo {
namespace {
constexpr std::size_t kQueueSize = 32;  // items; a depth image is 1.5 MB
}

ReadAhead::ReadAhead(BagReader* reader, bool threaded) : reader_(reader) {
  if (threaded) thread_ = std::thread(&ReadAhead::Work, this);
}

ReadAhead::~ReadAhead() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

std::optional<ReadAhead::Item> ReadAhead::Read() {
  auto item = reader_->Next();
  if (!item) return std::nullopt;
  return Item{std::move(*item), reader_->progress()};
}

void ReadAhead::Work() {
  std::exception_ptr error;
  try {
    while (auto item = Read()) {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return stop_ || queue_.size() < kQueueSize; });
      if (stop_) return;
      queue_.push_back(std::move(*item));
      lock.unlock();
      changed_.notify_all();
    }
  } catch (...) {
    error = std::current_exception();
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  error_ = error;
  finished_ = true;
  changed_.notify_all();
}

std::optional<ReadAhead::Item> ReadAhead::Next() {
  if (!thread_.joinable()) return Read();
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return finished_ || !queue_.empty(); });
  if (queue_.empty()) {
    if (error_) std::rethrow_exception(error_);
    return std::nullopt;
  }
  Item item = std::move(queue_.front());
  queue_.pop_front();
  lock.unlock();
  changed_.notify_all();
  return item;
}

}  // namespace devo
