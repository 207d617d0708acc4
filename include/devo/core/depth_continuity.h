// SPDX-License-Identifier: BSD-3-Clause
//
// Tells when a depth camera has begun to see otherwise: a Kinect v1 corrects its own calibration while it runs, and
// from one image to the next a wall leans by a degree and stays so. What it sees of a motion before and after is right.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class DepthContinuity {
 public:
  /// Of one depth image.
  struct Image {
    std::int64_t t_ns;
    Rigid3 T_world_tracked;  ///< of the event camera as it was tracked
    Rigid3 T_world_depth;    ///< as the image shows it
    Matrix6d information;    ///< of the image, on a right perturbation [rho; phi] (m, rad) of T_world_depth
  };
  enum class Verdict {
    kSteady,
    kDoubtful,  ///< it moved as the camera did not: by the next image it is known which of them was wrong
    kJumped,    ///< the image before did, this one goes on from there as the camera does
  };
  /// Images in the order of their time, all compared with the same keyframe; others begin with Reset().
  Verdict Judge(const Image& image);

  void Reset() { *this = DepthContinuity(); }

 private:
  /// Squared, by `information`: what the image moved otherwise than the camera was tracked since the last.
  double Apart(const Image& image) const;
  /// Squared: what the camera was tracked to move otherwise than it moved before.
  double Unsteady(const Image& image) const;
  void Note(const Image& image, double apart);
  double Usual() const;  // there are some

  std::optional<Image> last_;
  Vector6d velocity_ = Vector6d::Zero();  // [v; omega], m/s and rad/s, as tracked up to the last image
  std::deque<double> apart_;              // of the last images, as far as the tracking was not to blame
  std::optional<double> doubted_;         // how far apart the last image is, if it is doubtful
};

}  // namespace devo
