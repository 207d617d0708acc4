// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/run_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <utility>

#include <nlohmann/json.hpp>

#include "devo/core/time.h"

namespace devo {
namespace {

using Json = nlohmann::json;

Json StageJson(const std::vector<float>& ms) {
  Json json;
  json["count"] = ms.size();
  json["p50"] = Percentile(ms, 0.5);
  json["p95"] = Percentile(ms, 0.95);
  json["p99"] = Percentile(ms, 0.99);
  json["max"] = Percentile(ms, 1.0);
  return json;
}

Json CalibrationJson(const InertialCalibration& calibration) {
  const auto xyz = [](const Eigen::Vector3d& v) { return Json{v.x(), v.y(), v.z()}; };
  return {{"gyroscope_bias_rad_s", xyz(calibration.gyroscope_bias)},
          {"gyroscope_scale", xyz(calibration.gyroscope_scale)},
          {"accelerometer_bias_m_s2", xyz(calibration.accelerometer_bias)},
          {"accelerometer_scale", calibration.accelerometer_scale},
          {"rotation_rad", xyz(calibration.rotation)},
          {"translation_m", xyz(calibration.translation_m)}};
}

/// The work from a surface's events to its pose. Offline nothing queues; filtering, done ahead of the last event,
/// counts.
std::vector<float> EventToPose(const Odometry::Timings& timings) {
  std::vector<float> ms(std::min(timings.surface_ms.size(), timings.tracking_ms.size()));
  for (std::size_t i = 0; i < ms.size(); ++i) ms[i] = timings.surface_ms[i] + timings.tracking_ms[i];
  return ms;
}

}  // namespace

double Percentile(std::vector<float> values, double p) {
  if (values.empty()) return 0;
  const double rank = std::ceil(p * static_cast<double>(values.size()));
  const std::size_t index = static_cast<std::size_t>(std::max(1.0, rank)) - 1;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(index), values.end());
  return values[index];
}

void RunReport::AddPose(const PoseEstimate& estimate) {
  ++poses_by_state_[static_cast<int>(estimate.state)];
  if (estimate.state == TrackingState::kInitialising) return;
  if (!first_reference_ns_) first_reference_ns_ = estimate.t_ns;
  const bool lost = estimate.state == TrackingState::kLost;
  if (lost && !lost_now_) lost_.push_back({estimate.t_ns, estimate.t_ns});
  if (lost || lost_now_) lost_.back().end_ns = estimate.t_ns;
  lost_now_ = lost;
  if (lost) return;
  trajectory_.push_back({estimate.t_ns, estimate.T_world_event});
  covariances_.push_back(estimate.covariance_event);
  delays_ = estimate.delays;
  inertial_calibration_ = estimate.inertial_calibration;
  const InertialFit& fit = estimate.inertial_fit;
  if (fit.gyroscope > 0 || fit.left_out) inertial_fits_.push_back(fit);
  chapters_ = std::max(chapters_, estimate.chapter + 1);
}

double RunReport::Coverage(std::int64_t end) const {
  if (!first_reference_ns_ || end < *first_reference_ns_) return 0;
  const double ticks = std::floor(SecondsFromNs(end - *first_reference_ns_) * rate_hz_ + 1e-6) + 1;
  return std::min(1.0, static_cast<double>(trajectory_.size()) / ticks);
}

InertialFit RunReport::inertial_fit() const {
  const auto median = [this](double InertialFit::*of) {
    std::vector<float> values;
    values.reserve(inertial_fits_.size());
    for (const InertialFit& fit : inertial_fits_) values.push_back(static_cast<float>(fit.*of));
    return Percentile(std::move(values), 0.5);
  };
  const auto left_out =
      std::count_if(inertial_fits_.begin(), inertial_fits_.end(), std::mem_fn(&InertialFit::left_out));
  return {median(&InertialFit::gyroscope),           median(&InertialFit::accelerometer),
          median(&InertialFit::force_m_s2),          median(&InertialFit::gyroscope_noise),
          median(&InertialFit::accelerometer_noise), 2 * static_cast<std::size_t>(left_out) > inertial_fits_.size()};
}

double RunReport::RealTimeFactor() const { return wall_s > 0 ? SecondsFromNs(end_ns - begin_ns) / wall_s : 0; }

std::string RunReport::ToJson() const {
  Json json;
  json["error"] = error.empty() ? Json(nullptr) : Json(error);
  json["warnings"] = warnings;
  json["poses"] = trajectory_.size();
  json["coverage"] = Coverage(end_ns);
  json["first_pose_after_s"] = FirstPoseAfter_s();
  json["chapters"] = chapters_;
  json["event_delay_ms"] = 1e3 * delays_.event_s;
  json["depth_delay_ms"] = 1e3 * delays_.depth_s;
  json["imu_delay_ms"] = 1e3 * delays_.inertial_s;
  const InertialFit fit = inertial_fit();
  json["inertial_fit"] = {{"gyroscope", fit.gyroscope},
                          {"accelerometer", fit.accelerometer},
                          {"force_m_s2", fit.force_m_s2},
                          {"gyroscope_noise_deg_s_sqrt_hz", 180 / M_PI * fit.gyroscope_noise},
                          {"accelerometer_noise_m_s2_sqrt_hz", fit.accelerometer_noise},
                          {"left_out", fit.left_out},
                          {"complaint", Complaint(fit)}};
  json["inertial_calibration"] = inertial_calibration_ ? CalibrationJson(*inertial_calibration_) : Json(nullptr);
  for (const auto state : {TrackingState::kInitialising, TrackingState::kTracking, TrackingState::kDegraded,
                           TrackingState::kLost, TrackingState::kRecovered}) {
    json["poses_by_state"][ToString(state)] = poses_by_state_[static_cast<int>(state)];
  }
  json["lost_intervals"] = Json::array();
  for (const Interval& lost : lost_) {
    json["lost_intervals"].push_back(
        {{"begin_s", SecondsFromNs(lost.begin_ns)}, {"end_s", SecondsFromNs(lost.end_ns)}});
  }
  json["references"] = counters.mapping.references;
  json["map_points"] = map_points;
  json["begin_s"] = SecondsFromNs(begin_ns);
  json["end_s"] = SecondsFromNs(end_ns);
  json["first_pose_s"] = trajectory_.empty() ? Json(nullptr) : Json(SecondsFromNs(trajectory_.front().t_ns));
  json["path_length_m"] = PathLength(trajectory_);
  const std::uint64_t dropped = counters.events.outside + counters.events.unordered;
  json["events"] = {{"in", counters.events.in},
                    {"used", counters.events.in - dropped},
                    {"dropped", dropped},
                    {"outside", counters.events.outside},
                    {"unordered", counters.events.unordered},
                    {"of_lamps", counters.events.of_lamps},
                    {"summed_over_surfaces", counters.events.used}};
  json["depth_frames"] = {{"in", counters.mapping.depth_in},
                          {"used", counters.mapping.depth_used},
                          {"aligned", counters.mapping.depth_aligned},
                          {"without_moving_thing", counters.mapping.depth_without_thing},
                          {"jumps", counters.mapping.depth_jumps},
                          {"repeated", counters.mapping.depth_repeated},
                          {"too_late", counters.mapping.depth_too_late},
                          {"without_valid_pixel", counters.mapping.depth_without_valid_pixel},
                          {"skipped_by_rate", depth_skipped_by_rate},
                          {"unordered", depth_unordered}};
  json["milliseconds"] = {{"time_surface", StageJson(timings.surface_ms)},
                          {"mapping", StageJson(timings.mapping_ms)},
                          {"tracking", StageJson(timings.tracking_ms)},
                          {"event_to_pose", StageJson(EventToPose(timings))}};
  json["wall_s"] = wall_s;
  json["cpu_s"] = cpu_s;
  json["real_time_factor"] = RealTimeFactor();
  json["peak_memory_mb"] = peak_memory_mb;
  json["evaluation"] = evaluation ? Json::parse(devo::ToJson(*evaluation)) : Json(nullptr);
  json["configuration"] = configuration;
  return json.dump(2);
}

double RunReport::FirstPoseAfter_s() const {
  return trajectory_.empty() ? 0 : SecondsFromNs(trajectory_.front().t_ns - begin_ns);
}

std::string RunReport::Summary() const {
  char line[256];
  std::snprintf(line, sizeof(line),
                "%zu poses, the first after %.2f s, coverage from there %.1f %%, lost %zu times, %llu references, %.1f "
                "times real time\n",
                trajectory_.size(), FirstPoseAfter_s(), 100 * Coverage(end_ns), lost_.size(),
                static_cast<unsigned long long>(counters.mapping.references), RealTimeFactor());
  std::string text = line;
  if (evaluation) {
    std::snprintf(line, sizeof(line), "ATE %.2f cm (%s), ", 100 * evaluation->ate_rmse_m,
                  DriftText(*evaluation, 2).c_str());
    text += line;
    if (evaluation->rpe_pairs > 0) {
      std::snprintf(line, sizeof(line), "RPE over 1 s %.2f deg, %.2f cm\n", evaluation->rpe_rotation_rmse_deg,
                    evaluation->rpe_translation_rmse_cm);
    } else {
      std::snprintf(line, sizeof(line), "first to last %.2f deg, %.2f cm\n", evaluation->final_rotation_deg,
                    100 * evaluation->final_translation_m);
    }
    text += line;
  }
  return text;
}

}  // namespace devo
