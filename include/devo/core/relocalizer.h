// SPDX-License-Identifier: BSD-3-Clause
//
// Finding the pose again after it was lost: registration with a wide field of attraction, tried from several
// poses and against the local maps of places seen before.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "devo/core/alignment.h"
#include "devo/core/camera.h"
#include "devo/core/local_map.h"
#include "devo/core/options.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// Not thread-safe.
class Relocalizer {
 public:
  /// `camera`: of the undistorted event image.
  Relocalizer(const Camera& camera, const OdometryOptions& options) : camera_(camera), options_(options) {}

  void SetOptions(const OdometryOptions& options) { options_ = options; }

  /// Keeps the map as a place to return to, unless a kept one was made from nearly the same view.
  void Remember(const LocalMapPtr& map);

  struct Found {
    Rigid3 T_world_event;
    LocalMapPtr map;  ///< that it was registered to
    AlignmentResult alignment;
  };
  /// Where the camera may be.
  struct Expectation {
    std::vector<Rigid3> starts;  ///< T_world_event
    Matrix6d covariance;         ///< of a right perturbation [rho; phi] (m, rad) of them
    int chapter = 0;             ///< in whose world they are
    /// How far from them the camera may be, as a normalised square: of such errors one in 3000 is larger.
    double most_square = 25;
    /// Near enough to one of the starts, where it is known how the pose's chapter lies to theirs: views resemble each
    /// other, most of all where little is seen.
    bool IsPlausible(const Rigid3& T_world_event, int of_chapter) const;
  };
  /// The best registration to `map` from each of the expected starts, and, `search_places` set, to the next few
  /// remembered places started from their own views. Empty when none that is plausible matches `min_share` of the
  /// points; those of other chapters always are.
  std::optional<Found> Search(const Surface& surface, const LocalMapPtr& map, const Expectation& where,
                              bool search_places, double min_share);

  void Clear();

 private:
  std::vector<Rigid3> TurnedStarts(const Surface& wide, const LocalMap& map, const Rigid3& T_world_event) const;
  void Try(const Surface& surface, const Surface& wide, const LocalMapPtr& map, const std::vector<MapPoint>& points,
           const Rigid3& T_world_event, const Expectation& where, Found* best) const;
  void AlignAllPoints(const Surface& surface, Found* found) const;

  Camera camera_;
  OdometryOptions options_;
  std::deque<LocalMapPtr> places_;
  std::size_t next_place_ = 0;
};

}  // namespace devo
