// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "devo/core/depth_cells.h"

namespace devo {

/// Groups the cells by what they are on: what hangs together in depth once the view's large or wide smooth surfaces
/// (floor, walls, table tops) are taken out is a thing, be it furniture or somebody who walks by. Fills in `thing` of
/// each cell and `things`, from all else but `median_m`.
void FindThings(DepthCells* cells);

}  // namespace devo
