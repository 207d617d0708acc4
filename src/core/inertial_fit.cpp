// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_fit.h"

#include <cmath>
#include <cstdio>

namespace devo {
namespace {

constexpr double kMinForce_m_s2 = 5, kMaxForce_m_s2 = 20;
// A sensor that fits passes the first one only for moments in which the poses err.
constexpr double kFitsBadly = 4, kFitsNotAtAll = 15;
// Twice of what makes a sensor worth as much as none (docs/results.md, "An IMU that is shaken"): 0.14 deg/s/sqrt(Hz).
constexpr double kTooNoisy = 2.5e-3;

}  // namespace

bool IsPlausibleForce(double force_m_s2) { return force_m_s2 > kMinForce_m_s2 && force_m_s2 < kMaxForce_m_s2; }

bool FitsBadly(double times_its_errors) { return times_its_errors > kFitsBadly; }

bool FitsNotAtAll(double times_its_errors) { return times_its_errors > kFitsNotAtAll; }

bool IsTooNoisy(double gyroscope_noise) { return gyroscope_noise > kTooNoisy; }

std::string Complaint(const InertialFit& fit) {
  char text[256] = "";
  if (IsTooNoisy(fit.gyroscope_noise)) {
    std::snprintf(text, sizeof(text),
                  "the gyroscope is noisy or shaken (%.2f deg/s/sqrt(Hz)) and is left out: check that it is in rad/s, "
                  "mount the IMU softly, or let its own filter cut off lower",
                  180 / M_PI * fit.gyroscope_noise);
  } else if (fit.left_out || FitsNotAtAll(fit.gyroscope)) {
    std::snprintf(text, sizeof(text),
                  "the gyroscope does not fit the motion (%.0f times its errors) and is left out: check the IMU's "
                  "place (T_event_imu or /tf_static), its axes, signs and stamps, and that it is in rad/s",
                  fit.gyroscope);
  } else if (fit.force_m_s2 > 0 && !IsPlausibleForce(fit.force_m_s2)) {
    std::snprintf(text, sizeof(text),
                  "the accelerometer reads %.2g in place of about 9.8 m/s^2 and is left out: check its unit",
                  fit.force_m_s2);
  } else if (FitsNotAtAll(fit.accelerometer)) {
    std::snprintf(text, sizeof(text),
                  "the accelerometer does not fit the motion (%.0f times its errors) and is left out: check the IMU's "
                  "place (T_event_imu or /tf_static), its axes, signs and stamps",
                  fit.accelerometer);
  } else if (FitsBadly(fit.gyroscope) || FitsBadly(fit.accelerometer)) {
    std::snprintf(text, sizeof(text),
                  "the IMU fits the motion badly (gyroscope %.0f, accelerometer %.0f times its errors) and counts for "
                  "less: check its place (T_event_imu or /tf_static), its stamps, scale and range",
                  fit.gyroscope, fit.accelerometer);
  }
  return text;
}

}  // namespace devo
