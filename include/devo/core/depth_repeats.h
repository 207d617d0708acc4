// SPDX-License-Identifier: BSD-3-Clause
//
// A driver that stalls may send a depth image again, with a new stamp: taken for one of its time, it would say that the
// camera stands still.
#pragma once

#include <opencv2/core/mat.hpp>

#include "devo/core/depth_pose.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class DepthRepeats {
 public:
  /// Whether an image has all the readings of the one before, though the camera, at `T_world_event` by now, has moved
  /// in a direction that they show: a millimetre or a milliradian.
  bool IsRepeat(const cv::Mat1f& depth_m, const Rigid3& T_world_event) const;

  /// An image that is none, taken at `T_world_event` as far as tracking knows, and what it shows of that. Kept by
  /// reference.
  void Note(const cv::Mat1f& depth_m, const Rigid3& T_world_event, const DepthPose& shown);

  void Clear() { last_m_.release(); }

 private:
  cv::Mat1f last_m_;
  Rigid3 T_world_last_;
  DepthPose shown_;
};

}  // namespace devo
