// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>

#include "devo/core/inertial_buffer.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Whether an inertial sensor is to be used. One on wrong axes or in a wrong unit pulls poses and map with it before
/// they contradict it clearly: in its first seconds of motion little is enough to leave it out, later it takes a clear
/// contradiction. It comes back when its gyroscope reads the turns that poses make. Not thread-safe.
class InertialTrial {
 public:
  struct Moment {
    std::int64_t t_ns;
    Rigid3 T_world_event;
    bool trusted;  ///< the pose
    bool moves;    ///< the camera, as far as is known
  };
  /// Whether it is to be used from now on; `readings` say whether it was. In the order of time. `times_its_errors`: of
  /// the gyroscope (InertialFit), 0 where it is not in use.
  bool Judge(const Moment& now, double times_its_errors, const InertialBuffer& readings);

 private:
  void Compare(const Moment& now, const InertialBuffer& readings);
  bool ReadsTheTurns() const;

  double moved_s_ = 0;
  std::int64_t t_ns_ = 0;
  std::optional<Moment> last_;  // from which a turn is being compared
  double turning_s_ = 0;
  double turn_square_ = 0, apart_square_ = 0;  // (rad/s)^2: means over the last seconds of turning
};

}  // namespace devo
