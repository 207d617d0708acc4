// SPDX-License-Identifier: BSD-3-Clause
//
// Whether depth and surfaces are of one time: stamps of another clock are the usual reason for a map that never begins.
#pragma once

#include <cstdint>
#include <string>

namespace devo {

/// Depth far older or newer than the surfaces is not of their time; it may be when they get there.
bool IsOfTheirTime(std::int64_t depth_ns, std::int64_t surface_ns);

/// Empty where it is; else a sentence with the seconds between them and what to check.
std::string ComplaintOfDepthClock(std::int64_t depth_ns, std::int64_t surface_ns);

}  // namespace devo
