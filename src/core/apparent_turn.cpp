// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/apparent_turn.h"

#include <algorithm>
#include <cmath>

namespace devo {
namespace {

constexpr std::size_t kLeastEvents = 500;
// Among all turns it is sought in a moment so short that the image moves by some squares only.
constexpr double kGlance_s = 0.012, kLook_s = 0.025, kAll_s = 1;
constexpr std::size_t kInGlance = 2000, kInLook = 6000;  // events, at most
constexpr double kCoarse_px = 4, kFine_px = 2;
constexpr double kLeastStep = 0.125;  // squares that the image moves
constexpr double kFastest_rad_s = 6;
constexpr unsigned kAmongAllEvery = 8;  // times that it is asked: that takes longest
// By so many standard deviations the image must be clearer than without a turn: less may be chance.
constexpr double kSigmas = 4;
// And by this share for each square that the image moves. A motion over n squares makes it some 0.3 n clearer; along
// edges of one direction all turns are alike; and where an edge moves by less than a pixel, its pixels answer in turn,
// as if something ran along it (0.05 n).
constexpr double kClearerBySquare = 0.1;

}  // namespace

ApparentTurn::ApparentTurn(const Camera& undistorted)
    : fx_(static_cast<float>(undistorted.fx())), fy_(static_cast<float>(undistorted.fy())),
      cx_(static_cast<float>(undistorted.cx())), cy_(static_cast<float>(undistorted.cy())), width_(undistorted.width()),
      height_(undistorted.height()) {}

void ApparentTurn::Reset() {
  turn_.setZero();
  asked_ = 0;
}

const Eigen::Vector3d& ApparentTurn::Estimate(const std::vector<Sighting>& events) {
  std::vector<Eigen::Vector3d> starts;
  const auto start_at = [&](const Eigen::Vector3d& turn) {
    if (std::find(starts.begin(), starts.end(), turn) == starts.end()) starts.push_back(turn);
  };
  start_at(turn_);
  start_at(Eigen::Vector3d::Zero());
  turn_.setZero();
  if (events.size() < kLeastEvents) return turn_;
  if (asked_++ % kAmongAllEvery == 0) {
    LookAt(events, kGlance_s, kCoarse_px, kInGlance, &glance_);
    start_at(AmongAll(glance_));
  }
  LookAt(events, kLook_s, kCoarse_px, kInLook, &look_);
  LookAt(events, kAll_s, kFine_px, kInLook, &all_);
  double best = all_.none + kSigmas * all_.sigma;
  for (const Eigen::Vector3d& start : starts) {
    const Eigen::Vector3d turn = Climb(all_, Climb(look_, start));
    const double sharpness = Sharpness(all_, turn);
    if (sharpness <= best) continue;
    best = sharpness;
    turn_ = turn;
  }
  return turn_;
}

void ApparentTurn::LookAt(const std::vector<Sighting>& events, double span_s, double square_px, std::size_t most,
                          Look* look) {
  const float since_s = events.back().t_s - static_cast<float>(span_s);
  const auto begin =
      std::partition_point(events.begin(), events.end(), [&](const Sighting& event) { return event.t_s < since_s; });
  const auto step = (events.end() - begin) / static_cast<std::ptrdiff_t>(most) + 1;
  const auto count = (events.end() - begin + step - 1) / step;
  for (auto* array : {&look->at, &look->move_x, &look->move_y, &look->move_z}) array->resize(count, 2);
  look->polarity.resize(static_cast<std::size_t>(count));
  const float sx = fx_ / static_cast<float>(square_px), sy = fy_ / static_cast<float>(square_px);
  const float middle_s = 0.5F * (begin->t_s + events.back().t_s);
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const Sighting& event = begin[i * step];
    const float x = event.x, y = event.y, dt_s = event.t_s - middle_s;
    // turn x (x, y, 1), seen in the image.
    look->at.row(i) << sx * x + cx_ / static_cast<float>(square_px), sy * y + cy_ / static_cast<float>(square_px);
    look->move_x.row(i) << -dt_s * sx * x * y, -dt_s * sy * (1 + y * y);
    look->move_y.row(i) << dt_s * sx * (1 + x * x), dt_s * sy * x * y;
    look->move_z.row(i) << -dt_s * sx * y, dt_s * sy * x;
    look->polarity[static_cast<std::size_t>(i)] = event.polarity;
  }
  look->squares_per_turn = sx * std::max(1e-3, static_cast<double>(events.back().t_s - begin->t_s));
  look->columns = static_cast<int>(width_ / square_px) + 1;
  look->rows = static_cast<int>(height_ / square_px) + 1;
  look->none = Pairs(*look, Eigen::Vector3d::Zero());
  look->sigma = std::sqrt(look->none + 1);
}

double ApparentTurn::Pairs(const Look& look, const Eigen::Vector3d& turn) {
  const Eigen::Vector3f w = turn.cast<float>();
  moved_ = look.at + w.x() * look.move_x + w.y() * look.move_y + w.z() * look.move_z;
  counts_.assign(static_cast<std::size_t>(look.columns) * look.rows * 2, 0);
  std::uint64_t pairs = 0;
  for (std::ptrdiff_t i = 0; i < moved_.rows(); ++i) {
    const float u = moved_(i, 0), v = moved_(i, 1);
    const int column = static_cast<int>(u), row = static_cast<int>(v);
    if (u < 0 || v < 0 || column >= look.columns || row >= look.rows) continue;
    pairs += counts_[2 * (static_cast<std::size_t>(row) * look.columns + column) + look.polarity[i]]++;
  }
  return static_cast<double>(pairs);
}

double ApparentTurn::Sharpness(const Look& look, const Eigen::Vector3d& turn) {
  return Pairs(look, turn) - kClearerBySquare * look.none * turn.norm() * look.squares_per_turn;
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
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double most = look.none;
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
