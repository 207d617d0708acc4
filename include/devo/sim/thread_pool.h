// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>

namespace devo::sim {

/// Runs the same function for many indices on several threads. Who gets which index is not defined, so a
/// function that writes only to what belongs to its index gives the same result for every thread count.
class ThreadPool {
 public:
  /// `threads` including the caller's; 0: one per processor.
  explicit ThreadPool(int threads);
  ~ThreadPool();

  /// Calls function(i) for i in [0, count) and returns when all are done. Rethrows the first exception.
  void ForEach(int count, const std::function<void(int)>& function);

  int threads() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace devo::sim
