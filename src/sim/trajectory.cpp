// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/trajectory.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "devo/sim/random.h"

namespace devo::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDifference_s = 5e-4;  // half the span of numeric derivatives

/// Integral of the quintic step 10 x^3 - 15 x^4 + 6 x^5, whose ends have neither speed nor acceleration.
double SmoothIntegral(double x) { return x * x * x * x * (2.5 + x * (-3 + x)); }

/// Camera at p, optical axis towards the target, image upright, then turned by the angles about its own axes (rad).
Rigid3 LookAt(const Eigen::Vector3d& p, const Eigen::Vector3d& target, const Eigen::Vector3d& angles) {
  const Eigen::Vector3d z = (target - p).normalized(), x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d R;
  R << x, z.cross(x), z;
  return {Eigen::Quaterniond(R) * ExpSO3(angles), p};
}

Eigen::Vector3d RandomBetween(Rng& rng, const Eigen::Vector3d& lo, const Eigen::Vector3d& hi) {
  Eigen::Vector3d p;
  for (int i = 0; i < 3; ++i) p[i] = rng.Uniform(lo[i], hi[i]);
  return p;
}

/// Random position at most `step` away from the last (per axis), inside the bounds.
Eigen::Vector3d Wander(Rng& rng, const Eigen::Vector3d& last, const Eigen::Vector3d& lo, const Eigen::Vector3d& hi,
                       double step) {
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(step);
  return RandomBetween(rng, (last - reach).cwiseMax(lo), (last + reach).cwiseMin(hi));
}

/// What a random control pose is made of: position, point looked at, turns about the camera's axes in units of the
/// motion's turning.
struct Waypoint {
  Eigen::Vector3d position, target, angles;
};

Eigen::Vector3d RandomAngles(Rng& rng) { return RandomBetween(rng, {-1, -1, -0.7}, {1, 1, 0.7}); }

Waypoint FirstWaypoint(Rng& rng, const MotionVolume& v) {
  return {RandomBetween(rng, v.position_min, v.position_max), RandomBetween(rng, v.target_min, v.target_max),
          RandomAngles(rng)};
}

Waypoint NextWaypoint(Rng& rng, const MotionVolume& v, const Waypoint& last) {
  const double step = 0.5 * (v.position_max - v.position_min).mean();
  return {Wander(rng, last.position, v.position_min, v.position_max, step),
          Wander(rng, last.target, v.target_min, v.target_max, step), RandomAngles(rng)};
}

std::vector<Rigid3> ControlPoses(const std::vector<Waypoint>& waypoints, double turn_rad) {
  std::vector<Rigid3> poses;
  poses.reserve(waypoints.size());
  for (const auto& w : waypoints) poses.push_back(LookAt(w.position, w.target, turn_rad * w.angles));
  return poses;
}

struct ScaledMotion {
  std::vector<Rigid3> control;
  double knot_s;
};
MotionLimits FastestOf(const Trajectory& unit);

/// Turns as much as it takes for both limits to be reached, but keeps the scene in view.
ScaledMotion ScaleToLimits(const std::vector<Waypoint>& waypoints, const MotionLimits& limits) {
  ScaledMotion motion{{}, 0};
  double turn = 0.2;
  for (int iteration = 0; iteration < 4; ++iteration) {
    motion.control = ControlPoses(waypoints, turn);
    const MotionLimits reached = FastestOf(Trajectory(motion.control, 1.0));
    const double by_speed = reached.speed_m_s / limits.speed_m_s, by_rate = reached.rate_rad_s / limits.rate_rad_s;
    motion.knot_s = 1.02 * std::max(by_speed, by_rate);
    turn = std::clamp(turn * by_speed / by_rate, 0.05, 0.4);
  }
  return motion;
}

/// Control points of a loop: what is between the last and the first waypoint is spread over all, everything is drawn
/// towards the first by `size`, and the first three follow again, so that a uniform cubic spline ends as it begins.
std::vector<Waypoint> Loop(std::vector<Waypoint> waypoints, double size) {
  const Waypoint first = waypoints.front(), last = waypoints.back();
  waypoints.pop_back();
  const double count = static_cast<double>(waypoints.size());
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    Waypoint& w = waypoints[i];
    const double share = static_cast<double>(i) / count;
    w.position = first.position + size * (w.position + share * (first.position - last.position) - first.position);
    w.target = first.target + size * (w.target + share * (first.target - last.target) - first.target);
    w.angles *= size;
  }
  for (int i = 0; i < 3; ++i) waypoints.push_back(waypoints[i]);
  return waypoints;
}

/// Greatest speed and rate of a trajectory with knots 1 s apart.
MotionLimits FastestOf(const Trajectory& unit) {
  MotionLimits fastest{0, 0};
  for (double s = 0.05; s < unit.duration_s(); s += 0.05) {
    const Vector6d twist = unit.VelocityAt(s);
    fastest.speed_m_s = std::max(fastest.speed_m_s, twist.head<3>().norm());
    fastest.rate_rad_s = std::max(fastest.rate_rad_s, twist.tail<3>().norm());
  }
  return fastest;
}

}  // namespace

Trajectory::Trajectory(std::vector<Rigid3> control_poses, double knot_s)
    : control_(std::move(control_poses)), knot_s_(knot_s) {
  if (control_.size() < 4) {
    throw std::invalid_argument("trajectory with " + std::to_string(control_.size()) +
                                " control poses; expected at least 4");
  }
  if (!(knot_s > 0)) throw std::invalid_argument("trajectory with a knot spacing of " + std::to_string(knot_s) + " s");
}

Rigid3 Trajectory::SplineAt(double s) const {
  const int segments = static_cast<int>(control_.size()) - 3;
  const double position = std::clamp(s / knot_s_, 0.0, static_cast<double>(segments));
  const int i = std::min(static_cast<int>(position), segments - 1);
  const double u = position - i, u2 = u * u, u3 = u2 * u;
  const double b[3] = {(5 + 3 * u - 3 * u2 + u3) / 6, (1 + 3 * u + 3 * u2 - 2 * u3) / 6, u3 / 6};
  Rigid3 T = control_[i];
  for (int k = 0; k < 3; ++k) T = T * Exp(b[k] * Log(control_[i + k].inverse() * control_[i + k + 1]));
  return T;
}

void Trajectory::SetPauses(double rest_s, const std::vector<Stop>& stops, double ramp_s) {
  ramps_.clear();
  if (rest_s > 0) {
    ramps_.push_back({0, 0, 1, 0});
    ramps_.push_back({rest_s, ramp_s, 0, 1});
  }
  std::vector<Stop> ordered = stops;
  std::sort(ordered.begin(), ordered.end(), [](const Stop& a, const Stop& b) { return a.begin_s < b.begin_s; });
  for (const auto& stop : ordered) {
    const double brake = stop.begin_s - ramp_s;
    if (!ramps_.empty() && brake < ramps_.back().begin_s + ramps_.back().duration_s) {
      throw std::invalid_argument("stop at " + std::to_string(stop.begin_s) +
                                  " s begins before the motion before it is at speed");
    }
    ramps_.push_back({brake, ramp_s, 1, 0});
    ramps_.push_back({stop.begin_s + stop.duration_s, ramp_s, 0, 1});
  }
}

Trajectory Trajectory::MovedTo(const Rigid3& T_camera_other) const {
  // Exact: (C T) Exp(b Log((C T)^-1 C' T)) = C Exp(b Log(C^-1 C')) T.
  Trajectory moved = *this;
  for (Rigid3& T : moved.control_) T = T * T_camera_other;
  return moved;
}

double Trajectory::SplineTime(double t) const {
  double s = 0, from = 0, speed = 1;
  for (const auto& ramp : ramps_) {
    if (t <= ramp.begin_s) break;
    s += speed * (ramp.begin_s - from);
    from = ramp.begin_s;
    speed = ramp.to;
    if (ramp.duration_s <= 0) continue;
    const double x = std::min(1.0, (t - ramp.begin_s) / ramp.duration_s);
    s += ramp.duration_s * (ramp.from * x + (ramp.to - ramp.from) * SmoothIntegral(x));
    from += x * ramp.duration_s;
  }
  return s + speed * std::max(0.0, t - from);
}

Rigid3 Trajectory::PoseAt(double t_s) const { return SplineAt(SplineTime(t_s)); }

Vector6d Trajectory::VelocityAt(double t) const {
  const Rigid3 T = PoseAt(t - kDifference_s).inverse() * PoseAt(t + kDifference_s);
  // The twist of the middle, seen from the middle: half of it is undone, Ad(Exp(-xi/2)) xi = xi.
  return Log(T) / (2 * kDifference_s);
}

Eigen::Vector3d Trajectory::AccelerationAt(double t) const {
  constexpr double h = 4 * kDifference_s;
  return (PoseAt(t + h).translation() - 2 * PoseAt(t).translation() + PoseAt(t - h).translation()) / (h * h);
}

double Trajectory::duration_s() const {
  const double spline = knot_s_ * static_cast<double>(control_.size() - 3);
  double lost = 0;
  for (std::size_t i = 0; i < ramps_.size(); ++i) {
    lost += 0.5 * ramps_[i].duration_s;
    if (ramps_[i].to == 0 && i + 1 < ramps_.size())
      lost += ramps_[i + 1].begin_s - ramps_[i].begin_s - ramps_[i].duration_s;
  }
  return spline + lost;
}

Trajectory Trajectory::Fit(const std::vector<double>& times_s, const std::vector<Rigid3>& poses) {
  if (times_s.size() != poses.size() || poses.size() < 4) {
    throw std::invalid_argument("trajectory of " + std::to_string(poses.size()) + " poses; expected at least 4");
  }
  for (std::size_t i = 1; i < times_s.size(); ++i) {
    if (!(times_s[i] > times_s[i - 1])) {
      throw std::invalid_argument("trajectory's pose " + std::to_string(i) + " is not later than the one before it");
    }
  }
  const double span = times_s.back() - times_s.front();
  const int segments = static_cast<int>(poses.size()) - 1;
  const double knot = span / segments;
  std::vector<Rigid3> samples(segments + 1);
  for (std::size_t k = 0, j = 0; k < samples.size(); ++k) {
    const double t = times_s.front() + knot * static_cast<double>(k);
    while (j + 2 < poses.size() && times_s[j + 1] < t) ++j;
    samples[k] = Interpolate(poses[j], poses[j + 1], (t - times_s[j]) / (times_s[j + 1] - times_s[j]));
  }
  // The spline at knot k is pulled to sample k by moving control pose k + 1; the iteration converges because the
  // B-spline's collocation matrix is totally positive.
  std::vector<Rigid3> control(samples.size() + 2);
  for (std::size_t k = 0; k < samples.size(); ++k) control[k + 1] = samples[k];
  for (int iteration = 0; iteration < 60; ++iteration) {
    control.front() = control[1] * Exp(-Log(control[1].inverse() * control[2]));
    const std::size_t n = control.size();
    control[n - 1] = control[n - 2] * Exp(Log(control[n - 3].inverse() * control[n - 2]));
    const Trajectory spline(control, knot);
    double worst = 0;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const Vector6d error = Log(spline.SplineAt(knot * static_cast<double>(k)).inverse() * samples[k]);
      control[k + 1] = control[k + 1] * Exp(error);
      worst = std::max(worst, error.norm());
    }
    if (worst < 1e-9) break;
  }
  return Trajectory(control, knot);
}

MotionLimits LimitsOf(const std::string& speed) {
  if (speed == "slow") return {0.3, 30 * kPi / 180};
  if (speed == "mid") return {0.8, 80 * kPi / 180};
  if (speed == "fast") return {1.5, 200 * kPi / 180};
  throw std::invalid_argument("speed '" + speed + "' is not known; expected one of slow, mid, fast");
}

Trajectory RandomTrajectory(const MotionVolume& volume, const MotionLimits& limits, double duration_s,
                            std::uint64_t seed) {
  Rng rng(seed, 0x7a1ec7);
  std::vector<Waypoint> waypoints = {FirstWaypoint(rng, volume)};
  // Longer splines may be faster somewhere and need wider knots, hence fewer of them: grow until long enough.
  while (true) {
    for (int i = 0; i < 24; ++i) waypoints.push_back(NextWaypoint(rng, volume, waypoints.back()));
    const ScaledMotion motion = ScaleToLimits(waypoints, limits);
    if (motion.knot_s * static_cast<double>(motion.control.size() - 3) > duration_s + 0.1)
      return Trajectory(motion.control, motion.knot_s);
  }
}

Trajectory ClosedTrajectory(const MotionVolume& volume, const MotionLimits& limits, double duration_s,
                            std::uint64_t seed) {
  constexpr std::size_t kFewest = 5;  // four different ones make a loop
  const auto needs_s = [](const ScaledMotion& m) { return m.knot_s * static_cast<double>(m.control.size() - 3); };
  Rng rng(seed, 0x7a1ec7);
  std::vector<Waypoint> waypoints = {FirstWaypoint(rng, volume)};
  while (waypoints.size() < kFewest) waypoints.push_back(NextWaypoint(rng, volume, waypoints.back()));
  ScaledMotion motion = ScaleToLimits(Loop(waypoints, 1), limits);
  double size = 1;
  for (int i = 0; i < 20 && needs_s(motion) > duration_s; ++i) {
    size *= std::min(0.95, duration_s / needs_s(motion));
    motion = ScaleToLimits(Loop(waypoints, size), limits);
  }
  while (size == 1) {  // as many waypoints as the limits leave time for
    waypoints.push_back(NextWaypoint(rng, volume, waypoints.back()));
    const ScaledMotion longer = ScaleToLimits(Loop(waypoints, 1), limits);
    if (needs_s(longer) > duration_s) break;
    motion = longer;
  }
  return Trajectory(motion.control, duration_s / static_cast<double>(motion.control.size() - 3));
}

Trajectory TrajectoryFromTum(const std::string& path, double* first_time_s) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("trajectory file '" + path + "' cannot be read");
  std::vector<double> times;
  std::vector<Rigid3> poses;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const auto begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    std::istringstream in(line);
    double t, x, y, z, qx, qy, qz, qw;
    if (!(in >> t >> x >> y >> z >> qx >> qy >> qz >> qw) || !(qx * qx + qy * qy + qz * qz + qw * qw > 1e-6)) {
      throw std::runtime_error("trajectory file '" + path + "', line " + std::to_string(number) +
                               ": expected `t tx ty tz qx qy qz qw`");
    }
    times.push_back(t);
    poses.emplace_back(Eigen::Quaterniond(qw, qx, qy, qz), Eigen::Vector3d(x, y, z));
  }
  if (first_time_s != nullptr && !times.empty()) *first_time_s = times.front();
  try {
    return Trajectory::Fit(times, poses);
  } catch (const std::invalid_argument& e) {
    throw std::runtime_error("trajectory file '" + path + "': " + e.what());
  }
}

}  // namespace devo::sim
