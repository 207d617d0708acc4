// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

namespace devo {

/// An edge element of the semi-dense region: a crest of the motion-compensated surface or, with the
/// paper's plain surface, a pixel above the threshold delta (then without direction and polarity).
struct EdgePoint {
  float x = 0, y = 0;    ///< sub-pixel position in the undistorted event image, px
  float nx = 0, ny = 0;  ///< unit normal of the edge in the image; 0, 0 where unknown
  float strength = 0;    ///< accumulated events per pixel at the crest (blurred), > 0
  float polarity = 0;    ///< mean polarity of its events, -1 (all OFF) to 1 (all ON); 0 where unknown
};

/// A surface rendered from the events before `t_ns`, in the undistorted event image, with what tracking
/// and mapping need of it. Frozen once made: shared between threads and nodelets without copying.
struct Surface {
  std::int64_t t_ns = 0;  ///< when it was rendered: the end of its events
  /// When its edges were where it shows them: the mean time of its events. Moving events there, not to
  /// `t_ns`, an error of the velocity blurs an edge but does not move it.
  std::int64_t t_edges_ns = 0;
  std::uint64_t epoch = 0;       ///< counts resets (time going backwards); data of two epochs never meet
  cv::Mat1b image;               ///< rendering, 0 (no event) to 255 (strongest); TSM of paper eq. 1 scaled to 255
  std::vector<EdgePoint> edges;  ///< the semi-dense region
  /// Nearest edge of each pixel within the truncation distance, packed as squared distance (1/16 px^2) in the upper
  /// 16 bits and index into `edges` in the lower, so that the nearer of two is the smaller number; kNoEdge where
  /// there is none. Read it through NearestEdge. Empty with the paper's plain surface, whose field is 1 - image / 255.
  cv::Mat1i nearest_edge;
  static constexpr std::int32_t kNoEdge = 0x7E000000;
  static constexpr std::size_t kMaxEdges = 0x10000;
  double event_rate_hz = 0;  ///< events per second over the last 20 ms, whole image, noise included
  double activity_hz = 0;    ///< the same after the noise filter, per sensor pixel: standstill below a threshold
  double window_s = 0;       ///< age of the oldest event used
  std::uint32_t events_used = 0;
  bool still = false;  ///< too few events to see motion: the pose is to be held
  /// Not more than noise may make that differs between parts of the image: no map is to begin with them.
  bool maybe_noise = false;
  /// The noise that was known goes on, since the last surface: no events are missing, however few there are. False
  /// where there is too little of it to tell.
  bool noise_goes_on = false;
  /// rad/s, event frame: the turn that moves the image as its events do, found by them alone or beside the motion of
  /// poses. It stands for a translation, too, at the scene's mean depth. Zero where an inertial sensor leads the poses.
  Eigen::Vector3d turn_event = Eigen::Vector3d::Zero();

  /// Index of the nearest edge of a pixel, -1 where there is none.
  int NearestEdge(int x, int y) const {
    const std::int32_t packed = nearest_edge(y, x);
    return packed == kNoEdge ? -1 : packed & 0xFFFF;
  }

  int width() const { return image.cols; }
  int height() const { return image.rows; }
};
using SurfacePtr = std::shared_ptr<const Surface>;

/// Inverse depth of the scene in the event image, coarse, for compensating translation in surfaces.
struct SceneDepth {
  std::int64_t t_ns = 0;
  double median_m = 0;  ///< median over valid pixels, > 0; 0: unknown (only rotation is compensated)
  /// 1/m in squares of kCell_px of the event image, the last ones reaching beyond it; empty when only the median is
  /// known.
  cv::Mat1f inverse_depth;
  static constexpr int kCell_px = 16;
};

}  // namespace devo
