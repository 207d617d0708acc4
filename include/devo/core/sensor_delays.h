// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>

namespace devo {

/// By how much each sensor's data are of another time than they seem to be, s, as far as estimated.
struct SensorDelays {
  /// By how much events show a motion later than it happens (latency of dark pixels), at least 0; 0 without an inertial
  /// sensor. What is shown at t + event_s happened at t.
  double event_s = 0;
  double depth_s = 0;  ///< by how much depth images are of later moments than their stamps say; see depth_time_offset_s
  double depth_sigma_s = 0;  ///< how well that is known against the events
  double inertial_s = 0;     ///< the same of an inertial sensor's readings; see imu_time_offset_s

  /// By how much later than a depth image's stamp events show its moment.
  double EventsAfterDepth_s() const { return event_s + depth_s; }
};

/// From by how much later events show a moment than the stamps of an inertial sensor's readings (0 without one) and of
/// depth images say that it was. Where two of the three agree with each other, the third is off: the median of the
/// three is right. But events are never early, so that an inertial sensor is late where they seem to be.
inline SensorDelays DelaysOf(double events_after_inertial_s, double events_after_depth_s) {
  SensorDelays delays;
  delays.event_s = std::clamp(events_after_depth_s, 0.0, std::max(0.0, events_after_inertial_s));
  delays.depth_s = events_after_depth_s - delays.event_s;
  delays.inertial_s = events_after_inertial_s - delays.event_s;
  return delays;
}

}  // namespace devo
