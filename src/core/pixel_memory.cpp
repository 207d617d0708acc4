// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/pixel_memory.h"

#include <utility>

#include "filter_pixel.h"

namespace devo {
namespace {

constexpr std::int64_t kLongAgo_ticks = 1 << 14;  // longer than any window: from then on age is not told apart
constexpr std::int64_t kForgettingPeriod_ticks = 1 << 15;
static_assert(kForgettingPeriod_ticks + 2 * kLongAgo_ticks <= kAgeMask + 1, "what is long ago must not come round");

}  // namespace

PixelMemory::PixelMemory(int width, int height, std::uint32_t window_us)
    : width_(width), height_(height), stride_(width + 2) {
  SetWindow(window_us);
  Clear();
}

void PixelMemory::SetWindow(std::uint32_t window_us) {
  asked_shift_ = 0;
  while (window_us >> asked_shift_ >= kLongAgo_ticks) ++asked_shift_;
}

void PixelMemory::Clear() {
  // Neighbours are read four at a time: one more than there are at the end.
  words_.assign(static_cast<std::size_t>(stride_) * (height_ + 2) + 1, kTickMask & -kLongAgo_ticks);
  clock_.t0_ns = -1;
}

void PixelMemory::Begin(std::int64_t t_ns) {
  clock_ = {t_ns, asked_shift_};
  forgot_ticks_ = 0;
}

void PixelMemory::ForgetLongAgo(std::int64_t t_ns) {
  const bool other_ticks = std::exchange(clock_.shift, asked_shift_) != asked_shift_;
  const std::int64_t ticks = clock_.At(t_ns);
  if (!other_ticks && ticks - forgot_ticks_ < kForgettingPeriod_ticks) return;
  // After a gap this long, every pixel has been silent for long.
  const bool all = other_ticks || ticks - forgot_ticks_ >= kForgettingPeriod_ticks + kLongAgo_ticks;
  const auto now = static_cast<std::uint32_t>(ticks), long_ago = static_cast<std::uint32_t>(ticks - kLongAgo_ticks);
  for (std::uint32_t& pixel : words_) {
    const bool forget = all | (((now - pixel) & kAgeMask) > kLongAgo_ticks);
    pixel = forget ? (pixel & ~kTickMask) | (long_ago & kTickMask) : pixel;
  }
  forgot_ticks_ = ticks;
}

std::int64_t PixelMemory::next_forgetting_ns() const {
  const std::int64_t forget_us = (forgot_ticks_ + kForgettingPeriod_ticks) << clock_.shift;
  return clock_.t0_ns + forget_us * TickClock::kNsPerMicrosecond;
}

void PixelMemory::BeginPeriod() {
  for (std::uint32_t& pixel : words_) pixel &= kTickMask;
}

void PixelMemory::MarkHot(const std::vector<std::uint32_t>& pixels) {
  for (const std::uint32_t i : pixels) words_[i] |= kHotBit;
}

double PixelMemory::ShareOfOn(std::int64_t t_ns) const {
  const auto now = static_cast<std::uint32_t>(clock_.At(t_ns));
  std::size_t recent = 0, on = 0;
  for (const std::uint32_t pixel : words_) {
    const std::uint32_t age = now - pixel;
    const bool is_recent = (age & kAgeMask) < kLongAgo_ticks;
    recent += is_recent;
    on += is_recent & ((age & kOnTicks) != 0);
  }
  return recent > 0 ? static_cast<double>(on) / static_cast<double>(recent) : 0.5;
}

}  // namespace devo
