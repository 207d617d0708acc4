// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "devo/core/rigid3.h"

namespace devo {

/// Two poses that are farther apart, squared, over what may be (four standard deviations), can hardly be the same.
inline constexpr double kHardlyTheSame = 16;

/// Where the event camera was at the time of a depth image, as the image's geometry shows it.
struct DepthPose {
  std::int64_t t_ns = 0;    ///< when events show that moment, as far as the delays are known
  std::uint64_t epoch = 0;  ///< of the surfaces at that time
  int chapter = 0;          ///< of the map in whose world the pose is
  Rigid3 T_world_event;
  /// On a right perturbation [rho; phi] (m, rad) of T_world_event; none in directions that the image leaves open.
  Matrix6d information = Matrix6d::Zero();
  /// How that perturbation grows per second by which depth images are later than thought, m/s and rad/s.
  Vector6d per_delay = Vector6d::Zero();
  double delay_sigma_s = 0;  ///< how well that delay was known

  /// Share of the squared error that the images after it have, too: 1 of what a sensor gets wrong, 0 of noise.
  double shared_share = 1;

  /// Where it contradicts the pose by events: aligned from that one's other side, too, the image comes to this place.
  /// One that is aligned to a wrong place has stopped on its way from where it began.
  bool confirmed = false;

  /// How far a pose with this covariance (of a right perturbation, m and rad) is from this one: squared, over what may
  /// be, the delay's uncertainty included; 6 in the mean where they are the same.
  double SquareApart(const Rigid3& T_world_other, const Matrix6d& covariance) const;
  /// Whether that is more than kHardlyTheSame.
  bool Contradicts(const Rigid3& T_world_other, const Matrix6d& covariance) const;
  /// Of a right perturbation [rho; phi] (m, rad) of T_world_event; 1 m and rad in directions that the image leaves
  /// open.
  Matrix6d Covariance() const;
  /// The same with what is not known of the delay.
  Matrix6d CovarianceOfPlace() const;
  /// False where a direction is open, as along a wall: there the pose is only what it was predicted to be.
  bool KnowsAllDirections() const;
  /// Projection of such a perturbation, in m and rad, on the directions that the image knows; the identity where it
  /// knows all.
  Matrix6d KnownDirections() const;
};

/// What tracking will make of a pose with this covariance (of a right perturbation, m and rad) once it has heard of the
/// depth: a weighted mean. Where the two contradict each other the same, or the depth's if that is confirmed.
Rigid3 Corrected(const Rigid3& T_world_event, const Matrix6d& covariance, const DepthPose& depth);

}  // namespace devo
