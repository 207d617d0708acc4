// SPDX-License-Identifier: BSD-3-Clause
//
// How far the edges of a surface trail behind the edges of the scene. A pixel fires when its brightness has changed by
// the contrast threshold since it fired last, so each event comes late by up to a threshold's share of the edge's
// profile, and their mean by half of it: an edge that makes N events in each pixel lies about width / (2 N) behind,
// towards where it came from, whatever its speed. Maps made in one direction of motion and met in the other are off
// by twice that.
#pragma once

#include <algorithm>
#include <cmath>

namespace devo {

/// More than half the width of a profile no edge trails.
constexpr float kMaxEdgeLag_px = 0.5F;

/// Lag times strength, px times events: the lag of an edge of the surface is this over EdgePoint::strength
/// (EdgeLagPx), to be added along its normal. `across_px` is its motion along the normal while the surface's events
/// were gathered and `sigma_px` the standard deviation of that: of a motion that may as well be the opposite nothing
/// is said. `scale_px` is SurfaceOptions::edge_lag_px. Strength counts the events of `across_px` pixels on
/// top of each other; for less than a pixel's fraction the profile itself is what was passed.
inline float LagStrength(float across_px, float sigma_px, float scale_px) {
  constexpr float kProfile_px = 0.5F, kSigmas = 3;
  const float moved_px = std::abs(across_px) + kProfile_px;
  return scale_px * across_px * moved_px / (moved_px + kSigmas * sigma_px);
}

inline float EdgeLagPx(float lag_strength, float strength) {
  return strength > 0 ? std::clamp(lag_strength / strength, -kMaxEdgeLag_px, kMaxEdgeLag_px) : 0.0F;
}

/// The same along the edge's own normal, whose cosine with the normal that `lag_strength` is for is given.
inline float EdgeLagAlongEdgePx(float lag_strength, float strength, float cosine) {
  const float lag = EdgeLagPx(lag_strength, strength);
  return cosine < 0 ? -lag : lag;
}

}  // namespace devo
