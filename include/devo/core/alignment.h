// SPDX-License-Identifier: BSD-3-Clause
//
// 3D-2D edge alignment (paper eq. 6-8): the pose that brings the map's points onto the surface's edges.
#pragma once

#include <vector>

#include "devo/core/camera.h"
#include "devo/core/local_map.h"
#include "devo/core/options.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// Root of the information of a start about which nothing is known: keeps the equations solvable, no more.
constexpr double kNoPrior = 1e-3;

/// What the motion so far says of the pose, as a Gaussian about the start of the alignment.
struct PosePrior {
  Rigid3 T_event_ref;                            ///< its mean
  Matrix6d sqrt_information = Matrix6d::Zero();  ///< of a perturbation in the event frame (Exp(xi) * T); zero: no prior
  Eigen::Matrix3d position_covariance = Eigen::Matrix3d::Zero();  ///< m^2, of that perturbation's rho; zero: exact
  /// Cholesky factor of the covariance of the velocity [v; omega] of and in the event frame, m/s and rad/s; zero:
  /// exact.
  Matrix6d sqrt_velocity_covariance = Matrix6d::Zero();
  bool doubt_normals = false;  ///< what the noise of edges' normals makes of motion along them is not to be believed
};

struct AlignmentResult {
  Rigid3 T_event_ref;
  Matrix6d information =
      Matrix6d::Zero();  ///< J'J of the points, of a right perturbation [rho; phi] in the frame `ref`
  /// What of it is left beyond what the noise of edges' normals makes of motion along them, where the prior doubts
  /// them; else all.
  Matrix6d credible_information = Matrix6d::Zero();
  double cost = 0;              ///< mean robust cost per point, with all of the truncation
  int visible = 0;              ///< points expected in the image
  int matched = 0;              ///< of these, on an edge to within the truncation and of fitting direction
  double inlier_share = 0;      ///< matched / visible, each point counted by how much its motion should show;
                                ///< 0 where fewer than 30 matched: a handful matches by chance
  double mean_residual_px = 0;  ///< mean absolute residual of the matched
  int iterations = 0;
};

/// Minimises sum rho(field(W(W(x; dtheta); theta))^2), forward compositional: dtheta = [rho; phi] acts on
/// the points in the frame `ref`, T_event_ref <- T_event_ref * Exp(dtheta). From coarse to fine: with all of the
/// truncation, then with half of it. `velocity_event` tells which edges can be seen: one that moves along itself makes
/// no events. `camera` is the undistorted event image's.
AlignmentResult Align(const std::vector<MapPoint>& points, const Surface& surface, const Camera& camera,
                      const PosePrior& prior, const Vector6d& velocity_event, const OdometryOptions& options);

}  // namespace devo
