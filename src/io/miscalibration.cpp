// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/miscalibration.h"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "finite_number.h"

namespace devo {
namespace {

constexpr double kRadPerDeg = M_PI / 180;

/// Numbers between colons.
std::vector<double> NumbersOf(const std::string& key, const std::string& value, std::size_t count,
                              const char* expected) {
  std::vector<double> numbers;
  std::stringstream stream(value);
  bool good = true;
  for (std::string part; std::getline(stream, part, ':');) {
    const auto number = FiniteNumber(part);
    good = good && number;
    numbers.push_back(number.value_or(0));
  }
  if (!good || numbers.size() != count) {
    throw std::invalid_argument("disturbance '" + key + "=" + value + "': expected " + expected);
  }
  return numbers;
}

}  // namespace

bool Miscalibration::Add(const std::string& key, const std::string& value) {
  const auto vector = [&](Eigen::Vector3d* out, const char* expected) {
    *out = Eigen::Vector3d::Map(NumbersOf(key, value, 3, expected).data());
    return true;
  };
  const auto share = [&](double* out) {
    constexpr const char* kExpected = "a share above -1";
    *out = NumbersOf(key, value, 1, kExpected).front();
    if (*out <= -1) throw std::invalid_argument("disturbance '" + key + "=" + value + "': expected " + kExpected);
    return true;
  };
  if (key == "depth_rotation") return vector(&depth_rotation_deg, "X:Y:Z in degrees");
  if (key == "depth_translation") return vector(&depth_translation_m, "X:Y:Z in metres");
  if (key == "imu_rotation") return vector(&imu_rotation_deg, "X:Y:Z in degrees");
  if (key == "imu_translation") return vector(&imu_translation_m, "X:Y:Z in metres");
  if (key == "gyroscope_bias") return vector(&gyroscope_bias_deg_s, "X:Y:Z in degrees per second");
  if (key == "accelerometer_bias") return vector(&accelerometer_bias_m_s2, "X:Y:Z in m/s^2");
  if (key == "event_focal") return share(&event_focal);
  if (key == "depth_focal") return share(&depth_focal);
  if (key == "gyroscope_scale") return share(&gyroscope_scale);
  if (key == "accelerometer_scale") return share(&accelerometer_scale);
  return false;
}

Rig Miscalibration::Of(const Rig& rig) const {
  Rig out = rig;
  const bool depth_off = !depth_rotation_deg.isZero(0) || !depth_translation_m.isZero(0) || depth_focal != 0;
  if (event_focal != 0) out.event_camera = rig.event_camera.WithFocalLength(1 + event_focal);
  if (!depth_off) {
    if (rig.depth_registered) out.depth_camera = out.event_camera;
    return out;
  }
  if (depth_focal != 0 && !rig.depth_from_lidar) out.depth_camera = rig.depth_camera.WithFocalLength(1 + depth_focal);
  out.T_event_depth = Rigid3::Translation(depth_translation_m) * rig.T_event_depth *
                      Rigid3::Rotation(ExpSO3(kRadPerDeg * depth_rotation_deg));
  out.depth_registered = false;
  return out;
}

ImuSample Miscalibration::Of(const ImuSample& sample) const {
  const Eigen::Quaterniond turn = ExpSO3(kRadPerDeg * imu_rotation_deg);
  ImuSample out = sample;
  out.angular_velocity = (1 + gyroscope_scale) * (turn * sample.angular_velocity) + kRadPerDeg * gyroscope_bias_deg_s;
  out.linear_acceleration = (1 + accelerometer_scale) * (turn * sample.linear_acceleration) + accelerometer_bias_m_s2;
  out.p_event_imu += imu_translation_m;
  return out;
}

}  // namespace devo
