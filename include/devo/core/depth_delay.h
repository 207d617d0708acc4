// SPDX-License-Identifier: BSD-3-Clause
//
// By how much later than a depth image's stamp events show its moment: the depth's clock and exposure and the events'
// latency, together. What an inertial sensor says of the events' delay says something of it as long as depth has not
// itself been compared with the events; from then on it is known from that, whatever the inertial sensor's clock.
#pragma once

#include <algorithm>

#include "devo/core/delay.h"

namespace devo {

class DepthDelay {
 public:
  /// s; `event_delay_s`: by how much events are later than an inertial sensor, as far as known; 0 without one.
  double Get(double event_delay_s) const { return own_s_ + event_share_ * event_delay_s; }
  double variance_s2() const { return variance_s2_; }

  /// Without end where no image agrees, it would hide every contradiction along the motion.
  void Wander(double span_s) {
    variance_s2_ = std::min(variance_s2_ + kDelayWalk_s * kDelayWalk_s * span_s, kMostSigma_s * kMostSigma_s);
  }

  /// `full_step_s`: of a full update; `known`: the share of the variance that this would take away, 0..1.
  void Step(double full_step_s, double known, double event_delay_s) {
    // What one image shows clearly is no error that many share.
    const double step = kStep + (1 - kStep) * known, drop = DropOfStep(step) * known;
    const double share = event_share_ * (1 - drop);
    own_s_ += (event_share_ - share) * event_delay_s;
    event_share_ = share;
    own_s_ = StepDelay(Get(event_delay_s), step * full_step_s, kMax_s) - event_share_ * event_delay_s;
    variance_s2_ *= 1 - drop;
  }

 private:
  static constexpr double kStep = 0.3, kMax_s = 0.05, kMostSigma_s = 2 * kDelaySigma_s;

  double own_s_ = 0, event_share_ = 1, variance_s2_ = kDelaySigma_s * kDelaySigma_s;
};

}  // namespace devo
