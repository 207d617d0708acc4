// SPDX-License-Identifier: BSD-3-Clause
//
// Areas that see a lamp flicker: they fire as one, over and over.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "devo/core/pixel_memory.h"

namespace devo {

/// Not thread-safe.
class FlickerDetector {
 public:
  FlickerDetector(int width, int height);

  /// At the end of each period, which was `span_s` long, by `t_ns`: an area is found from the second one on.
  void Find(const PixelMemory& memory, std::int64_t t_ns, double span_s);

  /// The pixels that were found, some more than once.
  const std::vector<std::uint32_t>& pixels() const { return pixels_; }

  void Clear();

 private:
  void AddPixelsOf(const PixelMemory& memory, std::size_t corner, std::uint32_t least, std::int64_t ticks,
                   char* suspected);

  std::vector<std::uint32_t> pixels_;
  // Per area of 16 x 16 pixels, every 8: whether it looked like flicker in the last period.
  std::vector<char> suspected_;
};

}  // namespace devo
