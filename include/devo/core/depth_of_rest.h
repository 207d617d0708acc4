// SPDX-License-Identifier: BSD-3-Clause
//
// The depth of a camera that does not move yet. At 1 Hz the next image may come a second after the first motion; until
// then there would be no map and no pose, though the scene's depth is known.
#pragma once

#include <cstdint>
#include <optional>

#include "devo/core/depth_image.h"
#include "devo/core/surface.h"

namespace devo {

/// Keeps the last depth image of a rest until the camera has moved enough to show edges, and no farther than that the
/// image still lies on them. How far is told by the events: an edge that moves by a pixel makes one or two at each of
/// its pixels. Where images come often it keeps none: the next one is better. Not thread-safe.
class DepthOfRest {
 public:
  /// An image, and the surface of its time, which shows no motion: in place of the one before, which came earlier.
  void Keep(const DepthImage& depth, const Surface& surface);

  /// Every surface since, in the order of their time; those not after the last one are passed over. Returns whether a
  /// map may be made of this surface and the image.
  bool Fits(const Surface& surface);

  /// Empty before the first, where images come often, and once the camera has moved too far.
  const std::optional<DepthImage>& depth() const { return depth_; }
  void Clear();

 private:
  std::optional<DepthImage> depth_;
  std::optional<std::int64_t> last_ns_;  // time of the last image
  std::int64_t counted_ns_ = 0;          // time of the last surface
  double events_ = 0;                    // passed by the noise filter since the rest
};

}  // namespace devo
