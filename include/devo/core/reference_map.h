// SPDX-License-Identifier: BSD-3-Clause
//
// The references (keyframes) made so far, and what of them the current view can see. A new reference holds only
// what the older ones do not explain, so a space once seen keeps its first map and does not drift.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "devo/core/camera.h"
#include "devo/core/local_map.h"
#include "devo/core/options.h"
#include "devo/core/point_filter.h"
#include "devo/core/rigid3.h"
#include "devo/core/surface.h"

namespace devo {

/// Not thread-safe.
class ReferenceMap {
 public:
  /// `camera`: of the undistorted event image.
  ReferenceMap(const Camera& camera, const MappingOptions& options);

  void SetOptions(const MappingOptions& options) { options_ = options; }

  /// Depth of what is nearest in cells of the event image, at a known pose: hides the points behind it.
  struct Occluder {
    Rigid3 T_world_event;
    cv::Mat1f nearest_depth_m;  ///< 0 where unknown
    int cell_px = 1;
  };

  /// A point of the map in a view.
  struct Visible {
    int reference, point;
    Eigen::Vector3f p_event;
    float u, v;                ///< px
    float normal_x, normal_y;  ///< of its edge in the view; 0, 0 unknown
  };

  /// Points inside the view's image (margin 2 px) that are not hidden by the occluder, if one is given.
  std::vector<Visible> Project(const Rigid3& T_world_event, const Occluder* occluder) const;

  /// For each edge of a surface, whether a visible point explains it: within 2 px and of similar direction.
  std::vector<bool> ExplainedEdges(const Surface& surface, const std::vector<Visible>& visible) const;

  /// The moment of a surface.
  struct Moment {
    Rigid3 T_world_event;
    Vector6d velocity_event;  ///< [v; omega], m/s and rad/s
    double edge_lag_px;       ///< SurfaceOptions::edge_lag_px
    bool new_view;            ///< has the camera moved since the points were refined last?
  };
  /// Remembers how often each visible point met an edge when its motion should have made one and, from a new view,
  /// moves it a little towards the edge that it met.
  void Observe(const Surface& surface, const std::vector<Visible>& visible, const Moment& moment);

  /// Drops points that almost never met an edge (noise, moving things, wrong depth), and what was given up.
  void DropUnproven();

  /// Adds a reference with `points` in its own frame. Returns its id. Beyond max_map_points, references that were out
  /// of view for longest are forgotten.
  int Add(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points);

  /// The same with points whose depth is guessed (what is around them, not what was measured).
  int AddGuessed(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points);

  /// Gives up the points of guessed depth for which `is_known(point)`, now that others can stand for them: takes them
  /// out of `visible`, and out of the map with the next DropUnproven.
  template <typename IsKnown>
  void LeaveGuessed(const IsKnown& is_known, std::vector<Visible>* visible) {
    const auto leave = [&](const Visible& point) {
      Reference& reference = references_[point.reference];
      if (!reference.guessed || !is_known(point)) return false;
      reference.evidence[point.point].given_up = true;
      return true;
    };
    visible->erase(std::remove_if(visible->begin(), visible->end(), leave), visible->end());
  }

  /// At most max_points of the visible points, spread over the image, in the frame `ref` of a view at
  /// `T_world_ref`; of several in one place, those that proved themselves.
  std::vector<MapPoint> Select(const std::vector<Visible>& visible, const Rigid3& T_world_ref) const;

  /// References of the chapters so far are kept, but no longer seen: where they are to the new ones is not known.
  void BeginChapter() { chapter_ = ++last_chapter_; }
  /// To one that was begun before.
  void ReturnTo(int chapter) { chapter_ = chapter; }
  int chapter() const { return chapter_; }
  bool chapter_empty() const;

  /// All points, frame `world`, without those whose depth is a mere guess yet.
  std::vector<MapPoint> AllPoints() const;

  /// What the views of a point said of it.
  struct Evidence {
    float expected = 0, met = 0;  // how often it should have met an edge, and did
    bool given_up = false;
    PointCovariance covariance = CovarianceOfNewPoint();
  };
  struct Reference {
    int id;
    std::int64_t t_ns;
    Rigid3 T_world_ref;
    std::vector<MapPoint> points;    // frame `ref`, sigma_px not filled in
    std::vector<Evidence> evidence;  // of each point
    Eigen::Vector3f center_ref;      // sphere around the points
    float radius_m;
    int chapter;
    bool guessed;             // the depths of its points
    std::uint64_t last_seen;  // in which call of Observe or Add
  };
  const std::vector<Reference>& references() const { return references_; }
  bool empty() const { return references_.empty(); }
  /// Of all chapters, in which it goes on counting.
  void ForgetReferences() { references_.clear(); }
  void Clear() {
    ForgetReferences();
    next_id_ = chapter_ = last_chapter_ = 0;
  }

 private:
  int Add(std::int64_t t_ns, const Rigid3& T_world_ref, std::vector<MapPoint> points, bool guessed);
  bool InView(const Reference& reference, const Rigid3& T_event_ref) const;
  void Prune(Reference* reference);
  void ForgetBeyondBudget();
  using Index = std::vector<std::size_t>::iterator;      // to an index of a visible point
  using Ranked = std::pair<std::uint32_t, std::size_t>;  // the lower the better, and such an index
  /// Of these points the `count` with the best support, in order. Returns their end.
  Index MoveBestToFront(const std::vector<Visible>& visible, Index first, Index last, std::size_t count,
                        std::vector<Ranked>* ranked) const;

  Camera camera_;
  MappingOptions options_;
  std::vector<Reference> references_;
  int next_id_ = 0, chapter_ = 0, last_chapter_ = 0;
  std::uint64_t calls_ = 0, dropped_at_ = 0;
};

}  // namespace devo
