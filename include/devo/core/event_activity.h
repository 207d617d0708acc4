// SPDX-License-Identifier: BSD-3-Clause
//
// What it says of a camera's motion that events end: a camera that slows down makes fewer and fewer of them, and one
// that moves on makes as many per pixel of motion as before.
#pragma once

#include <cstddef>
#include <deque>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/local_map.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// How fast (px/s) those of a local map's edges that lie before the camera move across themselves in its image at the
/// velocity [v; omega] (m/s, rad/s), in the mean: along themselves they make no events. A sample of them; 0 where there
/// are none.
double FlowAcrossEdges(const std::vector<MapPoint>& points, const Rigid3& T_event_ref, const Vector6d& velocity_event,
                       const Camera& camera);

/// Not thread-safe.
class EventActivity {
 public:
  /// `rate_hz`: of surfaces. `still_hz`: events per pixel and second below which a surface is still.
  EventActivity(double rate_hz, double still_hz) : rate_hz_(rate_hz), still_hz_(still_hz) {}

  /// Of each surface, in the order of time: its events per pixel and second after the noise filter, and whether the
  /// camera is taken to stand. `flow_px_s`: across edges, 0 where it is not known; not used where it stands.
  void Note(double activity_hz, bool still, double flow_px_s);

  /// Whether the last events ended faster than a camera could stop: it is events that are missing. Not where they had
  /// been few.
  bool EndedSuddenly() const;

  /// Whether edges that move so fast make clearly more events than a standstill has. False before any motion has been
  /// seen.
  bool WouldShow(double flow_px_s) const;

  /// For a still surface, `since_s` after the one before, in which edges are thought to have moved as fast as this.
  void NoteUnseen(double flow_px_s, double since_s);

  /// Whether what was thought cannot be, since the last motion that was seen: on a way longer than edges need to make
  /// their events, it would have shown.
  bool RulesOutMotion() const;

  /// Others from the next surface on; what was learnt stays.
  void SetRates(double rate_hz, double still_hz) {
    rate_hz_ = rate_hz;
    still_hz_ = still_hz;
  }
  void Clear();

 private:
  std::size_t Surfaces(double span_s) const;

  double rate_hz_, still_hz_;
  std::deque<double> past_hz_;            // of the last surfaces, oldest first
  double known_hz_ = 0, known_px_s_ = 0;  // in motion
  double unseen_px_ = 0;                  // that would have shown, since the last motion
};

}  // namespace devo
