// SPDX-License-Identifier: BSD-3-Clause
//
// How the position of a map point gets better with each view that sees its edge: a Kalman filter for each point (a
// depth filter, as in Forster et al., "SVO", T-RO 2017, section V), of the two things that the view that made it left
// uncertain. Along the edge nothing is ever measured, nor needed. Depth is kept as its inverse, in which the error of a
// guess is as likely to either side (Civera et al., "Inverse depth parametrization for monocular SLAM", T-RO 2008).
#pragma once

#include <Eigen/Core>

#include "devo/core/camera.h"
#include "devo/core/local_map.h"

namespace devo {

/// Of a point's position across its edge, px in the view that made it, and of its inverse depth there, as a share.
struct PointCovariance {
  float across;
  float across_depth;
  float depth;
};

/// Of a point that was seen by one view, with a depth that was measured, or guessed.
PointCovariance CovarianceOfNewPoint();
PointCovariance CovarianceOfGuessedPoint();

/// Standard deviation across the edge, px.
float SigmaAcross(const PointCovariance& covariance);

/// Standard deviation of the inverse depth, as a share of it.
float SigmaDepthShare(const PointCovariance& covariance);

/// An edge that a point met in another view.
struct PointSighting {
  Eigen::Matrix3f R_event_ref;  ///< from the view that made the point
  /// ImageVelocityAlong the edge's normal, of the point in this view.
  Eigen::Matrix<float, 6, 1> px_per_motion;
  float distance_px;  ///< from the edge to the point's image, along the normal
  float weight;       ///< 0..1; 1: as clear a match as there is
};

/// Moves a point towards an edge that it met. Errors of different views are taken to be independent.
/// `camera`: of the undistorted event image.
void RefinePoint(const PointSighting& sighting, const Camera& camera, MapPoint* point, PointCovariance* covariance);

}  // namespace devo
