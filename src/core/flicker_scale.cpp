// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/flicker_scale.h"

#include <algorithm>
#include <limits>

namespace devo {
namespace {

constexpr int kStep = 4;  // one in so many events is enough to tell
// All fire alike where so many times more get brighter than darker, or the other way: edges come in pairs.
constexpr std::int32_t kAlike = 6;
constexpr double kOfBlock = 1.0 / 3;  // of an area's least share, what each of its blocks has
constexpr double kOfEnd = 1.0 / 30;   // and what the end of a burst still has in a slot
// Half a period of 100 Hz after its end it is the other way. Stripes as wide as an area would have to pass it as fast.
constexpr std::int64_t kOtherWithin_slots = 8;
constexpr std::int64_t kLongAgo = std::numeric_limits<std::int64_t>::min() / 4'000'000;  // so that it has a time

/// Of the block at `here` and those around it, in rows `stride` long.
template <typename Value>
std::int32_t SumAround(const Value* here, std::ptrdiff_t stride) {
  std::int32_t sum = 0;
  for (const Value* middle : {here - stride, here, here + stride}) sum += middle[-1] + middle[0] + middle[1];
  return sum;
}

}  // namespace

FlickerScale::FlickerScale(int width, int height, int shift, double least_share)
    : width_(width), height_(height), shift_(shift), least_share_(least_share) {
  const int side = 1 << shift, columns = (width + side - 1) / side, rows = (height + side - 1) / side;
  stride_ = columns + 2 * kBorder;
  const auto blocks = static_cast<std::size_t>(stride_) * (rows + 2 * kBorder);
  pixels_.resize(blocks);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      pixels_[static_cast<std::size_t>(row + kBorder) * stride_ + column + kBorder] =
          std::min(side, height - row * side) * std::min(side, width - column * side);
    }
  }
  for (auto& of_slot : counts_) of_slot.fill(PerBlock(blocks));
  of_lamp_.fill(std::vector<std::uint8_t>(blocks));
  sums_.fill(std::vector<std::int32_t>(blocks));
  areas_ = sums_;
  area_pixels_.resize(blocks);
  SumAreas(pixels_, &area_pixels_);
  Clear();
}

void FlickerScale::Clear() {
  newest_slot_ = kLongAgo;
  found_slot_ = kLongAgo - kSlots;
  burst_slot_.fill(std::vector<std::int64_t>(pixels_.size(), kLongAgo));
}

void FlickerScale::Look(EventSpan events) {
  std::array<std::uint16_t*, 2> counts = CountsOf(newest_slot_);
  std::int64_t begin_ns = newest_slot_ * kSlot_ns;
  for (std::size_t i = 0; i < events.size; i += kStep) {
    const Event& event = events.data[i];
    if (event.x >= width_ || event.y >= height_ || event.t_ns < begin_ns) continue;
    if (event.t_ns >= begin_ns + kSlot_ns) {
      const std::int64_t slot = SlotOf(event);
      if (slot - newest_slot_ >= kSlots) BeginAnew(slot);
      while (newest_slot_ < slot) Begin(newest_slot_ + 1);
      counts = CountsOf(slot);
      begin_ns = slot * kSlot_ns;
    }
    const std::uint16_t count = ++counts[event.polarity != 0][BlockOf(event)];
    most_[RingOf(newest_slot_)] = std::max(most_[RingOf(newest_slot_)], count);
  }
  if (newest_slot_ == kLongAgo) return;
  Judge(newest_slot_ - 1);
  Judge(newest_slot_);
}

std::array<std::uint16_t*, 2> FlickerScale::CountsOf(std::int64_t slot) {
  auto& counts = counts_[RingOf(slot)];
  return {counts[0].data(), counts[1].data()};
}

/// A slot is known, and judged for good, once the one after it is.
void FlickerScale::Begin(std::int64_t slot) {
  Judge(slot - 2);
  newest_slot_ = slot;
  Empty(slot);
}

/// After a pause of which no slot is known.
void FlickerScale::BeginAnew(std::int64_t slot) {
  for (newest_slot_ = slot - kSlots; newest_slot_ < slot;) Empty(++newest_slot_);
}

void FlickerScale::Empty(std::int64_t slot) {
  for (PerBlock& counts : counts_[RingOf(slot)]) std::fill(counts.begin(), counts.end(), 0);
  std::fill(of_lamp_[RingOf(slot)].begin(), of_lamp_[RingOf(slot)].end(), 0);
  most_[RingOf(slot)] = 0;
}

/// The common case first: in most slots no block has so many events that fire alike.
bool FlickerScale::MayBurst(std::int64_t slot) const {
  const auto least = static_cast<std::uint16_t>(least_share_ * (1 << 2 * shift_) / (3 * kStep));
  if (most_[RingOf(slot)] < least) return false;
  const PerBlock &darker = counts_[RingOf(slot)][0], &brighter = counts_[RingOf(slot)][1];
  bool may = false;
  for (std::size_t i = 0; i < darker.size(); ++i) {
    const std::uint16_t more = std::max(darker[i], brighter[i]), less = std::min(darker[i], brighter[i]);
    may |= more >= least && 2 * more > kAlike * less;
  }
  return may;
}

/// Of each block in the slot and those before and after, and of each block and those around it.
void FlickerScale::SumAbout(std::int64_t slot, bool polarity) {
  std::vector<std::int32_t>&sums = sums_[polarity], &areas = areas_[polarity];
  std::fill(sums.begin(), sums.end(), 0);
  for (std::int64_t near = slot - 1; near <= std::min(slot + 1, newest_slot_); ++near) {
    const PerBlock& counts = counts_[RingOf(near)][polarity];
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += counts[i];
  }
  SumAreas(sums, &areas);
}

/// Of each block and those around it; 0 in the outermost.
void FlickerScale::SumAreas(const std::vector<std::int32_t>& blocks, std::vector<std::int32_t>* areas) const {
  const auto stride = static_cast<std::size_t>(stride_);
  for (std::size_t i = stride + 1; i + stride + 1 < blocks.size(); ++i) (*areas)[i] = SumAround(&blocks[i], stride_);
}

/// In the area about a block. A strong edge makes as many events, but in few of the blocks.
bool FlickerScale::IsBurst(std::size_t block, bool polarity) const {
  const std::int32_t alike = areas_[polarity][block], others = areas_[!polarity][block];
  if (alike < kAlike * others || kStep * alike < least_share_ * area_pixels_[block]) return false;
  const auto stride = static_cast<std::size_t>(stride_);
  for (const std::size_t row : {block - stride, block, block + stride}) {
    for (std::size_t i = row - 1; i <= row + 1; ++i) {
      if (kStep * sums_[polarity][i] < kOfBlock * least_share_ * pixels_[i]) return false;
    }
  }
  return true;
}

void FlickerScale::Judge(std::int64_t slot) {
  if (!MayBurst(slot)) return;
  SumAbout(slot, false);
  SumAbout(slot, true);
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const bool brighter = sums_[1][i] > sums_[0][i];
    if (pixels_[i] == 0 || !IsBurst(i, brighter)) continue;
    burst_slot_[brighter][i] = slot;
    if (slot - burst_slot_[!brighter][i] > kOtherWithin_slots) continue;
    Mark(i, slot, brighter);
    // Where more fires than the sensor can read, one burst follows the other: their ends.
    for (const std::int64_t end : {slot - 1, slot + 1}) {
      if (end <= newest_slot_ && IsEnd(i, end, brighter)) Mark(i, end, brighter);
    }
  }
}

/// Whether a few still fire alike in the area about a block, in one slot.
bool FlickerScale::IsEnd(std::size_t block, std::int64_t slot, bool polarity) const {
  const auto& counts = counts_[RingOf(slot)];
  const std::int32_t alike = SumAround(&counts[polarity][block], stride_);
  const std::int32_t others = SumAround(&counts[!polarity][block], stride_);
  return kStep * alike >= kOfEnd * least_share_ * area_pixels_[block] && alike >= kAlike * others;
}

/// And those around, which may be lit in part.
void FlickerScale::Mark(std::size_t block, std::int64_t slot, bool polarity) {
  found_slot_ = slot;
  std::vector<std::uint8_t>& of_lamp = of_lamp_[RingOf(slot)];
  const std::ptrdiff_t stride = stride_;
  for (std::ptrdiff_t row = -kBorder; row <= kBorder; ++row) {
    for (std::ptrdiff_t column = -kBorder; column <= kBorder; ++column) {
      of_lamp[block + row * stride + column] |= BitOf(polarity);
    }
  }
}

}  // namespace devo
