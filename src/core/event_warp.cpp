// SPDX-License-Identifier: BSD-3-Clause
#include "event_warp.h"

#include <algorithm>
#include <cstring>
#include <limits>

namespace devo {
namespace {

cv::v_float32x4 All(double value) { return cv::v_setall_f32(static_cast<float>(value)); }

cv::v_float32x4 Load(const RayEvent* event) { return cv::v_load(reinterpret_cast<const float*>(event)); }

std::uint32_t Pair(int left, int right) {
  const std::array<std::uint16_t, 2> both = {static_cast<std::uint16_t>(left), static_cast<std::uint16_t>(right)};
  std::uint32_t word;
  std::memcpy(&word, both.data(), sizeof(word));
  return word;
}

}  // namespace

EventWarp::EventWarp(const Camera& undistorted, const SceneDepth& depth, cv::Mat1w* accumulated,
                     SignedCounts* accumulated_sign)
    : fx_(All(undistorted.fx())), fy_(All(undistorted.fy())), cx_(All(undistorted.cx())), cy_(All(undistorted.cy())),
      width_(undistorted.width()), height_(undistorted.height()),
      inverse_median_(depth.median_m > 0 ? static_cast<float>(1 / depth.median_m) : 0.0F), grid_(depth.inverse_depth),
      has_grid_(!grid_.empty()), sums_(accumulated->ptr<std::uint16_t>()),
      signs_(accumulated_sign->ptr<std::int8_t>()) {
  for (int share = 0; share < kSub * kSub; ++share) shares_[share] = MakeShare(share % kSub, share / kSub);
  SetPose(Rigid3());
}

EventWarp::Share EventWarp::MakeShare(int ax, int ay) const {
  return {Pair((kSub - ax) * (kSub - ay), ax * (kSub - ay)), Pair((kSub - ax) * ay, ax * ay),
          (2 * ay >= kSub ? width_ : 0) + (2 * ax >= kSub ? 1 : 0)};
}

void EventWarp::SetPose(const Rigid3& T_now_then) {
  const Eigen::Matrix3d R = T_now_then.rotation().toRotationMatrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) R_[row][column] = All(R(row, column));
    t_[row] = All(T_now_then.translation()[row]);
  }
}

void EventWarp::Add(const RayEvent* next, const RayEvent* end) {
  for (; end - next >= 4; next += 4) AddFour(next, 4);
  if (next == end) return;
  std::array<RayEvent, 4> rest{};
  std::copy(next, end, rest.begin());
  AddFour(rest.data(), static_cast<int>(end - next));
}

cv::v_float32x4 EventWarp::InverseDepth(const cv::v_float32x4& ray_x, const cv::v_float32x4& ray_y) const {
  if (!has_grid_) return All(inverse_median_);
  alignas(16) std::array<int, 4> gx, gy;
  alignas(16) std::array<float, 4> inverse_depth;
  constexpr double kCells_per_px = 1.0 / SceneDepth::kCell_px;
  cv::v_store(gx.data(), cv::v_trunc((fx_ * ray_x + cx_) * All(kCells_per_px)));
  cv::v_store(gy.data(), cv::v_trunc((fy_ * ray_y + cy_) * All(kCells_per_px)));
  for (int k = 0; k < 4; ++k) {
    const bool inside = gx[k] >= 0 && gy[k] >= 0 && gx[k] < grid_.cols && gy[k] < grid_.rows;
    inverse_depth[k] = inside ? grid_(gy[k], gx[k]) : inverse_median_;
  }
  return cv::v_load(inverse_depth.data());
}

void EventWarp::AddFour(const RayEvent* events, int count) {
  cv::v_float32x4 unused, x, y;
  cv::v_transpose4x4(Load(events), Load(events + 1), Load(events + 2), Load(events + 3), unused, unused, x, y);
  const auto inverse_depth = InverseDepth(x, y);
  const auto X = R_[0][0] * x + R_[0][1] * y + R_[0][2] + t_[0] * inverse_depth;
  const auto Y = R_[1][0] * x + R_[1][1] * y + R_[1][2] + t_[1] * inverse_depth;
  const auto Z = R_[2][0] * x + R_[2][1] * y + R_[2][2] + t_[2] * inverse_depth;
  const auto u = fx_ * X / Z + cx_, v = fy_ * Y / Z + cy_;
  const auto u8 = cv::v_trunc(u * All(kSub) + All(0.5)), v8 = cv::v_trunc(v * All(kSub) + All(0.5));
  // Asked twice: rounding to an eighth may take a position to the last pixel, which has no right neighbour.
  const auto before_end = (u8 < cv::v_setall_s32(kSub * (width_ - 1))) & (v8 < cv::v_setall_s32(kSub * (height_ - 1)));
  const auto inside = (Z > All(0.1)) & (u >= All(0)) & (v >= All(0)) & (u < All(width_ - 1)) & (v < All(height_ - 1)) &
                      cv::v_reinterpret_as_f32(before_end);
  const int inside_bits = cv::v_signmask(inside) & ((1 << count) - 1);
  alignas(16) std::array<int, 4> column, row, share;
  const auto fraction = cv::v_setall_s32(kSub - 1);
  cv::v_store(column.data(), u8 >> 3);
  cv::v_store(row.data(), v8 >> 3);
  cv::v_store(share.data(), ((v8 & fraction) << 3) + (u8 & fraction));
  for (int k = 0; k < 4; ++k) {
    if (!(inside_bits >> k & 1)) continue;
    const std::int32_t pixel = row[k] * width_ + column[k];
    Prefetch(sums_ + pixel);
    Prefetch(sums_ + pixel + width_);
    Prefetch(signs_ + pixel);
    waiting_[waiting_count_++] = {pixel, static_cast<std::int16_t>(share[k]),
                                  static_cast<std::int16_t>(events[k].polarity())};
  }
  if (waiting_count_ > kWaiting - 4) CountWaiting();
}

void EventWarp::CountWaiting() {
  for (int k = 0; k < waiting_count_; ++k) Count(waiting_[k]);
  waiting_count_ = 0;
}

inline void EventWarp::Count(const Waiting& event) {
  const Share& share = shares_[event.share];
  std::uint16_t *upper = sums_ + event.pixel, *lower = upper + width_;
  std::uint32_t upper_pair, lower_pair;
  std::memcpy(&upper_pair, upper, sizeof(upper_pair));
  std::memcpy(&lower_pair, lower, sizeof(lower_pair));
  // Blurring in 16 bits asks for values below 4096. Adding 195 sets bit 12 of one that has passed 3900.
  constexpr std::uint32_t kMargin = 195 * 0x10001U, kFull = 0x1000 * 0x10001U;
  if (((upper_pair + kMargin) | (lower_pair + kMargin)) & kFull) return;
  upper_pair += share.upper;
  lower_pair += share.lower;
  std::memcpy(upper, &upper_pair, sizeof(upper_pair));
  std::memcpy(lower, &lower_pair, sizeof(lower_pair));
  std::int8_t& sign = signs_[event.pixel + share.nearest];
  constexpr int kMost = std::numeric_limits<std::int8_t>::max();
  sign = static_cast<std::int8_t>(std::clamp(sign + 2 * event.polarity - 1, -kMost, kMost));
}

}  // namespace devo
