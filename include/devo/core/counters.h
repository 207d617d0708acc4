// SPDX-License-Identifier: BSD-3-Clause
//
// What came in, and what became of it, since the beginning.
#pragma once

#include <cstdint>
#include <string>

namespace devo {

struct SurfaceCounters {
  std::uint64_t in = 0;         ///< events given to SurfaceBuilder::Insert
  std::uint64_t outside = 0;    ///< of these, outside the image
  std::uint64_t unordered = 0;  ///< of these, older than one before
  std::uint64_t of_lamps = 0;   ///< of these, of lamps that flicker
  std::uint64_t noise = 0;      ///< of these, isolated or from hot pixels
  std::uint64_t used = 0;       ///< events accumulated in surfaces (one event may serve several)
};

/// What the light does to the events, in a sentence; empty where it is little.
std::string LampComplaint(const SurfaceCounters& counters);

struct MappingCounters {
  std::uint64_t depth_in = 0;             ///< depth images or sweeps added
  std::uint64_t depth_used = 0;           ///< of these, met with a surface and a pose
  std::uint64_t depth_aligned = 0;        ///< images aligned to an earlier one
  std::uint64_t depth_without_thing = 0;  ///< images aligned without a thing that seems to have moved by itself
  std::uint64_t depth_jumps = 0;          ///< how often the depth camera began to see otherwise than before
  std::uint64_t depth_repeated = 0;       ///< images that had come before, with another stamp
  std::uint64_t depth_without_valid_pixel = 0;
  std::uint64_t depth_too_late = 0;  ///< images and sweeps that came when surfaces of their time were kept no longer
  std::uint64_t references = 0;
};

}  // namespace devo
