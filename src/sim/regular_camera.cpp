// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/regular_camera.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace devo::sim {
namespace {

constexpr double kFlowPerView_px = 2;
constexpr int kMostViews = 12;
constexpr double kTypicalDistance_m = 1;

}  // namespace

RegularCameraModel VectorRegularCamera() {
  RegularCameraModel m;
  m.camera = Camera(1224, 1024, 886.19107, 886.59163, 610.57891, 514.59271, "plumb_bob",
                    {-0.315760, 0.104955, 0.000320, -0.000156, 0.0});
  Eigen::Matrix3d R;  // of the left event camera in the left regular camera
  R << 0.99994074, 0.00918366, 0.00584692, -0.00913136, 0.99991863, -0.00890807, -0.00592825, 0.00885415, 0.99994323;
  const Rigid3 T_camera_event(Eigen::Quaterniond(R).normalized(), {0.00050858, -0.04081979, -0.01407813});
  m.T_event_camera = T_camera_event.inverse();
  return m;
}

RegularCamera::RegularCamera(const Scene& scene, const RegularCameraModel& model, const Light& light,
                             std::uint64_t seed)
    : scene_(scene), model_(model), rays_(model.camera), sensor_(light, rays_.stride(), model.camera, seed ^ 0x5e9) {}

int RegularCamera::ViewsFor(const Vector6d& twist) const {
  const double flow_px_s = (twist.tail<3>().norm() + twist.head<3>().norm() / kTypicalDistance_m) * model_.camera.fx();
  return std::clamp(static_cast<int>(std::ceil(flow_px_s * exposure_s() / kFlowPerView_px)), 1, kMostViews);
}

Frame RegularCamera::Capture(const Trajectory& trajectory, double begin_s, std::int64_t begin_ns, ThreadPool* pool) {
  const int steps = ViewsFor(trajectory.VelocityAt(begin_s + 0.5 * exposure_s()));
  const double step_s = exposure_s() / steps;
  std::vector<View> views;
  for (int k = 0; k <= steps; ++k) {
    const double t_s = begin_s + k * step_s;
    views.emplace_back(scene_, trajectory.PoseAt(t_s) * model_.T_event_camera, t_s);
  }
  sensor_.Start(begin_ns, model_.rate_hz);
  pool->ForEach(rays_.tile_rows(), [&](int band) {
    BandRenderer renderer(scene_, rays_);
    const int first = band * RayGrid::kTile, last = std::min(first + RayGrid::kTile, rays_.height());
    std::vector<float> nearest(rays_.tile_columns());
    std::vector<float> before(static_cast<std::size_t>(RayGrid::kTile) * rays_.stride()), after(before.size());
    renderer.Render(views[0], band, before.data(), nearest.data());
    for (int k = 1; k <= steps; ++k, before.swap(after)) {
      renderer.Render(views[k], band, after.data(), nearest.data());
      for (int row = first; row < last; ++row) {
        const std::size_t at = static_cast<std::size_t>(row - first) * rays_.stride();
        sensor_.ExposeRow(row, static_cast<float>(step_s), &before[at], &after[at]);
      }
    }
  });
  std::vector<Frame> frames;
  sensor_.TakeFinished(begin_ns + static_cast<std::int64_t>(1e9), &frames);
  return frames.at(0);
}

}  // namespace devo::sim
