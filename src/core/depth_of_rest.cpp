// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_of_rest.h"

#include <algorithm>

#include "devo/core/time.h"

namespace devo {
namespace {

// Events for each edge. With fewer, the edges are those of one or two directions and thin; with more, they lie farther
// from the image's than a depth warp takes for its own error.
constexpr double kLeastEvents = 2, kMostEvents = 5;
// Between images. The way that a camera has from rest in less is hardly worth a poorer map.
constexpr double kOften_s = 0.3;

}  // namespace

void DepthOfRest::Keep(const DepthImage& depth, const Surface& surface) {
  const bool often = last_ns_ && SecondsFromNs(depth.t_ns - *last_ns_) < kOften_s;
  last_ns_ = depth.t_ns;
  depth_ = often ? std::nullopt : std::make_optional(depth);
  counted_ns_ = surface.t_ns;
  events_ = 0;
}

bool DepthOfRest::Fits(const Surface& surface) {
  if (!depth_ || surface.t_ns <= counted_ns_) return false;
  const double span_s = SecondsFromNs(surface.t_ns - counted_ns_);
  counted_ns_ = surface.t_ns;
  if (surface.maybe_noise) {
    events_ = 0;
    return false;
  }
  // Of the undistorted image's pixels, not the sensor's: edges are as many, and move as far, in its larger ones.
  events_ += span_s * surface.activity_hz * static_cast<double>(surface.image.total());
  const double events_per_edge = events_ / std::max(1.0, static_cast<double>(surface.edges.size()));
  if (events_per_edge > kMostEvents) depth_.reset();
  return depth_ && !surface.still && events_per_edge >= kLeastEvents;
}

void DepthOfRest::Clear() {
  depth_.reset();
  last_ns_.reset();
}

}  // namespace devo
