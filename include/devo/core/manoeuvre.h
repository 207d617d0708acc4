// SPDX-License-Identifier: BSD-3-Clause
//
// How far the camera's accelerations reach of late, so that a calm motion is not taken for one that may turn round at
// any moment, and a fast one, which the prior would lag behind, not for one that goes on (a filter's process noise from
// its innovations: Mehra, "On the identification of variances and adaptive Kalman filtering", 1970; the scale for
// acceleration alone: Zhou and Frank, "Strong tracking filtering", 1996).
#pragma once

namespace devo {

class Manoeuvre {
 public:
  /// One pose, `dt_s` after the last. `moved_square`: how far it was from the prediction, squared, over what was stated
  /// of that with variance_share(). `acceleration_square`: the accelerations found, squared, over the options'
  /// variance.
  void Note(double dt_s, double moved_square, double acceleration_square);

  /// Of the variance of accelerations that options have, a sixteenth to four times; 1 before anything is known. More
  /// than 1 only by accelerations that were found.
  double variance_share() const { return share_; }

  /// Nothing is known of the motion to come.
  void Reset() { share_ = 1; }

 private:
  double share_ = 1;
};

}  // namespace devo
