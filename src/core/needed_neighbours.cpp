// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/needed_neighbours.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

// Passing noise of this rate is a third of the least activity of a motion.
constexpr double kTolerableNoise_hz = 0.05;
// Passing noise of this rate is still little among the events of edges; lower ones cost more of the edges' own.
constexpr double kMostNoise_hz = 0.5;

}  // namespace

double ChanceOfNeighbours(int at_least, double rate_hz, std::uint32_t window_us) {
  const double none = std::exp(-rate_hz * 1e-6 * window_us);
  double term = std::pow(none, kNeighbours), below = 0;
  for (int k = 0; k < at_least; ++k) {
    below += term;
    term *= (kNeighbours - k) * (1 - none) / ((k + 1) * none);
  }
  return 1 - below;
}

double PassingHz(const NeededNeighbours& needed, double noise_hz, double on_share) {
  const auto passing_hz = [&](double rate_hz) {
    return rate_hz * ChanceOfNeighbours(needed.count, rate_hz, needed.window_us);
  };
  if (!needed.same_polarity) return passing_hz(noise_hz);
  return passing_hz(on_share * noise_hz) + passing_hz((1 - on_share) * noise_hz);
}

NeededNeighbours ChooseNeeded(const NeededNeighbours& asked, double noise_hz, double on_share, bool knows_noise) {
  NeededNeighbours needed = asked;
  if (asked.count == 0) return needed;
  const auto too_much_passes = [&](double most_hz) { return PassingHz(needed, noise_hz, on_share) > most_hz; };
  const bool one_more = !knows_noise || too_much_passes(kTolerableNoise_hz);
  needed.count = std::min(kNeighbours, asked.count + (one_more ? 1 : 0));
  // A third neighbour would take more from the edges of low resolutions. Along an edge pixels fire together and alike.
  needed.same_polarity = too_much_passes(kMostNoise_hz);
  if (!too_much_passes(kMostNoise_hz)) return needed;
  std::uint32_t longest_us = 0, too_long_us = asked.window_us;
  while (too_long_us - longest_us > 1) {
    needed.window_us = (longest_us + too_long_us) / 2;
    (too_much_passes(kMostNoise_hz) ? too_long_us : longest_us) = needed.window_us;
  }
  needed.window_us = longest_us;
  return needed;
}

}  // namespace devo
