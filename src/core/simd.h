// SPDX-License-Identifier: BSD-3-Clause
//
// Where eight numbers at once pay, a function is compiled twice and chosen at run time: for the baseline of its
// platform, and for AVX2, which x86 processors have had since 2013 and POPCNT with it; where sixteen pay, also for
// AVX-512. All give the same bytes: AVX2 alone has no fused multiplication, and AVX-512 is used where no sum of a
// product could be one.
#pragma once

#include <array>
#include <cstdint>

#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/core/utility.hpp>

#if defined(__GNUC__)
#define DEVO_ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define DEVO_ALWAYS_INLINE inline
#endif

#if defined(__x86_64__) && defined(__GNUC__)
#define DEVO_AVX2 __attribute__((target("avx2,popcnt")))
#define DEVO_AVX512 __attribute__((target("avx512f")))
#endif

namespace devo {

/// False also after cv::setUseOptimized(false), and where OPENCV_CPU_DISABLE=AVX2 in the environment says so.
inline bool HasAvx2() { return cv::checkHardwareSupport(CV_CPU_AVX2); }

/// The same with OPENCV_CPU_DISABLE=AVX512-SKX. The first processors that have it pay for it with their clock: those
/// without its later part are not asked.
inline bool HasAvx512() { return cv::checkHardwareSupport(CV_CPU_AVX512_SKX); }

/// Has what will be written soon fetched meanwhile.
inline void Prefetch(const void* address) {
#ifdef __GNUC__
  __builtin_prefetch(address, 1);
#else
  static_cast<void>(address);
#endif
}

/// Has what will be read soon fetched meanwhile.
inline void PrefetchToRead(const void* address) {
#ifdef __GNUC__
  __builtin_prefetch(address);
#else
  static_cast<void>(address);
#endif
}

/// The places of the bits that are set in each byte, and how many they are.
struct PlacesOfBits {
  std::array<std::array<std::uint8_t, 8>, 256> place{};
  std::array<std::uint8_t, 256> count{};

  constexpr PlacesOfBits() {
    for (unsigned bits = 0; bits < 256; ++bits) {
      for (unsigned i = 0; i < 8; ++i) {
        if (bits >> i & 1U) place[bits][count[bits]++] = static_cast<std::uint8_t>(i);
      }
    }
  }
};
inline constexpr PlacesOfBits kPlacesOfBits;

/// Columns of chosen pixels of one row.
class PixelList {
 public:
  /// From here on it must be emptied before anything is appended; below, twice may be.
  static constexpr int kFull = 64;
  static constexpr int kMost = kFull + 16;  ///< how many there may be

  /// Those of the eight pixels from x on whose bit is set. Always writes eight: cheaper than a branch for each.
  void Append(int x, int bits) {
    const cv::v_uint16x8 offsets = cv::v_load_expand(kPlacesOfBits.place[bits].data());
    cv::v_store(x_.data() + size_, offsets + cv::v_setall_u16(static_cast<std::uint16_t>(x)));
    size_ += kPlacesOfBits.count[bits];
  }
  /// Repeats the last one, which there must be, up to a multiple of eight, without counting it.
  void PadToEight() {
    const cv::v_uint16x8 last = cv::v_setall_u16(x_[size_ - 1]);
    cv::v_store(x_.data() + size_, last);
  }
  void Clear() { size_ = 0; }
  int size() const { return size_; }
  const std::uint16_t* data() const { return x_.data(); }
  int operator[](int k) const { return x_[k]; }

 private:
  std::array<std::uint16_t, kMost + 8> x_;
  int size_ = 0;
};

}  // namespace devo
