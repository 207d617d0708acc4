// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/apparent_turn.h"

#include <algorithm>
#include <cmath>

#include <opencv2/core/hal/intrin.hpp>

namespace devo {
namespace {

constexpr std::size_t kLeastEvents = 500;
constexpr std::size_t kAtOnce = 4;  // in a register
// Among all turns it is sought in a moment so short that the image moves by some squares only.
constexpr double kGlance_s = 0.012, kLook_s = 0.025, kAll_s = 1;
constexpr std::size_t kInGlance = 2000, kInLook = ApparentTurn::kMostLookedAt;  // events, at most
constexpr double kCoarse_px = 4, kFine_px = 2;
constexpr double kLeastStep = 0.125;  // squares that the image moves
constexpr double kFastest_rad_s = 6;
constexpr unsigned kAmongAllEvery = 8;  // times that it is asked: that takes longest
// By so many standard deviations the image must be clearer than without a turn: less may be chance.
constexpr double kSigmas = 4;
// Of a turn beside a known motion less is asked: at worst the one is as wrong as the other.
constexpr double kSigmasBeside = 1;
// And by this share for each square that the image moves. A motion over n squares makes it some 0.3 n clearer; along
// edges of one direction all turns are alike; and where an edge moves by less than a pixel, its pixels answer in turn,
// as if something ran along it (0.05 n, of a tiled wall at 240x180 0.12).
constexpr double kClearerBySquare = 0.2, kClearerBeside = 0.1;

}  // namespace

ApparentTurn::ApparentTurn(const Camera& undistorted)
    : fx_(static_cast<float>(undistorted.fx())), fy_(static_cast<float>(undistorted.fy())),
      cx_(static_cast<float>(undistorted.cx())), cy_(static_cast<float>(undistorted.cy())), width_(undistorted.width()),
      height_(undistorted.height()) {}

void ApparentTurn::Reset() {
  turn_.setZero();
  asked_ = 0;
}

const Eigen::Vector3d& ApparentTurn::Estimate(const std::vector<Sighting>& events, const Eigen::Vector3d& read) {
  std::vector<Eigen::Vector3d> starts;
  const auto start_at = [&](const Eigen::Vector3d& turn) {
    if (std::find(starts.begin(), starts.end(), turn) == starts.end()) starts.push_back(turn);
  };
  start_at(turn_);
  start_at(Eigen::Vector3d::Zero());
  start_at(read);
  turn_ = read;
  if (events.size() < kLeastEvents) return turn_;
  price_ = {read, read.isZero() ? kClearerBySquare : kClearerBeside};
  if (asked_++ % kAmongAllEvery == 0) {
    LookAt(events, kGlance_s, kCoarse_px, kInGlance, &glance_);
    start_at(AmongAll(glance_));
  }
  LookAt(events, kLook_s, kCoarse_px, kInLook, &look_);
  LookAt(events, kAll_s, kFine_px, kInLook, &all_);
  double best = all_.beforehand + kSigmas * all_.sigma;
  for (const Eigen::Vector3d& start : starts) {
    const Eigen::Vector3d turn = Climb(all_, Climb(look_, start));
    const double sharpness = Sharpness(all_, turn);
    if (sharpness <= best) continue;
    best = sharpness;
    turn_ = turn;
  }
  return turn_;
}

Eigen::Vector3d ApparentTurn::Beside(const std::vector<Sighting>& events, const Eigen::Vector3d& believed) {
  Eigen::Vector3d beside = Eigen::Vector3d::Zero();
  if (events.size() >= kLeastEvents) {
    price_ = {Eigen::Vector3d::Zero(), kClearerBeside};
    LookAt(events, kAll_s, kFine_px, kInLook, &all_);
    Eigen::Vector3d start = beside;
    double best = all_.beforehand;
    for (const Eigen::Vector3d& other : {Eigen::Vector3d(turn_ - believed), Eigen::Vector3d(-believed)}) {
      const double sharpness = Sharpness(all_, other);
      if (sharpness <= best) continue;
      best = sharpness;
      start = other;
    }
    const Eigen::Vector3d turn = Climb(all_, start);
    if (Sharpness(all_, turn) > all_.beforehand + kSigmasBeside * all_.sigma) beside = turn;
  }
  turn_ = believed + beside;
  return beside;
}

void ApparentTurn::LookAt(const std::vector<Sighting>& events, double span_s, double square_px, std::size_t most,
                          Look* look) {
  const float since_s = events.back().t_s - static_cast<float>(span_s);
  const auto begin =
      std::partition_point(events.begin(), events.end(), [&](const Sighting& event) { return event.t_s < since_s; });
  const auto step = (events.end() - begin) / static_cast<std::ptrdiff_t>(most) + 1;
  const auto count = (events.end() - begin + step - 1) / step;
  const std::size_t padded = (static_cast<std::size_t>(count) + kAtOnce - 1) / kAtOnce * kAtOnce;
  for (auto* image : {&look->at, &look->move_x, &look->move_y, &look->move_z}) {
    image->u.assign(padded, 0);
    image->v.assign(padded, 0);
  }
  look->polarity.assign(padded, 0);
  const float sx = fx_ / static_cast<float>(square_px), sy = fy_ / static_cast<float>(square_px);
  const float middle_s = 0.5F * (begin->t_s + events.back().t_s);
  const auto set = [](Look::Image* image, std::size_t i, float u, float v) {
    image->u[i] = u;
    image->v[i] = v;
  };
  for (std::ptrdiff_t k = 0; k < count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Sighting& event = begin[k * step];
    const float x = event.x, y = event.y, dt_s = event.t_s - middle_s;
    // turn x (x, y, 1), seen in the image.
    set(&look->at, i, sx * x + cx_ / static_cast<float>(square_px), sy * y + cy_ / static_cast<float>(square_px));
    set(&look->move_x, i, -dt_s * sx * x * y, -dt_s * sy * (1 + y * y));
    set(&look->move_y, i, dt_s * sx * (1 + x * x), dt_s * sy * x * y);
    set(&look->move_z, i, -dt_s * sx * y, dt_s * sy * x);
    look->polarity[i] = event.polarity;
  }
  for (std::size_t i = static_cast<std::size_t>(count); i < padded; ++i) set(&look->at, i, -1, -1);
  look->squares_per_turn = sx * std::max(1e-3, static_cast<double>(events.back().t_s - begin->t_s));
  look->columns = static_cast<int>(width_ / square_px) + 1;
  look->rows = static_cast<int>(height_ / square_px) + 1;
  look->beforehand = Pairs(*look, price_.from);
  look->sigma = std::sqrt(look->beforehand + 1);
}

void ApparentTurn::FindSquares(const Look& look, const Eigen::Vector3d& turn) {
  using cv::v_load, cv::v_setall_f32, cv::v_setall_s32;
  const auto x = v_setall_f32(static_cast<float>(turn.x())), y = v_setall_f32(static_cast<float>(turn.y())),
             z = v_setall_f32(static_cast<float>(turn.z())), zero = v_setall_f32(0);
  const auto columns = v_setall_f32(static_cast<float>(look.columns)),
             rows = v_setall_f32(static_cast<float>(look.rows));
  const auto row_length = v_setall_s32(look.columns), none = v_setall_s32(look.columns * look.rows);
  squares_.resize(look.polarity.size());
  for (std::size_t i = 0; i < squares_.size(); i += kAtOnce) {
    const auto u = v_load(&look.at.u[i]) + x * v_load(&look.move_x.u[i]) + y * v_load(&look.move_y.u[i]) +
                   z * v_load(&look.move_z.u[i]);
    const auto v = v_load(&look.at.v[i]) + x * v_load(&look.move_x.v[i]) + y * v_load(&look.move_y.v[i]) +
                   z * v_load(&look.move_z.v[i]);
    const auto inside = cv::v_reinterpret_as_s32((u >= zero) & (v >= zero) & (u < columns) & (v < rows));
    const auto square = cv::v_select(inside, cv::v_trunc(v) * row_length + cv::v_trunc(u), none);
    cv::v_store(&squares_[i], square + square + v_load(&look.polarity[i]));
  }
}

double ApparentTurn::Pairs(const Look& look, const Eigen::Vector3d& turn) {
  FindSquares(look, turn);
  const std::size_t outside = 2 * static_cast<std::size_t>(look.columns) * look.rows;
  if (counts_.size() < outside + 2) counts_.resize(outside + 2, 0);
  std::uint64_t pairs = 0;
  for (const std::int32_t square : squares_) pairs += counts_[square]++;
  for (const std::size_t polarity : {0, 1}) {
    const std::uint64_t count = counts_[outside + polarity];
    pairs -= count * (count - (count > 0)) / 2;
  }
  for (const std::int32_t square : squares_) counts_[square] = 0;
  return static_cast<double>(pairs);
}

double ApparentTurn::Sharpness(const Look& look, const Eigen::Vector3d& turn) {
  return Pairs(look, turn) - price_.by_square * look.beforehand * (turn - price_.from).norm() * look.squares_per_turn;
}

Eigen::Vector3d ApparentTurn::Climb(const Look& look, Eigen::Vector3d turn) {
  double best = Sharpness(look, turn);
  for (double squares = 1; squares > kLeastStep;) {
    const double step = squares / look.squares_per_turn;
    const Eigen::Vector3d from = turn;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double way : {-step, step}) {
        Eigen::Vector3d there = from;
        there[axis] += axis == 2 ? 2 * way : way;  // a roll moves little of the image as far
        const double sharpness = Sharpness(look, there);
        if (sharpness <= best) continue;
        best = sharpness;
        turn = there;
      }
    }
    if (turn == from) squares /= 2;
  }
  return turn;
}

Eigen::Vector3d ApparentTurn::AmongAll(const Look& look) {
  const double step = 1 / look.squares_per_turn;
  const int steps = static_cast<int>(kFastest_rad_s / step);
  Eigen::Vector3d best = price_.from;
  double most = look.beforehand;
  for (int i = -steps; i <= steps; ++i) {
    for (int j = -steps; j <= steps; ++j) {
      const Eigen::Vector3d turn(i * step, j * step, 0);
      const double sharpness = Sharpness(look, turn);
      if (sharpness <= most) continue;
      most = sharpness;
      best = turn;
    }
  }
  return best;
}

}  // namespace devo
