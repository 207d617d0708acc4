// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/trajectory.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr std::int64_t kNsPerSecond = 1000000000;

// A double holds absolute stamps of today only to 0.2 us, so the digits are read as integers.
bool ParseStamp(const char** text, std::int64_t* t_ns) {
  char* end = nullptr;
  const double whole = std::strtod(*text, &end);
  if (end == *text || !(std::abs(whole) < 9e9)) return false;
  const std::string digits(*text, static_cast<std::size_t>(end - *text));
  *text = end;
  if (digits.find_first_not_of("0123456789.") != std::string::npos) {  // exponents, signs: no absolute stamp
    *t_ns = NsFromSeconds(whole);
    return true;
  }
  const std::size_t dot = std::min(digits.find('.'), digits.size());
  std::string fraction = dot < digits.size() ? digits.substr(dot + 1) : "";
  fraction.resize(9, '0');
  *t_ns = std::atoll(digits.substr(0, dot).c_str()) * kNsPerSecond + std::atoll(fraction.c_str());
  return true;
}

bool ParseLine(const std::string& line, StampedPose* pose) {
  const char* text = line.c_str();
  if (!ParseStamp(&text, &pose->t_ns)) return false;
  double v[7];
  for (double& value : v) {
    char* end = nullptr;
    value = std::strtod(text, &end);
    if (end == text || !std::isfinite(value)) return false;
    text = end;
  }
  const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  if (!(q.norm() > 1e-6)) return false;
  pose->T_world_body = Rigid3(q, {v[0], v[1], v[2]});
  return true;
}

}  // namespace

std::string TumLine(const StampedPose& pose) {
  const Eigen::Vector3d& p = pose.T_world_body.translation();
  Eigen::Quaterniond q = pose.T_world_body.rotation();
  if (q.w() < 0) q.coeffs() *= -1;
  char line[256];
  std::snprintf(line, sizeof(line), "%lld.%09lld %.7f %.7f %.7f %.9f %.9f %.9f %.9f",
                static_cast<long long>(pose.t_ns / kNsPerSecond), static_cast<long long>(pose.t_ns % kNsPerSecond),
                p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w());
  return line;
}

Trajectory ReadTum(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("trajectory '" + path + "': cannot be opened; expected a TUM file");
  Trajectory trajectory;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    StampedPose pose;
    if (!ParseLine(line.substr(first), &pose)) {
      throw std::runtime_error(
          "trajectory '" + path + "' line " + std::to_string(number) +
          ": expected 't tx ty tz qx qy qz qw' with finite numbers and a quaternion that is not zero");
    }
    trajectory.push_back(pose);
  }
  if (file.bad()) throw std::runtime_error("trajectory '" + path + "': cannot be read; expected a TUM file");
  SortByTime(&trajectory);
  return trajectory;
}

void WriteTum(const std::string& path, const Trajectory& trajectory) {
  std::ofstream file(path);
  for (const StampedPose& pose : trajectory) file << TumLine(pose) << '\n';
  file.flush();
  if (!file) throw std::runtime_error("trajectory '" + path + "': cannot be written");
}

std::string WithEpoch(const std::string& path, std::uint64_t epoch) {
  const std::filesystem::path file(path);
  const std::string name = file.stem().string() + "_epoch" + std::to_string(epoch) + file.extension().string();
  return (file.parent_path() / name).string();
}

void SortByTime(Trajectory* trajectory) {
  std::stable_sort(trajectory->begin(), trajectory->end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.t_ns < b.t_ns; });
  trajectory->erase(std::unique(trajectory->begin(), trajectory->end(),
                                [](const StampedPose& a, const StampedPose& b) { return a.t_ns == b.t_ns; }),
                    trajectory->end());
}

std::optional<Rigid3> PoseAt(const Trajectory& trajectory, std::int64_t t_ns, std::int64_t max_gap_ns) {
  const auto after = std::lower_bound(trajectory.begin(), trajectory.end(), t_ns,
                                      [](const StampedPose& pose, std::int64_t t) { return pose.t_ns < t; });
  if (after == trajectory.end()) return std::nullopt;
  if (after->t_ns == t_ns) return after->T_world_body;
  if (after == trajectory.begin()) return std::nullopt;
  const StampedPose& before = *(after - 1);
  const std::int64_t gap_ns = after->t_ns - before.t_ns;
  if (gap_ns > max_gap_ns) return std::nullopt;
  const double share = static_cast<double>(t_ns - before.t_ns) / static_cast<double>(gap_ns);
  return Interpolate(before.T_world_body, after->T_world_body, share);
}

double PathLength(const Trajectory& trajectory) {
  double length = 0;
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    length += (trajectory[i].T_world_body.translation() - trajectory[i - 1].T_world_body.translation()).norm();
  }
  return length;
}

}  // namespace devo
