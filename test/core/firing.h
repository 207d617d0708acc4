// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "devo/core/neighbour_filter.h"
#include "devo/core/pixel_memory.h"

namespace devo {

/// A pixel fires, and nothing is asked for to remember it. In the order of time.
inline void Fire(std::int64_t t_ns, int x, int y, bool on, PixelMemory* memory) {
  if (!memory->has_begun()) memory->Begin(t_ns);
  memory->ForgetLongAgo(t_ns);
  const Event event{t_ns, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::uint8_t>(on)};
  std::uint32_t passed = 0;
  PassWithNeighbours(NeededNeighbours(), EventSpan(&event, 1), 0, memory, &passed);
}

}  // namespace devo
