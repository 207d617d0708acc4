// SPDX-License-Identifier: BSD-3-Clause
#include "moving_edges.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "devo/core/time.h"

namespace devo {
namespace {

// The surface moves against the camera, along -x.
double Wrapped(double x, double width) {
  const double rest = std::fmod(x, width);
  return rest < 0 ? rest + width : rest;
}

}  // namespace

MovingEdges::MovingEdges(int width, int height, double rate_hz, double start_s)
    : camera_(width, height, 0.8 * width, 0.8 * width, 0.5 * (width - 1), 0.5 * (height - 1), "none", {}),
      speed_px_s_(300.0 / 640 * width * std::sqrt(rate_hz / 5e6)), start_s_(start_s) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (double rate = 0; rate < rate_hz;) {
    const double x0 = uniform(random) * width, y0 = uniform(random) * height;
    const double angle = uniform(random) * M_PI;
    const int length_px = 20 + static_cast<int>(uniform(random) * 60);
    const auto polarity = static_cast<std::uint8_t>(uniform(random) < 0.5);
    const double piece_rate = speed_px_s_ * std::abs(std::sin(angle));
    if (piece_rate < 1) continue;  // moves along itself
    for (int i = 0; i < length_px; ++i) {
      const double x = x0 + i * std::cos(angle), y = y0 + i * std::sin(angle);
      if (y < 0 || y > height - 1) continue;
      const double step_px = speed_px_s_ / piece_rate;
      pieces_.push_back({x, y, step_px, uniform(random) * step_px, polarity});
      rate += piece_rate;
    }
  }
}

double MovingEdges::WayAt_px(double t_s) const {
  if (t_s >= start_s_) return speed_px_s_ * (t_s - 0.5 * start_s_);
  return 0.5 * speed_px_s_ / start_s_ * t_s * t_s;
}

double MovingEdges::TimeOf_s(double way_px) const {
  const double start_px = 0.5 * speed_px_s_ * start_s_;
  if (way_px >= start_px) return way_px / speed_px_s_ + 0.5 * start_s_;
  return std::sqrt(2 * start_s_ * way_px / speed_px_s_);
}

double MovingEdges::WayAt_m(std::int64_t t_ns) const { return WayAt_px(SecondsFromNs(t_ns)) * kDepth_m / camera_.fx(); }

void MovingEdges::Advance(double duration_s, std::vector<Event>* events) {
  const double end_s = SecondsFromNs(t_ns_) + duration_s, end_px = WayAt_px(end_s);
  const std::size_t first = events->size();
  for (Piece& piece : pieces_) {
    for (; piece.next_px < end_px; piece.next_px += piece.step_px) {
      const double x = Wrapped(piece.x - piece.next_px, camera_.width());
      Event event;
      event.t_ns = NsFromSeconds(TimeOf_s(piece.next_px));
      event.x = static_cast<std::uint16_t>(std::min(std::floor(x + 0.5), camera_.width() - 1.0));
      event.y = static_cast<std::uint16_t>(piece.y + 0.5);
      event.polarity = piece.polarity;
      events->push_back(event);
    }
  }
  std::sort(events->begin() + static_cast<std::ptrdiff_t>(first), events->end(),
            [](const Event& a, const Event& b) { return a.t_ns < b.t_ns; });
  t_ns_ = NsFromSeconds(end_s);
}

Vector6d MovingEdges::velocity_event() const {
  Vector6d velocity = Vector6d::Zero();
  velocity[0] = speed_px_s_ * kDepth_m / camera_.fx();
  return velocity;
}

SceneDepth MovingEdges::scene_depth() const {
  SceneDepth depth;
  depth.t_ns = t_ns_;
  depth.median_m = kDepth_m;
  return depth;
}

Rig MovingEdges::rig() const {
  Rig rig;
  rig.event_camera = camera_;
  rig.depth_camera = Camera(640, 576, 504, 504, 321, 335, "none", {});
  rig.T_event_depth = Rigid3::Translation({0.07, 0, 0});
  return rig;
}

DepthImage MovingEdges::depth_image() const { return {t_ns_, cv::Mat1f(576, 640, static_cast<float>(kDepth_m))}; }

}  // namespace devo
