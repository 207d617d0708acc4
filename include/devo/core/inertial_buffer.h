// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include <Eigen/Core>

#include "devo/core/imu.h"
#include "devo/core/inertial_noise.h"

namespace devo {

/// What an inertial sensor read over a span of time, on average.
struct InertialMean {
  Eigen::Vector3d angular_velocity;                    ///< rad/s, event frame, bias included
  std::optional<Eigen::Vector3d> linear_acceleration;  ///< specific force, m/s^2, event frame, bias included
  Eigen::Vector3d p_event_imu;                         ///< m, event frame
  InertialNoise::Density noise{};                      ///< of the sensor about the last sample
};

/// How means over 10 ms differ from their own mean: standard deviation, root mean square over the axes.
struct InertialScatter {
  double turn_rad_s, force_m_s2;
};

/// The samples of the last seconds. Not thread-safe.
class InertialBuffer {
 public:
  /// The last sample holds for so long, or for a period and a quarter of a sensor that is slower than that.
  static constexpr std::int64_t kLeastHold_ns = 15'000'000;
  static std::int64_t HoldOf_ns(std::int64_t period_ns);

  /// Samples in the order of their time; one that is not newer than the last, or whose angular velocity is not finite,
  /// is left out.
  void Add(const ImuSample& sample);

  /// Mean over [from_ns, to_ns], linear between the samples; the last one holds for a moment (samples come later than
  /// events). Empty where the samples leave a part of the span open, are too noisy of late to be of use,
  /// or are not to be used.
  std::optional<InertialMean> Mean(std::int64_t from_ns, std::int64_t to_ns) const;

  /// The same of all samples, whether they are of use or not.
  std::optional<InertialMean> MeanRead(std::int64_t from_ns, std::int64_t to_ns) const;

  /// False: there is no Mean from now on, as what is read does not fit the motion.
  void SetUsed(bool used) { used_ = used; }
  bool used() const { return used_; }

  /// Of the sensor about the last sample.
  const InertialNoise::Density& noise() const { return noise_.density(); }

  /// Time of the oldest sample that is kept. Empty before the first.
  std::optional<std::int64_t> begin_ns() const;

  struct Push {
    Eigen::Vector3d force;  ///< mean specific force, m/s^2, event frame at the end of the span
    double span_s;
  };
  /// Mean over up to a second until `t_ns`, each reading turned into the frame of the end by the gyroscope: mostly
  /// gravity, as velocities do not grow for long. Empty without an accelerometer or before the second sample.
  std::optional<Push> MeanPush(std::int64_t t_ns) const;

  void Clear();

 private:
  std::int64_t Hold_ns() const;  // how long the last sample holds

  std::deque<ImuSample> samples_;
  InertialNoise noise_;
  bool used_ = true;
};

}  // namespace devo
