// SPDX-License-Identifier: BSD-3-Clause
//
// The sensors that can be simulated, by name, and the light they stand in.
#pragma once

#include <string>
#include <vector>

#include "devo/core/camera.h"
#include "devo/sim/scene.h"

namespace devo::sim {

/// A DVS pixel and its readout. Model and sources: docs/simulation.md.
struct EventPixelModel {
  double threshold_on = 0.22;  ///< natural log units
  double threshold_off = 0.22;
  double threshold_mismatch = 0.03;  ///< standard deviation of both between pixels, log units
  double refractory_s = 100e-6;      ///< the pixel follows the light without firing after an event

  bool limit_bandwidth = true;        ///< false: the photoreceptor is infinitely fast
  double bandwidth_hz_per_lux = 400;  ///< photoreceptor pole per lux on the chip (grows with the photocurrent)
  double follower_hz = 1500;          ///< second pole: the source follower's bias, whatever the light
  double photocurrent_a_per_lux = 66e-15;
  double dark_current_lux = 0.01;  ///< dark current as an illuminance: takes contrast away in the dark

  double noise_power_factor = 1.3;       ///< photoreceptor noise power over pure shot noise; 0: no shot noise
  double leak_hz = 0.1;                  ///< ON events per second of a static pixel in the dark
  double parasitic_hz_per_lux = 2.7e-3;  ///< more of them by light on the reset switch, per lux on the chip
  double leak_mismatch = 0.2;            ///< relative standard deviation between pixels
  double hot_share = 1e-4;               ///< share of pixels that fire by themselves
  double hot_hz = 80;                    ///< their mean rate

  double readout_hz = 50e6;       ///< events per second that leave the chip
  double readout_delay_s = 1e-3;  ///< an event that would wait longer is lost
};

struct EventSensor {
  std::string name;
  Camera camera;
  EventPixelModel pixel;
  double f_number = 2.0;
  double lens_transmission = 0.9;

  /// Illuminance on the chip per illuminance that a diffuse surface reflects: transmission / (4 N^2).
  double ChipLuxPerSceneLux() const { return lens_transmission / (4 * f_number * f_number); }
};

/// gen3 (Prophesee PPS3MVCD 640x480), davis346, davis240, gen4 (1280x720), and gen3_vector and davis346_mvsec with the
/// lenses of those data sets. Throws std::invalid_argument naming the
/// sensor and the known ones.
EventSensor MakeEventSensor(const std::string& name);
std::vector<std::string> EventSensorNames();

/// Without mismatch, bandwidth limit, noise, leak, hot pixels, refractory period and readout limit.
EventPixelModel IdealPixel(double threshold = 0.22);

/// Photoreceptor pole at an illuminance on the chip, dark current included; Hz.
double PhotoreceptorBandwidth(const EventPixelModel& model, double chip_lux);
/// Standard deviation of the log photocurrent after both poles.
double NoiseSigma(const EventPixelModel& model, double chip_lux);
/// Rate (Hz) at which noise alone crosses a threshold: Rice 1944, sqrt(f1 f2) exp(-threshold^2 / (2 sigma^2)).
double NoiseRate(const EventPixelModel& model, double chip_lux, double threshold);

/// Light in a scene: `bright` 500 lux (an office by day), `darkish` 100 (evening), `dim` 20 (one lamp), `dark` 3
/// (street light through a window), `hdr` (dim room, one spot two hundred times brighter).
struct Light {
  double mean_lux = 500;
  double ambient_share = 1;  ///< multiplies the scene's ambient light before scaling to the mean
  bool spot = false;         ///< adds a strong spot lamp to one side of what the camera looks at
};
/// Throws std::invalid_argument naming the light and the known ones.
Light MakeLight(const std::string& name);
std::vector<std::string> LightNames();
/// Sets up and bakes the scene's light.
void Illuminate(const Light& light, Scene* scene);

}  // namespace devo::sim
