// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/counters.h"

namespace devo {

std::string LampComplaint(const SurfaceCounters& counters) {
  constexpr double kTolerableShare = 0.1;
  if (static_cast<double>(counters.of_lamps) <= kTolerableShare * static_cast<double>(counters.in)) return "";
  return std::to_string(counters.of_lamps) + " of " + std::to_string(counters.in) +
         " events are of lamps that flicker; they are left out, and motion's with them: switch on the camera's "
         "anti-flicker filter, or use other light";
}

}  // namespace devo
