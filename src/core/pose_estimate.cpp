// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/pose_estimate.h"

namespace devo {

const char* ToString(TrackingState state) {
  switch (state) {
    case TrackingState::kInitialising: return "initialising";
    case TrackingState::kTracking: return "tracking";
    case TrackingState::kDegraded: return "degraded";
    case TrackingState::kLost: return "lost";
    case TrackingState::kRecovered: return "recovered";
  }
  return "unknown";
}

}  // namespace devo
