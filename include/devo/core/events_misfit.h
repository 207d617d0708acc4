// SPDX-License-Identifier: BSD-3-Clause
//
// Without an inertial sensor nothing but depth says that poses by events are false: in the dark, or where somebody who
// walks by fills the view, enough of them matches for a pose that is stated surely, and that is centimetres off until
// the next depth image. By how much they err is told by these images, as a sensor's noise is by its innovations (Sage
// and Husa, "Adaptive filtering with unknown prior statistics", 1969).
#pragma once

#include <cstdint>

namespace devo {

/// Depth images that follow each other within this time, in seconds, tell where the camera is whatever events say: over
/// a longer one what is known of the velocity leads farther astray than false events do.
inline constexpr double kInQuickSuccession_s = 0.08;

/// Not thread-safe.
class EventsMisfit {
 public:
  /// Of a depth image of this time, in the order of time. `square`: of the way from the pose by events to that by
  /// depth, over what is stated of both: 6 in the mean where that is right. `believed`: else depth may be wrong, and
  /// the image says at most that events are right. Those that do not come in quick succession say nothing, nor do those
  /// that come out of order or whose square is not finite.
  void Note(std::int64_t t_ns, double square, bool believed);

  /// Squared errors of poses by events at this time over what is stated of them; at least 1, and less and less where
  /// no image comes any more.
  double TimesAt(std::int64_t t_ns) const;

 private:
  double mean_ = 0;  // of squares over what they are in the mean
  std::int64_t noted_ns_ = 0;
};

}  // namespace devo
