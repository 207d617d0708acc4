// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_repeats.h"

#include <cstddef>
#include <cstring>

namespace devo {
namespace {

constexpr double kMoved = 1e-3;  // m or rad: less may be an error of the poses

bool SameReadings(const cv::Mat1f& a, const cv::Mat1f& b) {
  if (a.size() != b.size()) return false;
  const std::size_t row_bytes = static_cast<std::size_t>(a.cols) * sizeof(float);
  for (int y = 0; y < a.rows; ++y) {
    if (std::memcmp(a[y], b[y], row_bytes) != 0) return false;
  }
  return true;
}

}  // namespace

bool DepthRepeats::IsRepeat(const cv::Mat1f& depth_m, const Rigid3& T_world_event) const {
  if (last_m_.empty() || !SameReadings(depth_m, last_m_)) return false;
  return (shown_.KnownDirections() * Log(T_world_last_.inverse() * T_world_event)).norm() > kMoved;
}

void DepthRepeats::Note(const cv::Mat1f& depth_m, const Rigid3& T_world_event, const DepthPose& shown) {
  last_m_ = depth_m;
  T_world_last_ = T_world_event;
  shown_ = shown;
}

}  // namespace devo
