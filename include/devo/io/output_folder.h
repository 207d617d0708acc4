// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace devo {

/// Makes the folder that results are written to, and those above it, unless they are there. Throws std::runtime_error
/// naming it and why it cannot be made, or that nothing can be written there.
void MakeOutputFolder(const std::string& path);

}  // namespace devo
