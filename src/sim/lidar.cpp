// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/lidar.h"

#include <cmath>

#include "devo/sim/random.h"

namespace devo::sim {

LidarScan Lidar::Capture(const Trajectory& trajectory, double t_s, std::uint64_t index, ThreadPool* pool) const {
  constexpr double kPi = 3.14159265358979323846;
  const int columns = static_cast<int>(1 / (model_.rate_hz * model_.firing_s));
  std::vector<std::vector<LidarPoint>> found(columns);
  pool->ForEach(columns, [&](int column) {
    const double t = column * model_.firing_s;
    // Within one firing of 55 us even fast motion is below 0.1 mm; each firing has its own pose.
    const View view(scene_, trajectory.PoseAt(t_s + t) * model_.T_event_lidar, t_s + t);
    for (int beam = 0; beam < model_.beams; ++beam) {
      const double time = t + beam * model_.beam_s;
      const double azimuth = -2 * kPi * time * model_.rate_hz;  // clockwise seen from above
      const double elevation =
          kPi / 180 * (model_.lowest_deg + (model_.highest_deg - model_.lowest_deg) * beam / (model_.beams - 1));
      const Eigen::Vector3d d(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                              std::sin(elevation));
      const Hit hit = view.Trace(static_cast<float>(d.x()), static_cast<float>(d.y()), static_cast<float>(d.z()));
      if (hit.surface < 0 || hit.distance < model_.min_range_m || hit.distance > model_.max_range_m) continue;
      Rng rng(seed_, Mix(index) ^ 0x11da2, static_cast<std::uint64_t>(column) * model_.beams + beam);
      const Eigen::Vector3f p = ((hit.distance + model_.noise_m * rng.Gaussian()) * d).cast<float>();
      found[column].push_back({p.x(), p.y(), p.z(), 255 * InfraredReflectance(scene_, hit, 0.003F * hit.distance),
                               static_cast<std::uint16_t>(beam), static_cast<float>(time)});
    }
  });
  LidarScan scan;
  for (const auto& points : found) scan.points.insert(scan.points.end(), points.begin(), points.end());
  return scan;
}

}  // namespace devo::sim
