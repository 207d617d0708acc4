// SPDX-License-Identifier: BSD-3-Clause
//
// The test of each event, millions per second: whether enough of its neighbours fired shortly before it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "devo/core/event.h"
#include "devo/core/needed_neighbours.h"
#include "devo/core/pixel_memory.h"

namespace devo {

/// Writes the positions, counted from `position`, of those events that have the neighbours they need and whose pixel is
/// not hot to `passed`, which has room for all, and returns how many there are. `memory`, which has begun, remembers
/// them all. They must lie in the image and come in the order of their time, before its next_forgetting_ns().
std::size_t PassWithNeighbours(const NeededNeighbours& needed, EventSpan events, std::uint32_t position,
                               PixelMemory* memory, std::uint32_t* passed);

}  // namespace devo
