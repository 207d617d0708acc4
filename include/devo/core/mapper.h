// SPDX-License-Identifier: BSD-3-Clause
//
// The mapping module (paper section III-C): references made of edges and depth, the local map for tracking.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/counters.h"
#include "devo/core/depth_guess.h"
#include "devo/core/depth_image.h"
#include "devo/core/depth_keyframes.h"
#include "devo/core/depth_of_rest.h"
#include "devo/core/depth_pose.h"
#include "devo/core/depth_registration.h"
#include "devo/core/depth_repeats.h"
#include "devo/core/lidar_accumulator.h"
#include "devo/core/lidar_sweep.h"
#include "devo/core/local_map.h"
#include "devo/core/options.h"
#include "devo/core/pose_estimate.h"
#include "devo/core/pose_history.h"
#include "devo/core/reference_map.h"
#include "devo/core/rig.h"
#include "devo/core/surface.h"

namespace devo {

/// Surfaces, poses and depth images (or sweeps of a LiDAR) may come late and in any order between the three kinds;
/// within a kind in the order of their time. Not thread-safe.
class Mapper {
 public:
  Mapper(const Rig& rig, const OdometryOptions& options);

  /// Other options from the next depth image on; the references stay. The next Update composes the local map anew.
  void SetOptions(const OdometryOptions& options);

  void AddSurface(SurfacePtr surface);
  void AddPose(const PoseEstimate& pose);
  void AddDepth(const DepthImage& depth);
  /// Of a rig with `depth_from_lidar`: in place of depth images.
  void AddSweep(LidarSweep sweep);

  /// Aligns the depth image that Update would process next, if what it needs has come: where the camera was by it is
  /// then known before the map is. Update does so itself where this was not called.
  void AlignDepth();

  /// Processes the depth images for which a surface at or after their time, and its pose, have come, and the sweeps,
  /// which become depth images of the newest surface. The first map may be of the depth of the rest before. Returns the
  /// local map when it changed (a new reference, or the view has moved on), else null.
  LocalMapPtr Update();

  /// Where the camera was by the depth images that were aligned since the last call, if they say so; empties.
  std::vector<DepthPose> TakeDepthPoses() { return std::exchange(depth_poses_, {}); }

  const SceneDepth& scene_depth() const { return scene_depth_; }

  /// A depth image, the surface that it met and how they lie to each other: what tells whether depth fits the events.
  struct Match {
    DepthImage depth;
    SurfacePtr surface;
    Rigid3 T_event_depth;  ///< from the depth camera at its time to the event camera at the surface's t_edges_ns
    Vector6d velocity_event = Vector6d::Zero();  ///< [v; omega], m/s and rad/s
  };
  /// The last one; `surface` is null before there is one.
  const Match& last_match() const { return last_match_; }

  /// What the last sweeps made: depth in the undistorted event image, empty before the first.
  const DepthImage& lidar_depth() const { return lidar_depth_; }

  /// All points of all references, frame `world`.
  std::vector<MapPoint> GlobalMap() const { return map_.AllPoints(); }

  void Reset();

  const MappingCounters& counters() const { return counters_; }

 private:
  /// Poses begin anew where events found a lost camera: where the last depth image lies to them is not known, as those
  /// that it met had gone astray, or were of a chapter that began at a guess. An image that tracking begins with stays.
  void ForgetDepthBeforeLoss();
  SurfacePtr SurfaceFor(std::int64_t t_ns) const;
  /// Whether they lie so near each other in time that edges and depth are of one view. Counts depth that has come so
  /// late that surfaces of its time, of which there were some, are kept no longer.
  bool IsOfItsTime(const Surface& surface, std::int64_t depth_ns);
  void ForgetASurface();
  /// Depth comes in the order of its time: what comes after this surface's is nearer to none before it. Surfaces are
  /// large, and their memory is better used while it is still in a near cache.
  void ForgetSurfacesBefore(const SurfacePtr& surface);
  /// What new depth did to the map.
  struct Change {
    bool any = false;
    bool found = false;  ///< it is of a place where depth found a lost camera: poses are to begin anew there
  };
  Change UpdateFromDepth();
  bool UpdateFromSweeps();
  /// The first map, of the depth of the rest before the first motion.
  bool BeginFromRest();
  std::optional<DepthImage> DepthOf(const LidarSweep& sweep, const Surface& surface);
  /// Of the first map, for later images to be aligned to, as soon as poses tell where it was made.
  void KeepFirstDepth();
  /// DepthKeyframes::View::doubtful_from of an image of this time.
  double DoubtfulFrom(std::int64_t t_ns) const;
  DepthKeyframes::View ViewAt(std::int64_t t_ns, const Rigid3& T_world_event) const;
  /// By how much (T_new_old, of the world) tracking will move the poses of its moment once it knows of the image.
  struct Move {
    Rigid3 T_moved_world;
    bool found = false;     ///< the camera was lost, and the image tells where it is
    bool repeated = false;  ///< the image is not of its time
  };
  /// Whether what the first image that waits needs has come.
  bool IsDepthReady() const;
  Move MoveBy(const DepthImage& depth);
  /// Puts what it adds to the map where tracking will be after the move: from where it was, the map would pull poses
  /// back. `of_depth`: where the image is counted.
  bool Process(const DepthImage& depth, const SurfacePtr& surface, const Move& move, MappingCounters* of_depth);
  /// A reference of the edges that the map does not explain. Returns whether there were enough with depth for it.
  bool AddReference(const Surface& surface, const Rigid3& T_world_event, const std::vector<bool>& explained);
  /// The same of all edges, whatever the map has.
  bool AddAll(const Surface& surface, const Rigid3& T_world_event);
  /// The map's points in a surface: which ones meet edges, and where. Returns those that are visible.
  std::vector<ReferenceMap::Visible> Observe(const Surface& surface, const Rigid3& T_world_event);
  /// The newest surface, where depth images come too seldom for the map to be observed with them alone. Returns whether
  /// the map grew.
  bool ObserveBetweenDepths();
  /// What the last depth image, seen from here, tells of the scene's depth and of edges beside the map. Returns whether
  /// the map grew.
  bool ExtendBetweenDepths(const Surface& surface, const Rigid3& T_world_event,
                           const std::vector<ReferenceMap::Visible>& visible);
  /// Whether it is time to, or the view is another one and depth images come seldom.
  bool IsToObserve(std::int64_t t_ns, const Rigid3& T_world_event) const;
  /// Whether the scene's depth is of a view so far from this one that its places are others.
  bool SceneMoved(const Rigid3& T_world_event) const;
  /// Warps the last depth image to here, with readings around those edges.
  void ViewLastDepth(const Rigid3& T_world_event, const std::vector<const EdgePoint*>& wanted);
  /// Whether the pose is known so well that what has no depth may be added at a guess.
  bool MayGuess() const;
  /// Edges where the map has no points, if they are enough to hold the pose, and it is known well enough to add them.
  std::vector<const EdgePoint*> EdgesBesideTheMap(const Surface& surface, const DepthGuess& guess) const;
  /// Those of which the last depth image tells the depth (it must have been warped to here) become points of the map.
  /// Returns whether they did.
  bool MeasureBesideTheMap(const Surface& surface, const Rigid3& T_world_event,
                           const std::vector<const EdgePoint*>& beside);
  /// Those of which it has no reading (it must have been warped to here) become points of a guessed depth. Returns
  /// whether they did.
  bool GuessBesideTheMap(const Surface& surface, const Rigid3& T_world_event,
                         const std::vector<const EdgePoint*>& beside, DepthGuess* guess);
  bool MovedSinceReference(const Rigid3& T_world_event) const;
  double MedianDepth() const;  // m; a guess before it is known
  bool ViewMoved() const;
  /// Returns whether there were enough edges with depth for it.
  bool BeginChapter(const Surface& surface, const Rigid3& T_world_event);
  MapPoint MakePoint(const EdgePoint& edge, float z_m, double window_s) const;
  LocalMapPtr MakeLocalMap(bool found_by_depth);

  Rig rig_;  // with the depth images' camera and pose
  OdometryOptions options_;
  Camera camera_;  // undistorted event image
  DepthRegistration registration_;
  LidarAccumulator lidar_;
  ReferenceMap map_;
  DepthKeyframes depth_keyframes_;
  DepthRepeats depth_repeats_;
  DepthOfRest depth_of_rest_;
  struct FirstDepth {
    DepthImage depth;
    bool of_rest;
  };
  std::optional<FirstDepth> first_depth_;  // of the first map, until its pose is known
  std::vector<DepthPose> depth_poses_;
  std::deque<SurfacePtr> surfaces_;
  std::deque<DepthImage> depths_;
  std::optional<Move> move_;  // by the first of these, once it was aligned
  std::deque<LidarSweep> sweeps_;
  DepthImage lidar_depth_;
  PoseHistory poses_;
  SensorDelays delays_;  // images and sweeps are kept with the time at which events show their moment
  Vector6d velocity_ = Vector6d::Zero();
  bool velocity_of_poses_ = false;
  Matrix6d covariance_ = Matrix6d::Zero();  // of the newest pose
  double way_m_ = 0;                        // of the poses
  double read_share_ = 0;                   // of the last depth image, that is a measurement
  bool sure_ = false;                       // of the newest pose: the map may grow from it where nothing was measured
  bool trackable_ = false, lost_ = false, begin_chapter_ = false;
  std::optional<ReferenceMap::Occluder> occluder_;  // of the last depth image
  std::optional<Rigid3> T_world_local_;             // view of the last local map
  Rigid3 T_world_refined_;                          // view that refined the map last
  Rigid3 T_world_observed_;                         // view of the last surface in which the map was observed
  std::int64_t observed_ns_ = 0;                    // its time
  std::int64_t first_surface_ns_ = 0;               // time of the first surface of the epoch
  std::int64_t extended_ns_ = 0;                    // time of the last one by which the map might grow
  bool options_changed_ = false;                    // since the last local map
  int local_maps_ = 0;
  SceneDepth scene_depth_;
  Rigid3 T_world_scene_;  // its view
  Match last_match_;
  Rigid3 T_world_depth_;  // of its depth image
  std::uint64_t epoch_ = 0;
  MappingCounters counters_;
};

}  // namespace devo
