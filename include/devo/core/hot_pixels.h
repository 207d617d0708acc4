// SPDX-License-Identifier: BSD-3-Clause
//
// Pixels that fire at a rate that their neighbours do not share.
#pragma once

#include <cstdint>
#include <vector>

#include "devo/core/pixel_memory.h"

namespace devo {

/// Those that were more than so many times as active in this period as their neighbours, and had a few events at all;
/// none where `factor` is 0. What `hot` held is forgotten.
void FindHotPixels(const PixelMemory& memory, double factor, std::vector<std::uint32_t>* hot);

}  // namespace devo
