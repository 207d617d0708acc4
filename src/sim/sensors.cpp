// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/sensors.h"

#include <cmath>
#include <stdexcept>

namespace devo::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kElectron_C = 1.602e-19;

[[noreturn]] void Unknown(const std::string& what, const std::string& name, const std::vector<std::string>& known) {
  std::string list;
  for (const auto& k : known) list += (list.empty() ? "" : ", ") + k;
  throw std::invalid_argument(what + " '" + name + "' is not known; expected one of " + list);
}

}  // namespace

std::vector<std::string> EventSensorNames() {
  return {"gen3", "gen3_vector", "davis346", "davis346_mvsec", "davis240", "gen4"};
}

EventSensor MakeEventSensor(const std::string& name) {
  EventSensor s;
  s.name = name;
  if (name == "gen3") {  // 15 um pixels, 8 mm lens
    s.camera = Camera(640, 480, 533.6, 533.9, 322.7, 238.3, "plumb_bob", {-0.1121, 0.1087, 0.0006, -0.0004, 0.0});
  } else if (name == "gen3_vector") {  // the lens of VECtor's left event camera, as published
    s.camera = Camera(640, 480, 327.32749, 327.46184, 304.97749, 235.37621, "plumb_bob",
                      {-0.031982, 0.041966, -0.000507, -0.001031, 0.0});
  } else if (name == "davis346" || name == "davis346_mvsec") {  // 18.5 um, 4.7 mm; the address bus is slower
    s.camera = Camera(346, 260, 254.9, 254.6, 173.6, 128.9, "plumb_bob", {-0.3512, 0.1386, 0.0003, -0.0002, 0.0});
    s.pixel.readout_hz = 12e6;
    s.pixel.photocurrent_a_per_lux = 90e-15;
    s.pixel.bandwidth_hz_per_lux = 300;
    if (name == "davis346_mvsec") {  // a lens like that of MVSEC's left DAVIS
      s.camera = Camera(346, 260, 226.38, 226.15, 173.65, 133.73, "equidistant", {-0.048, 0.0113, -0.0554, 0.0215});
    }
  } else if (name == "davis240") {  // 18.5 um, 3.6 mm
    s.camera = Camera(240, 180, 198.2, 198.4, 121.3, 91.8, "plumb_bob", {-0.3684, 0.1509, -0.0003, -0.0002, 0.0});
    s.pixel.readout_hz = 12e6;
    s.pixel.photocurrent_a_per_lux = 90e-15;
    s.pixel.bandwidth_hz_per_lux = 300;
  } else if (name == "gen4") {  // 4.86 um stacked, 5 mm; small photodiodes behind a nearly full aperture
    s.camera = Camera(1280, 720, 1029.2, 1029.5, 641.8, 357.4, "plumb_bob", {-0.0983, 0.0921, 0.0004, 0.0003, 0.0});
    s.pixel.readout_hz = 1066e6;
    s.pixel.photocurrent_a_per_lux = 24e-15;
    s.pixel.bandwidth_hz_per_lux = 300;
    s.pixel.noise_power_factor = 0.6;
  } else {
    Unknown("event sensor", name, EventSensorNames());
  }
  return s;
}

EventPixelModel IdealPixel(double threshold) {
  EventPixelModel m;
  m.threshold_on = m.threshold_off = threshold;
  m.threshold_mismatch = m.refractory_s = m.noise_power_factor = m.leak_hz = m.hot_share = m.dark_current_lux = 0;
  m.parasitic_hz_per_lux = 0;
  m.limit_bandwidth = false;
  m.readout_hz = 1e12;
  return m;
}

double PhotoreceptorBandwidth(const EventPixelModel& m, double chip_lux) { return m.bandwidth_hz_per_lux * chip_lux; }

double NoiseSigma(const EventPixelModel& m, double chip_lux) {
  // Shot noise 2 q / I (relative, one-sided) through two poles: noise bandwidth pi/2 f1 f2 / (f1 + f2).
  const double f1 = PhotoreceptorBandwidth(m, chip_lux), f2 = m.follower_hz;
  const double density = m.noise_power_factor * 2 * kElectron_C / (m.photocurrent_a_per_lux * chip_lux);
  return std::sqrt(density * 0.5 * kPi * f1 * f2 / (f1 + f2));
}

double NoiseRate(const EventPixelModel& m, double chip_lux, double threshold) {
  if (!(m.noise_power_factor > 0)) return 0;
  const double sigma = NoiseSigma(m, chip_lux), z = threshold / sigma;
  return std::sqrt(PhotoreceptorBandwidth(m, chip_lux) * m.follower_hz) * std::exp(-0.5 * z * z);
}

std::vector<std::string> LightNames() { return {"bright", "darkish", "dim", "dark", "hdr"}; }

Light MakeLight(const std::string& name) {
  Light light;
  if (name == "bright") {
    light.mean_lux = 500;
  } else if (name == "darkish") {
    light.mean_lux = 100;
  } else if (name == "dim") {
    light.mean_lux = 20;
  } else if (name == "dark") {
    light.mean_lux = 3;
  } else if (name == "hdr") {
    light = {150, 0.1, true};
  } else {
    Unknown("light", name, LightNames());
  }
  return light;
}

void Illuminate(const Light& light, Scene* scene) {
  scene->ambient_lux *= light.ambient_share;
  if (light.spot) {
    for (auto& lamp : scene->lamps) lamp.intensity_cd *= light.ambient_share;
    const MotionVolume& m = scene->motion;
    const Eigen::Vector3d target = 0.5 * (m.target_min + m.target_max),
                          camera = 0.5 * (m.position_min + m.position_max);
    const Eigen::Vector3d forward = (target - camera).normalized(), side = forward.cross(Eigen::Vector3d::UnitZ());
    Lamp spot;
    spot.position = camera + Eigen::Vector3d(0, 0, 0.7) - 0.6 * side;
    spot.direction = target + 0.45 * side - spot.position;
    spot.cone_deg = 30;
    spot.intensity_cd = 5000;
    spot.radius_m = 0.05;
    scene->lamps.push_back(spot);
  }
  scene->BakeLight(light.mean_lux);
}

}  // namespace devo::sim
