// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace devo {

/// How what an inertial sensor reads fits the motion that the poses show.
struct InertialFit {
  double gyroscope = 0;      ///< how many times larger than a good one's its errors are, at least 1; 0: not in use
  double accelerometer = 0;  ///< the same
  double force_m_s2 = 0;     ///< mean magnitude of the specific force over about half a second; 0: no accelerometer
  /// By its readings alone, vibration included; 0: not known. In rad/s/sqrt(Hz) and m/s^2/sqrt(Hz).
  double gyroscope_noise = 0, accelerometer_noise = 0;
  bool left_out = false;  ///< as it does not fit, or is too noisy
};

/// A specific force that a sensor at rest or on a moderate motion can have in m/s^2; in g, or where the sensor reads
/// zeros, it is far from it.
bool IsPlausibleForce(double force_m_s2);

/// Larger than poses that err make a sensor's look that is well mounted.
bool FitsBadly(double times_its_errors);

/// So large that nothing of its readings is of use: axes, signs or units, or stamps many hundredths of a second off.
bool FitsNotAtAll(double times_its_errors);

/// So noisy, vibration included, that poses are better without it (rad/s/sqrt(Hz)).
bool IsTooNoisy(double gyroscope_noise);

/// What is likely wrong, in one sentence that names what to check; empty where the sensor fits, or there is none.
std::string Complaint(const InertialFit& fit);

}  // namespace devo
