// SPDX-License-Identifier: BSD-3-Clause
//
// The tracking module (paper section III-D): one pose per surface.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "devo/core/alignment.h"
#include "devo/core/camera.h"
#include "devo/core/depth_fusion.h"
#include "devo/core/depth_pose.h"
#include "devo/core/errors_alike.h"
#include "devo/core/events_misfit.h"
#include "devo/core/inertial_buffer.h"
#include "devo/core/inertial_trial.h"
#include "devo/core/local_map.h"
#include "devo/core/motion_filter.h"
#include "devo/core/motion_past.h"
#include "devo/core/options.h"
#include "devo/core/pose_estimate.h"
#include "devo/core/pose_history.h"
#include "devo/core/relocalizer.h"
#include "devo/core/residual_scale.h"
#include "devo/core/rest_detector.h"
#include "devo/core/standstill.h"
#include "devo/core/surface.h"
#include "devo/core/tracking_status.h"

namespace devo {

/// Not thread-safe.
class Tracker {
 public:
  /// `event_camera`: as calibrated; the tracker works in its undistorted image.
  Tracker(const Camera& event_camera, const OdometryOptions& options);

  /// Other options from the next surface on; map and motion so far stay.
  void SetOptions(const OdometryOptions& options);

  /// The map to register to from now on. Maps of another epoch than the surfaces' are ignored; one of another chapter
  /// is only remembered as a place, unless tracking is lost.
  void SetMap(LocalMapPtr map);

  /// An inertial sensor's sample, optional; before the surfaces later than it.
  void AddImu(const ImuSample& sample) { inertial_.Add(sample); }

  /// Where the camera was a moment ago, by depth: moves the pose as far as that is better known, in the map's chapter.
  void AddDepthPose(const DepthPose& depth);

  /// Pose at the surface's time; empty as long as there is no map. Surfaces must come in the order of their
  /// time; one of a new epoch resets the tracker.
  std::optional<PoseEstimate> Track(const Surface& surface);

  /// The same. Surfaces that come before a first map, or the first of a new chapter, are kept for a moment: when the
  /// map comes, some of them are later than it, and a camera in motion is followed through them to now.
  std::optional<PoseEstimate> Track(const SurfacePtr& surface);

  /// How a gyroscope saw the camera turn in the last moments until `t_ns`: rad/s, event frame, bias included. Empty
  /// without one, or where its readings are not of use.
  std::optional<Eigen::Vector3d> TurnRead(std::int64_t t_ns) const;

  /// Velocity for compensating the next surface: [v; omega], m/s and rad/s, of and in the event frame. Zero before
  /// there are poses.
  Vector6d SurfaceVelocity() const;

  /// Forgets all of another epoch than this: before what belongs to its first surface.
  void BeginEpoch(std::uint64_t epoch);
  void Reset();

 private:
  /// Starts at the first map, `surface` being the first after it: as fast as is known from a rest before, or else as
  /// StartInMotion.
  void Begin(const Surface& surface);
  /// Starts at the map, `surface` being the first after it: as fast as the surfaces since show beside a gyroscope's
  /// turn, or, without one, turning as the surface's events say.
  void StartInMotion(const Surface& surface);
  /// Starts at a map that does not go on from the poses before it.
  void BeginAnew();
  /// A chapter begins where the pose of now is thought to be.
  void NoteChapter(const LocalMap& begun);
  /// What is not known of where a chapter lies in the world, as a covariance of a right perturbation of a pose in it:
  /// the farther from its begin, the more an error of its rotation makes of it.
  Matrix6d CovarianceOfChapter(int chapter, const Rigid3& T_world_event) const;
  /// Starts the filter at the first map with what the inertial sensor read since the camera last stood still. False
  /// where that is not known.
  bool BeginFromRest();
  /// [v; omega] at the first map where a gyroscope tells the turn until `surface`, the first after it; m/s and rad/s:
  /// with which the map's points meet the edges of the surfaces since.
  Vector6d VelocityBeside(const Eigen::Vector3d& turn_event, const Surface& surface) const;
  /// The map, which has just come, does not go on from the poses before it: nothing of how they matched says anything
  /// of it, and surfaces since are to be followed through it.
  void NoteNewView();
  /// From the last start to this pose; zero where that is too long ago, or faster than a camera moves.
  Vector6d VelocitySinceStart(std::int64_t t_ns, const Rigid3& T_world_event) const;
  void StartAt(std::int64_t t_ns, const Rigid3& T_world_event, const Vector6d& velocity_event,
               double speed_sigma_m_s = MotionFilter::kStartSpeed_m_s);
  /// The filter starts anew, at its time and pose of now.
  void NoteStart();
  /// The pose of then, of this covariance, is held against that by depth, where nothing else says how far off it is.
  void NoteMisfit(const DepthPose& depth, const Rigid3& T_world_then, const Matrix6d& covariance);
  /// EventsMisfit::TimesAt this time; 1 where an inertial sensor leads.
  double MisfitAt(std::int64_t t_ns) const;
  /// Moved to where depth has it, the pose went astray again until the last depth image: its velocity is
  /// false, and depth knows a better.
  bool GoesAstrayAgain() const;
  /// From the pose by depth, moved to now with this velocity.
  void StartByDepth(const DepthPose& depth, const Vector6d& velocity_event);
  /// By depth, since it is held.
  bool IsSeenMoving() const;
  /// A pose by depth, moved to now, does not fit: without events it is believed when another says so, too.
  void Contradict(const DepthPose& depth, const Rigid3& T_world_now);
  /// Events say that the camera moves, which was held to stand: it began to before they did.
  void LeaveRest();
  /// From where depth contradicts; false: that is no better.
  bool TryByDepth(const Surface& surface, PosePrior prior, const Vector6d& velocity_event, AlignmentResult* result);
  /// Whether the camera is taken to stand, though noise that differs between parts of the image makes more events than
  /// a standstill may have: they match nothing of the map.
  bool IsNoise(const Surface& surface) const;
  void NoteActivity(const Surface& surface, bool still, const PoseEstimate& pose);
  bool held() const { return standstill_.held(); }
  /// Only where there is a map.
  TrackedMotion Known() const;
  /// The pose at its time `t_ns`, from that of the edges.
  void ContinueToNow(PoseEstimate* pose) const;
  /// By how much events are later than an inertial sensor, s; 0 where that is late, which says nothing of others.
  double DelayAgainstInertial() const;
  SensorDelays Delays() const;
  /// Within the chapter: what the filter states, by how large errors are seen to be, and what is not known of time.
  Matrix6d StatedCovariance(const MotionFilter::Prediction& now, double event_delay_s) const;
  ErrorsAlike ErrorsAlikeIn(const Surface& surface) const;
  /// On to the surface's edges, which are later than the pose.
  void Step(const Surface& surface, MotionPast::Kind kind, PoseEstimate* pose);
  void Register(const Surface& surface, PoseEstimate* pose);
  /// `velocity_led`: of the event camera, where it was led to.
  void StartWhereFound(const Surface& surface, const Rigid3& T_world_found, const Vector6d& velocity_led);
  void Measure(const Surface& surface, const MotionFilter::Prediction& predicted, const AlignmentResult& result,
               const ErrorsAlike& alike);
  /// For an alignment whose information is `scale` squared times the filter's.
  PosePrior MakePrior(const MotionFilter::Prediction& predicted, double scale) const;
  /// Leaves the inertial sensor out, or takes it back.
  void TryInertial();
  InertialFit InertialFitNow() const;
  bool IsLed() const;  // by an inertial sensor or by depth, where events say little
  void HoldStill(std::int64_t t_ns, PoseEstimate* pose);
  void Coast(std::int64_t t_ns);
  /// `covariance`: of the predicted pose.
  bool Recover(const Surface& surface, const Matrix6d& covariance, AlignmentResult* result);
  /// The share of points that the pose of now matched.
  void NoteMatch(double inlier_share);

  OdometryOptions options_;
  Camera camera_;
  LocalMapPtr map_;
  MotionFilter motion_;
  MotionPast past_;
  MotionPast::Step step_;  // that motion_ is making
  InertialBuffer inertial_;
  InertialTrial trial_;
  InertialFit unfit_;  // where the sensor is left out: as it was then
  RestDetector rest_;  // until tracking starts
  PoseHistory history_;
  DepthFusion depth_fusion_;
  EventsMisfit events_misfit_;              // of poses that no inertial sensor guides
  std::optional<Rigid3> T_world_by_depth_;  // of now, where depth contradicts
  Standstill standstill_;
  Relocalizer relocalizer_;
  TrackingStatus status_;
  ResidualScale residual_scale_;
  std::uint64_t epoch_ = 0;
  std::int64_t started_ns_ = 0;               // when motion_ was last started at a known pose
  Rigid3 T_world_started_;                    // that pose
  bool anew_ = false;                         // it was started so since the last surface
  std::vector<PoseHistory::Stamped> rested_;  // where a rest before that began and ended
  std::deque<SurfacePtr> waiting_;            // surfaces of the last moment without a map that helps
  bool follow_ = false;                       // them through the map that has come
  struct Chapter {
    Rigid3 T_world_begin;
    Matrix6d covariance;  // of a right perturbation of it
  };
  std::map<int, Chapter> chapters_;  // but for the first, which is the world's
  bool inertial_prior_ = false;      // the last surface was predicted with an inertial sensor
  Rigid3 T_world_before_;            // last pose before tracking degraded
};

}  // namespace devo
