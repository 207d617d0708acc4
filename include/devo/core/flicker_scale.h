// SPDX-License-Identifier: BSD-3-Clause
//
// Areas of one size in which nearly all that fires gets brighter at once, and darker shortly after, or the other way:
// a lamp flickers there. No motion takes back so soon what it did to all of an area.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "devo/core/event.h"

namespace devo {

/// Not thread-safe.
class FlickerScale {
 public:
  /// `width`, `height` of the image in pixels. An area is three by three blocks of `1 << shift` pixels; `least_share`:
  /// of its pixels, 0 to 1, so many fire within 3 ms, at least, and a third of that in each block.
  FlickerScale(int width, int height, int shift, double least_share);

  /// Events after all before; those outside of the image do not count.
  void Look(EventSpan events);

  /// Whether there is a lamp's among the events of the last kSlots milliseconds.
  bool found() const { return found_slot_ > newest_slot_ - kSlots; }
  /// Whether one that was looked at, in the image, is a lamp's. Those of motion that fire in the same millisecond alike
  /// are taken for a lamp's, too. False for one that is not of the last kSlots milliseconds.
  bool IsOfLamp(const Event& event) const {
    const std::int64_t slot = SlotOf(event);
    const bool known = slot > newest_slot_ - kSlots && slot <= newest_slot_;
    return known && (of_lamp_[RingOf(slot)][BlockOf(event)] & BitOf(event.polarity != 0)) != 0;
  }

  void Clear();

  static constexpr std::int64_t kSlots = 64;  // as many as a driver's message, and a surface, may span

 private:
  static constexpr std::int64_t kSlot_ns = 1'000'000;
  static constexpr int kBorder = 2;  // blocks
  using PerBlock = std::vector<std::uint16_t>;

  static std::int64_t SlotOf(const Event& event) { return event.t_ns / kSlot_ns; }
  static std::size_t RingOf(std::int64_t slot) { return static_cast<std::size_t>(slot) % kSlots; }
  std::size_t BlockOf(const Event& event) const {
    return static_cast<std::size_t>((event.y >> shift_) + kBorder) * stride_ + (event.x >> shift_) + kBorder;
  }

  static std::uint8_t BitOf(bool polarity) { return polarity ? 2 : 1; }

  void Begin(std::int64_t slot);
  void BeginAnew(std::int64_t slot);
  void Empty(std::int64_t slot);
  bool MayBurst(std::int64_t slot) const;
  std::array<std::uint16_t*, 2> CountsOf(std::int64_t slot);
  void SumAbout(std::int64_t slot, bool polarity);
  void SumAreas(const std::vector<std::int32_t>& blocks, std::vector<std::int32_t>* areas) const;
  bool IsBurst(std::size_t block, bool polarity) const;
  bool IsEnd(std::size_t block, std::int64_t slot, bool polarity) const;
  void Judge(std::int64_t slot);
  void Mark(std::size_t block, std::int64_t slot, bool polarity);

  int width_, height_, shift_;
  double least_share_;
  int stride_;                                          // blocks of a row; two of border are on every side
  std::vector<std::int32_t> pixels_, area_pixels_;      // of each block, 0 in the border; and of those around it, too
  std::array<std::array<PerBlock, 2>, kSlots> counts_;  // of each slot and polarity
  std::array<std::uint16_t, kSlots> most_{};            // of each slot: of a block and polarity
  std::array<std::vector<std::uint8_t>, kSlots> of_lamp_;  // of each slot a bit for each polarity
  std::array<std::vector<std::int32_t>, 2> sums_, areas_;  // of each polarity, about the slot that is judged
  std::array<std::vector<std::int64_t>, 2> burst_slot_;    // of each polarity: the last in which all fired alike
  std::int64_t newest_slot_, found_slot_;
};

}  // namespace devo
