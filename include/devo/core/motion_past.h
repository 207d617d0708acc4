// SPDX-License-Identifier: BSD-3-Clause
//
// What the motion filter did for the surfaces of the last moment. Depth images come late: what one says of where the
// camera was is told to the filter of then, which goes the same way again, with the same measurements, to now. That is
// what it would have come to, had the image been there in time (Bar-Shalom, "Update with out-of-sequence measurements
// in tracking: exact solution", 2002): velocities, and what later surfaces left open, follow, too.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "devo/core/inertial_buffer.h"
#include "devo/core/motion_filter.h"
#include "devo/core/pose_history.h"

namespace devo {

/// Not thread-safe.
class MotionPast {
 public:
  enum class Kind { kMoving, kCoasting, kStill };
  /// From one surface to the next.
  struct Step {
    std::int64_t t_ns = 0;  ///< of its end
    Kind kind = Kind::kMoving;
    bool inertial = false;                                  ///< led by the inertial sensor
    std::optional<MotionFilter::Likelihood> measured = {};  ///< at its end
  };

  /// The filters go on with these.
  void SetOptions(const TrackingOptions& options);

  /// A step that the filter has made from its state `before`. In the order of time, without gaps since the last
  /// Clear(); steps are kept for kMaxDepthLatency_s.
  void Note(const MotionFilter& before, const Step& step);
  void Clear() { steps_.clear(); }

  /// The filter before the first step that is kept. Empty where none is.
  std::optional<MotionFilter> Oldest() const;

  /// The filter at a time, with what was measured until then; `now`: what it has come to. Empty where that is before
  /// the steps that are kept, or after now.
  std::optional<MotionFilter> At(std::int64_t t_ns, const MotionFilter& now, const InertialBuffer& inertial) const;

  /// Where alignments since a time found the camera: where they say, or, begun at a false pose of then, only how it has
  /// moved since.
  enum class Since { kPlaces, kMotion };
  /// The filter now, had it been `then` at the time of that: all steps since are made again. They are what At() tells
  /// of from now on, and `history` has their poses in place of those it had; earlier ones lie to `then` as before.
  MotionFilter Again(const MotionFilter& then, const InertialBuffer& inertial, PoseHistory* history,
                     Since measured = Since::kPlaces);

  /// The filter now, had the standstill that goes on ended at `t_ns`, or been none if it began later: from there
  /// the inertial sensor leads it, and `history` too. Empty where nothing stands still, or the sensor has not read all
  /// of it.
  std::optional<MotionFilter> AgainInMotion(std::int64_t t_ns, const InertialBuffer& inertial, PoseHistory* history);

 private:
  struct Made {
    MotionFilter before;
    Step step;
  };

  std::deque<Made> steps_;
};

/// What `inertial` read from the filter's time to this, as late as the filter thinks that events show it.
std::optional<InertialMean> ReadSince(const MotionFilter& motion, std::int64_t t_ns, const InertialBuffer& inertial);

/// Moves the filter on to a later time with those readings; false: there are none, and it is left as it was.
bool AdvanceTo(std::int64_t t_ns, const InertialBuffer& inertial, MotionFilter* motion);

/// With those readings, where there are any.
MotionFilter::Prediction PredictAt(const MotionFilter& motion, std::int64_t t_ns, const InertialBuffer& inertial);

}  // namespace devo
