// SPDX-License-Identifier: BSD-3-Clause
//
// What a noise filter remembers of each pixel: when it last fired, and with which polarity, how many events it had in
// this period, and whether it is hot.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace devo {

/// Time in ticks of 2^shift microseconds.
struct TickClock {
  std::int64_t t0_ns = -1;  ///< of tick 0
  int shift = 0;

  std::int64_t At(std::int64_t t_ns) const { return (t_ns - t0_ns) / kNsPerMicrosecond >> shift; }

  static constexpr std::int64_t kNsPerMicrosecond = 1000;
};

/// Pixels are named by their position in words(). Not thread-safe.
class PixelMemory {
 public:
  /// `window_us`: up to this, at least, the age of an event can be told.
  PixelMemory(int width, int height, std::uint32_t window_us);

  /// Another window from the next ForgetLongAgo() on. Ages that are told in other ticks are forgotten then, not what
  /// was counted.
  void SetWindow(std::uint32_t window_us);

  /// No pixel has fired, and time is yet to begin.
  void Clear();

  bool has_begun() const { return clock_.t0_ns >= 0; }
  /// `t_ns`: of the first event.
  void Begin(std::int64_t t_ns);

  /// Times wrap. This keeps pixels that are long silent from being taken for recent: to be called before an event that
  /// is not before next_forgetting_ns(), without effect before any other.
  void ForgetLongAgo(std::int64_t t_ns);
  std::int64_t next_forgetting_ns() const;

  /// No pixel has had an event in this period, and none is hot.
  void BeginPeriod();
  void MarkHot(const std::vector<std::uint32_t>& pixels);

  /// Of the pixels that fired shortly before `t_ns`, how many did so brighter (ON); a half where none did.
  double ShareOfOn(std::int64_t t_ns) const;

  /// As src/core/filter_pixel.h has them. One pixel of border on every side, so that neighbours need no bounds check.
  const std::uint32_t* words() const { return words_.data(); }
  std::uint32_t* words() { return words_.data(); }

  /// Of a pixel of the image.
  std::size_t PositionOf(int x, int y) const { return static_cast<std::size_t>(y + 1) * stride_ + x + 1; }

  int width() const { return width_; }
  int height() const { return height_; }
  int stride() const { return stride_; }  ///< words from one row to the next
  const TickClock& clock() const { return clock_; }

 private:
  int width_, height_, stride_;
  TickClock clock_;      // a tick is one microsecond, unless the window is long
  int asked_shift_ = 0;  // of the clock
  std::int64_t forgot_ticks_ = 0;
  std::vector<std::uint32_t> words_;
};

}  // namespace devo
