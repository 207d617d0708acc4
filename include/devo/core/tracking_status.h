// SPDX-License-Identifier: BSD-3-Clause
//
// Whether tracking follows the camera, by what share of the map's points its poses match: when it is in doubt, when a
// better pose is to be sought, when it is lost and found again.
#pragma once

#include <cstdint>

#include "devo/core/match_quality.h"
#include "devo/core/pose_estimate.h"

namespace devo {

/// Not thread-safe.
class TrackingStatus {
 public:
  /// Of poses in a row that matched next to nothing, or far less than usual; depth that agreed within this time says
  /// otherwise.
  static constexpr double kLostAfter_s = 0.2;

  /// What leads a pose besides events.
  struct Leads {
    bool inertial;            ///< it was predicted with an inertial sensor
    bool knows_acceleration;  ///< that fits so well
    bool depth;               ///< which agreed within kLostAfter_s
    bool depth_alone;         ///< which agrees with where the pose was led, and has replaced none
  };

  /// `rate_hz`: of poses.
  explicit TrackingStatus(double rate_hz) : quality_(rate_hz) {}

  TrackingState state() const { return state_; }
  bool lost() const { return state_ == TrackingState::kLost; }
  const MatchQuality& quality() const { return quality_; }
  /// The last poses matched less than usual.
  bool doubtful() const { return quality_.suspicious_in_a_row() > 0; }
  bool trusted() const { return state_ == TrackingState::kTracking && !doubtful(); }
  /// For so long that the pose is not the events' any more.
  bool MatchesNothing() const;
  /// Lost, and not about to begin in a view that is new.
  bool IsAstray() const { return lost() && !begun_; }
  /// Since a surface showed where the camera is, or a view began; s.
  double UnseenFor_s(std::int64_t t_ns) const;

  /// A map has come, at its time, that does not go on from the poses before it: nothing of how they matched says
  /// anything of it.
  void NoteNewView(std::int64_t t_ns);
  /// In it the pose is known: none is to be sought.
  void NoteKnown() { unsure_ = false; }
  /// The pose goes on though hardly anything matches: where events do again, a better one may be near.
  void NoteGuess() { coasted_ = true; }
  /// A better pose was sought and found.
  void NoteFound() { coasted_ = false; }
  /// The camera stands.
  void NoteStandstill();
  /// The share of points that a pose matched, 0 to 1; 0 of one that was only predicted.
  void NoteMatch(double inlier_share, const Leads& by);
  /// Of every surface, in the end. `still`: it has no more events than a standstill may have.
  void NoteSurface(std::int64_t t_ns, bool still);

  /// Whether a better pose is to be sought than one that matches this share, at the surface of this time; counts as
  /// sought then. `inertial`: it was predicted with an inertial sensor.
  bool WantsSearch(std::int64_t t_ns, double inlier_share, bool inertial);

  /// Another one from the next pose on.
  void SetRate(double rate_hz) { quality_.SetRate(rate_hz); }
  void Reset() { *this = TrackingStatus(quality_.rate_hz()); }

 private:
  /// Poses that come in this time, at least one.
  int PosesIn(double span_s) const;

  MatchQuality quality_;
  TrackingState state_ = TrackingState::kInitialising;
  bool unsure_ = false;   // the next pose may be anywhere about the prediction: a better one is sought
  bool begun_ = false;    // a view, in which no pose has been found yet
  bool coasted_ = false;  // events were missing and came back, but the pose has not been found yet
  std::int64_t seen_ns_ = 0, searched_ns_ = 0;
};

}  // namespace devo
