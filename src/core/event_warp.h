// SPDX-License-Identifier: BSD-3-Clause
//
// The inner loop of the motion-compensated surface, which moves tens of thousands of events.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/crests.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"
#include "simd.h"

namespace devo {

/// An event that passed the noise filter, with its viewing ray (x, y, 1).
struct RayEvent {
  std::int64_t doubled_t_ns;  // plus the polarity
  float ray_x, ray_y;

  std::int64_t t_ns() const { return doubled_t_ns >> 1; }
  int polarity() const { return static_cast<int>(doubled_t_ns & 1); }
};
static_assert(sizeof(RayEvent) == 16, "four are transposed at a time");

/// Moves events along the motion to one time and accumulates them bilinearly, in units of 1 / kEventWeight.
class EventWarp {
 public:
  /// `accumulated` counts all events, `accumulated_sign` ON minus OFF ones, each at its nearest pixel. Both have the
  /// camera's size and no gaps between their rows. `depth` must live as long.
  EventWarp(const Camera& undistorted, const SceneDepth& depth, cv::Mat1w* accumulated, SignedCounts* accumulated_sign);
  ~EventWarp() { CountWaiting(); }
  EventWarp(const EventWarp&) = delete;
  EventWarp& operator=(const EventWarp&) = delete;

  /// From the camera when the events to come were made to the camera at the common time.
  void SetPose(const Rigid3& T_now_then);

  void Add(const RayEvent* next, const RayEvent* end);

 private:
  static constexpr int kSub = 8;  // positions are split between four pixels in steps of 1/8: weights sum to 64
  static_assert(kSub * kSub == kEventWeight);
  static constexpr int kWaiting = 32;

  /// What an event at a fraction of a pixel adds to the four pixels around it: two in a word, as they lie in memory.
  struct Share {
    std::uint32_t upper, lower;
    std::int32_t nearest;  // pixel, from the upper left one
  };

  /// Moved but not yet counted: meanwhile its pixels are fetched.
  struct Waiting {
    std::int32_t pixel;
    std::int16_t share, polarity;
  };

  Share MakeShare(int ax, int ay) const;
  cv::v_float32x4 InverseDepth(const cv::v_float32x4& ray_x, const cv::v_float32x4& ray_y) const;
  void AddFour(const RayEvent* events, int count);
  void CountWaiting();
  void Count(const Waiting& event);

  cv::v_float32x4 fx_, fy_, cx_, cy_;
  cv::v_float32x4 R_[3][3], t_[3];
  int width_, height_;
  float inverse_median_;
  const cv::Mat1f& grid_;
  bool has_grid_;
  std::uint16_t* sums_;
  std::int8_t* signs_;
  std::array<Share, kSub * kSub> shares_;
  std::array<Waiting, kWaiting> waiting_;
  int waiting_count_ = 0;
};

}  // namespace devo
