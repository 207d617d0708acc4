// SPDX-License-Identifier: BSD-3-Clause
//
// How large errors are against what covariances state, by how two sensors' estimates of the same poses come apart over
// the span of a relative pose. What is wrong alike all the time (a mounting, a delay) is not counted; what differs from
// recording to recording and no sensor knows of itself (dark pixels' latency, noise, a scene's depth) is (covariance
// matching: Mehra, "Approaches to adaptive filtering", 1972).
#pragma once

#include <cstdint>
#include <deque>

#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class ErrorScale {
 public:
  /// `apart`: right perturbation [rho; phi] (m, rad) from one estimate of a moment's pose to the other; `stated`: its
  /// covariance. In the order of time.
  void Note(std::int64_t t_ns, const Vector6d& apart, const Matrix6d& stated);

  /// Of variances; kFirstScale before anything is known.
  double variance_scale() const;

 private:
  /// What is stated is cautious (it counts what a motion might have done).
  static constexpr double kFirstScale = 0.28;

  struct Difference {
    std::int64_t t_ns;
    Vector6d apart;
  };
  std::deque<Difference> past_;
  double known_s_ = 0, scale_ = kFirstScale;
};

}  // namespace devo
