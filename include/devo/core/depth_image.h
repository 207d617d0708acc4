// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <opencv2/core/mat.hpp>

namespace devo {

/// From its exposure until it has become a map a depth image takes less, its driver included: surfaces and poses are
/// kept for so long.
constexpr double kMaxDepthLatency_s = 0.3;

/// A depth image of the depth camera, raw (distorted), as the odometry takes it.
struct DepthImage {
  std::int64_t t_ns = 0;  ///< time of the exposure's middle, on the event camera's clock
  cv::Mat1f depth_m;      ///< distance along the optical axis in metres; 0 where there is no measurement
};

/// The depth of a raw reading, or 0 when it is not a measurement (REP-117: NaN, infinite, out of range).
inline float ValidDepthOrZero(float z_m, float min_m, float max_m) {
  return (z_m >= min_m && z_m <= max_m) ? z_m : 0.0F;
}

}  // namespace devo
