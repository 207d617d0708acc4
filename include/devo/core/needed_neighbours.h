// SPDX-License-Identifier: BSD-3-Clause
//
// How many neighbours an event needs to be signal, by how much noise would have as many by chance.
#pragma once

#include <cstdint>

namespace devo {

/// Of a pixel.
inline constexpr int kNeighbours = 8;

/// Of an event's neighbours.
struct NeededNeighbours {
  int count = 0;                ///< 0: every event passes
  std::uint32_t window_us = 0;  ///< how recently they must have fired
  bool same_polarity = false;   ///< they must have been of the event's polarity, too
};

/// That at least so many of eight neighbours fired within the window, at `rate_hz` each. Binomial: a neighbour did or
/// did not, however often.
double ChanceOfNeighbours(int at_least, double rate_hz, std::uint32_t window_us);

/// Of noise of so many events per pixel and second, `on_share` of them brighter (ON), how many pass.
double PassingHz(const NeededNeighbours& needed, double noise_hz, double on_share);

/// What is needed beyond what is asked for (of either polarity): one neighbour more where so much noise would often
/// have them by chance or is not known yet; where more than 0.5 Hz would pass all the same, of the same polarity and
/// within a shorter window.
NeededNeighbours ChooseNeeded(const NeededNeighbours& asked, double noise_hz, double on_share, bool knows_noise);

}  // namespace devo
