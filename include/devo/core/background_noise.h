// SPDX-License-Identifier: BSD-3-Clause
//
// How many events the background makes by itself, in the quietest parts of the image and in each that shows nothing
// else.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "devo/core/event.h"
#include "devo/core/needed_neighbours.h"
#include "devo/core/pixel_memory.h"

namespace devo {

/// Not thread-safe.
class BackgroundNoise {
 public:
  /// `period_s`: the longest between two calls of ForgetPassed() while events come.
  BackgroundNoise(int width, int height, double period_s);

  /// Of `judged` events, `count` passed: those of `events` at the positions `passed`.
  void CountPassed(std::size_t judged, const Event* events, const std::uint32_t* passed, std::size_t count);
  /// Counts them from zero again, as the pixels' events.
  void ForgetPassed();

  /// From the events of the last `span_s`, by `t_ns`, of which those passed that had the neighbours needed.
  void Measure(const PixelMemory& memory, std::int64_t t_ns, double span_s, const NeededNeighbours& needed);

  /// Of the quietest parts, events per pixel and second; 0 before the first measurement.
  double hz() const { return hz_; }
  double on_share() const { return on_share_; }  ///< of events, how many are brighter (ON)

  /// How many per pixel and second pass, noise being as it is in each part; as in the quietest where not enough parts
  /// show nothing else.
  double MeanPassingHz(const NeededNeighbours& needed) const;

  void Clear();

 private:
  bool CountsAll() const;
  void CountPerBlock(const PixelMemory& memory);
  double QuietCount();
  void FindRates(double span_s, const NeededNeighbours& needed);

  int width_, height_;
  double most_told_;                          // events of a period
  std::vector<std::uint32_t> block_counts_;   // events per whole block of 16 x 16 pixels in the last period
  std::vector<std::uint32_t> ranked_counts_;  // the same, partly ordered; kept so that nothing is allocated
  // As block_counts_, of those that passed, and of blocks that the border cuts as well.
  std::vector<std::uint32_t> passed_counts_;
  std::uint64_t judged_ = 0;      // events since passed_counts_ began
  std::vector<double> rates_hz_;  // of the blocks that show nothing else, events per pixel and second
  double hz_ = 0, on_share_ = 0.5;
};

}  // namespace devo
