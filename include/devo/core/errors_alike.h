// SPDX-License-Identifier: BSD-3-Clause
//
// How much an alignment tells: points on the same edges err together, those of successive surfaces, too, so that many
// of them count as one measurement.
#pragma once

#include <cstddef>

namespace devo {

/// Points of an alignment that count as one.
struct ErrorsAlike {
  double own;     ///< for what this surface errs by itself
  double shared;  ///< for what successive ones err alike; 0: that is not looked at
};

/// What an alignment is made of.
struct AlignedPoints {
  std::size_t points;      ///< of the map
  std::size_t events;      ///< of the surface
  double rate_hz;          ///< of surfaces
  double inertial_trust;   ///< 0: no inertial sensor predicted the pose, to 1: one did that errs no more than most
  bool weigh_events;       ///< TrackingIdeas
  bool has_shared_errors;  ///< TrackingIdeas
};

ErrorsAlike PointsThatErrAlike(const AlignedPoints& of);

}  // namespace devo
