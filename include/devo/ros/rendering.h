// SPDX-License-Identifier: BSD-3-Clause
//
// Pictures for people: what the odometry sees, drawn only when somebody looks.
#pragma once

#include <string>
#include <vector>

#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/core/local_map.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// Nearest to farthest: red to blue, on a scale of inverse depth between the given distances (metres).
cv::Vec3b DepthColour(double depth_m, double nearest_m, double farthest_m);

/// The map's points at their place in the surface, coloured by depth, on the surface in grey. They lie on its crests
/// when tracking is right. `camera`: undistorted event camera.
cv::Mat3b RenderReprojection(const Surface& surface, const LocalMap& map, const Rigid3& T_event_ref,
                             const Camera& camera);

/// The depth image moved into the undistorted event image, coloured by depth, with the surface's edges in white on it:
/// they lie on the steps of the depth when calibration and time offset are right. `rays`: RayTable of the depth camera,
/// which takes longer than the picture; `camera`: undistorted event camera.
cv::Mat3b RenderDepthOverlay(const Surface& surface, const DepthImage& depth, const cv::Mat2f& rays,
                             const Rigid3& T_event_depth, const Camera& camera);

/// 8-bit, one channel (mono8) or three (bgr8).
sensor_msgs::ImagePtr ToImageMsg(const cv::Mat& image, std::int64_t t_ns, const std::string& frame_id);

/// Points transformed by `T`, with fields x, y, z and intensity (id of the reference).
sensor_msgs::PointCloud2Ptr ToPointCloudMsg(const std::vector<MapPoint>& points, const Rigid3& T, std::int64_t t_ns,
                                            const std::string& frame_id);

}  // namespace devo
