// SPDX-License-Identifier: BSD-3-Clause
//
// Depth of event-image edges from an unregistered depth image (paper section III-C): warp every reading into
// the event frame, list the readings around each edge, take the foreground, intersect the edge's ray.
#pragma once

#include <optional>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/core/options.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// Not thread-safe.
class DepthRegistration {
 public:
  /// `event_camera` is the undistorted event image's camera.
  DepthRegistration(const Camera& event_camera, const Camera& depth_camera, const MappingOptions& options);

  void SetOptions(const MappingOptions& options) { options_ = options; }

  /// Warps the readings (paper eq. 2 and 3). `T_event_depth` maps points from the depth camera at its time to
  /// the event camera at the surface's time (extrinsics and the motion in between). Readings near the
  /// `edges` are listed for DepthAt; all enter the scene's depth. Returns the number of valid readings.
  /// Throws std::invalid_argument when the image has not the depth camera's size.
  int Warp(const DepthImage& depth, const Rigid3& T_event_depth, const std::vector<EdgePoint>& edges);

  struct EdgeDepth {
    float z_m;        ///< along the optical axis of the event camera
    float sigma_m;    ///< spread of the readings it is from
    bool silhouette;  ///< readings farther behind were left out as background
  };

  /// Foreground depth at a sub-pixel position that was among the warped edges. Empty where readings are
  /// too few, on one side only and too far, or have no common surface.
  std::optional<EdgeDepth> DepthAt(float x, float y) const;

  /// Calls `visit(edge, DepthAt(edge))` for each of many in turn, until it returns false. Faster than one by one:
  /// readings lie scattered in memory, and those of the next edges are fetched meanwhile.
  template <typename Visit>
  void ForDepths(const std::vector<const EdgePoint*>& edges, Visit&& visit) const {
    constexpr std::size_t kAhead = 6;
    for (std::size_t k = 0; k < edges.size(); ++k) {
      if (k + 2 * kAhead < edges.size()) FetchLists(*edges[k + 2 * kAhead]);
      if (k + kAhead < edges.size()) FetchReadings(*edges[k + kAhead]);
      if (!visit(*edges[k], DepthAt(edges[k]->x, edges[k]->y))) return;
    }
  }

  /// Nearest warped depth per cell of kCell x kCell pixels, 0 where none: what hides points behind it.
  const cv::Mat1f& nearest_depth() const { return cell_depth_; }
  static constexpr int kCell = 4;
  static constexpr int kUsualReach = 4;  ///< px, around an edge; farther where the image's readings lie far apart
  /// Whether a reading of the last warped image lies in the cell of this pixel of the event image.
  bool HasReadingAt(float x, float y) const {
    return cell_depth_(static_cast<int>(y) / kCell, static_cast<int>(x) / kCell) > 0;
  }
  /// The same of a position that was among the warped edges, where an image whose readings lie farther apart than cells
  /// may tell a depth all the same.
  bool IsReadAt(float x, float y) const { return HasReadingAt(x, y) || (IsSparse() && DepthAt(x, y)); }

 private:
  struct Reading {
    float u, v, z;
    int next;  // of the same pixel, -1 ends the list
  };

  /// Of the neighbourhood of an edge, by how densely the image holds readings.
  float RadiusFor(const cv::Mat1f& depth_m) const;
  bool IsSparse() const { return radius_px_ > kUsualReach; }
  void MarkNeighbourhoods(const std::vector<EdgePoint>& edges);
  /// Calls `visit(dx, dy, z)` for the listed readings of an edge's neighbourhood, until it returns false.
  template <typename Visit>
  void ForReadingsAround(float x, float y, const Visit& visit) const;
  void FetchLists(const EdgePoint& edge) const;
  void FetchReadings(const EdgePoint& edge) const;

  Camera event_camera_;
  MappingOptions options_;
  std::vector<cv::Mat> depth_rays_;  // x and y of the rays (x, y, 1), one image each
  double focal_ratio_;               // pixels of the event image per pixel of the depth image
  int list_every_;                   // row and column of a depth image
  float radius_px_ = 0;              // of the neighbourhood, for the last image
  cv::Mat1b wanted_;                 // pixels whose readings are listed
  cv::Mat1i first_;                  // head of each pixel's list, -1 empty
  std::vector<Reading> readings_;    // room for all pixels of a depth image
  cv::Mat1f cell_depth_;
  std::vector<float> row_z_, row_u_, row_v_;  // one warped row; u and v half a pixel ahead
  std::vector<int> row_pixel_, row_cell_;     // index of the pixel in the event image, -1 outside, and of its cell
};

}  // namespace devo
