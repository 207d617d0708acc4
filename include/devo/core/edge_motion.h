// SPDX-License-Identifier: BSD-3-Clause
//
// How a static 3D edge moves through the image, and whether its motion makes events.
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// An edge that moved less than this across itself while a surface's events were gathered shows no clear polarity.
constexpr float kClearMotion_px = 0.3F;

/// Mean polarity beyond which an edge's events speak for one direction of its motion.
constexpr float kClearPolarity = 0.4F;

/// Pixels per second of a static point `p_event` (m, event frame) seen by a camera of velocity [v; omega].
inline Eigen::Vector2f ImageVelocity(const Vector6d& velocity_event, const Eigen::Vector3f& p_event,
                                     const Camera& camera) {
  const Eigen::Vector3f v = velocity_event.head<3>().cast<float>(), omega = velocity_event.tail<3>().cast<float>();
  const Eigen::Vector3f p_dot = -v - omega.cross(p_event);
  const float inverse_z = 1 / p_event.z();
  return {static_cast<float>(camera.fx()) * (p_dot.x() - p_event.x() * inverse_z * p_dot.z()) * inverse_z,
          static_cast<float>(camera.fy()) * (p_dot.y() - p_event.y() * inverse_z * p_dot.z()) * inverse_z};
}

/// What ImageVelocity gives along `normal`, as a linear form of the velocity [v; omega], px per m and per rad.
inline Eigen::Matrix<float, 6, 1> ImageVelocityAlong(const Eigen::Vector2f& normal, const Eigen::Vector3f& p_event,
                                                     const Camera& camera) {
  const float inverse_z = 1 / p_event.z();
  const float a = static_cast<float>(camera.fx()) * inverse_z * normal.x();
  const float b = static_cast<float>(camera.fy()) * inverse_z * normal.y();
  const Eigen::Vector3f g(a, b, -(a * p_event.x() + b * p_event.y()) * inverse_z);
  Eigen::Matrix<float, 6, 1> along;
  along.head<3>() = -g;
  along.tail<3>() = g.cross(p_event);
  return along;
}

/// Normal of an edge in the image of a camera, from its normal in the view that made it (z = 0 there): the edge's
/// tangent is taken as parallel to that view's image plane. `p_event`: the point in the camera, R = R_event_ref.
inline Eigen::Vector2f ProjectNormal(const Eigen::Vector3f& normal_ref, const Eigen::Matrix3f& R_event_ref,
                                     const Eigen::Vector3f& p_event) {
  const Eigen::Vector3f tangent = R_event_ref * Eigen::Vector3f(-normal_ref.y(), normal_ref.x(), 0);
  const Eigen::Vector2f along = tangent.head<2>() - p_event.head<2>() / p_event.z() * tangent.z();
  const float norm = along.norm();
  return norm > 1e-3F ? Eigen::Vector2f(along.y() / norm, -along.x() / norm) : Eigen::Vector2f::Zero();
}

/// Share (0.1 to 1) of its usual events that an edge makes which moved `across_px` across itself: an edge makes
/// events once its blurred profile, about two pixels wide, has begun to pass a pixel.
inline float VisibilityOfMotion(float across_px) { return std::clamp(std::abs(across_px), 0.1F, 1.0F); }

}  // namespace devo
