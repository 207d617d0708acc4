// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/trajectory_log.h"

#include <cmath>

namespace devo {
namespace {

constexpr std::size_t kPosesPerBlock = 4096;
constexpr std::int64_t kNsPerSecond = 1000000000;
constexpr double kPositionUnit_m = 1e-8;
constexpr double kReach_m = 20;  // from a block's origin: 2^31 units are 21.4 m
constexpr double kRotationUnit = 5e-10;

std::int32_t Units(double value, double unit) { return static_cast<std::int32_t>(std::lround(value / unit)); }

}  // namespace

void TrajectoryLog::Add(const StampedPose& pose) {
  const Eigen::Vector3d& p = pose.T_world_body.translation();
  const Eigen::Vector4d& q = pose.T_world_body.rotation().coeffs();
  if (blocks_.empty() || blocks_.back().records.size() == kPosesPerBlock ||
      !((p - blocks_.back().origin).cwiseAbs().maxCoeff() < kReach_m)) {
    blocks_.push_back({pose.t_ns, p, {}});
    blocks_.back().records.reserve(kPosesPerBlock);
  }
  Block& block = blocks_.back();
  const std::int64_t after_ns = pose.t_ns - block.begin_ns;
  const std::int64_t seconds = after_ns / kNsPerSecond - (after_ns % kNsPerSecond < 0 ? 1 : 0);
  Record record{};
  record.seconds = static_cast<std::int32_t>(seconds);
  record.nanoseconds = static_cast<std::uint32_t>(after_ns - kNsPerSecond * seconds);
  for (int i = 0; i < 3; ++i) record.position[i] = Units(p[i] - block.origin[i], kPositionUnit_m);
  for (int i = 0; i < 4; ++i) record.rotation[i] = Units(q[i], kRotationUnit);
  block.records.push_back(record);
  ++size_;
  if (size_ <= max_poses_) return;
  --size_;
  if (++forgotten_of_first_ < blocks_.front().records.size()) return;
  blocks_.pop_front();
  forgotten_of_first_ = 0;
}

Trajectory TrajectoryLog::Poses() const {
  Trajectory poses;
  poses.reserve(size_);
  std::size_t first = forgotten_of_first_;
  for (const Block& block : blocks_) {
    for (std::size_t k = first; k < block.records.size(); ++k) {
      const Record& record = block.records[k];
      Eigen::Vector3d p = block.origin;
      Eigen::Quaterniond q;
      for (int i = 0; i < 3; ++i) p[i] += kPositionUnit_m * record.position[i];
      for (int i = 0; i < 4; ++i) q.coeffs()[i] = kRotationUnit * record.rotation[i];
      poses.push_back({block.begin_ns + kNsPerSecond * record.seconds + record.nanoseconds, {q, p}});
    }
    first = 0;
  }
  return poses;
}

void TrajectoryLog::Clear() {
  blocks_.clear();
  size_ = forgotten_of_first_ = 0;
}

}  // namespace devo
