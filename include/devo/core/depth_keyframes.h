// SPDX-License-Identifier: BSD-3-Clause
//
// Depth images kept with their poses, to which later ones are aligned: where the view returns, so does the pose.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "devo/core/depth_alignment.h"
#include "devo/core/depth_continuity.h"
#include "devo/core/depth_errors.h"
#include "devo/core/depth_image.h"
#include "devo/core/depth_pose.h"
#include "devo/core/options.h"
#include "devo/core/rig.h"

namespace devo {

/// Not thread-safe.
class DepthKeyframes {
 public:
  explicit DepthKeyframes(const Rig& rig, const MappingOptions& options = MappingOptions());

  /// Of them, which readings are a measurement; from the next image on.
  void SetOptions(const MappingOptions& options) { options_ = options; }

  /// What tracking says of a depth image's moment.
  struct View {
    Rigid3 T_world_event;
    Vector6d velocity_event = Vector6d::Zero();  ///< [v; omega], m/s and rad/s
    double delay_s = 0;                          ///< by how much events are taken to be later than depth images
    double delay_sigma_s = 0;                    ///< of that
    int chapter = 0;
    bool lost = false;        ///< the camera may be anywhere, whatever is stated of its pose
    bool turn_known = false;  ///< but an inertial sensor has followed its rotation
    bool trusted = false;     ///< the image may become a keyframe
    /// A pose by depth that is farther off than this (DepthPose::SquareApart) is to be confirmed.
    double doubtful_from = kHardlyTheSame;
    Matrix6d covariance = Matrix6d::Zero();  ///< of a right perturbation [rho; phi] of T_world_event, m and rad
  };

  /// Aligns an image to the keyframe that shows most of it, and keeps it when none shows enough. Empty where nothing
  /// overlaps, or where the depth camera seems to see otherwise than before: then, once that is certain, all keyframes
  /// are forgotten. Of a lost camera the place is searched for, for tenths of a second, a few times in a second; a pose
  /// that is not confirmed is none then. `t_ns` and `epoch` of the result are the caller's to fill in. Throws
  /// std::invalid_argument when the image has not the depth camera's size.
  std::optional<DepthPose> Align(const DepthImage& depth, const View& view);

  /// Keeps the image of the first map, which is aligned to none, at a pose that is known to millimetres and
  /// milliradians. `stand_in`: only until another is aligned to it, and kept in its place. Throws as Align.
  void KeepFirst(const DepthImage& depth, const View& view, bool stand_in);

  std::size_t size() const { return keyframes_.size(); }
  std::uint64_t jumps() const { return jumps_; }  ///< how often the depth camera began to see otherwise
  /// Images for which a thing that alone told a direction was left out, as events denied it.
  std::uint64_t without_things() const { return without_things_; }
  void Clear();

 private:
  struct Keyframe {
    DepthCells cells;
    View view;  // as it was kept
    std::uint64_t last_used;
    bool first = false, stand_in = false;
  };
  using Reach = DepthAligner::Reach;
  /// Whether a direction rests on one thing alone, which may have moved: then it is to agree with the events, or the
  /// alignment is of all else.
  enum class Rests { kOnMany, kOnOneThing, kWithoutIt };
  struct Match {
    int keyframe = -1;
    Reach reach = Reach::kNear;
    DepthAligner::Result result;
    Rests rests = Rests::kOnMany;
  };

  Rigid3 WorldFromKeyframe(const Keyframe& keyframe, double delay_s) const;
  struct Found {
    Match match;
    DepthPose pose;
  };
  std::optional<Found> Find(const DepthCells& now, const View& view) const;
  Match FindNear(const DepthCells& now, const View& view) const;
  /// Those besides the current one whose view is near the image's.
  void TryOthers(const DepthCells& now, const View& view, Match* best) const;
  /// The last ones whose view may overlap the image's, were its pose decimetres off.
  Match FindFar(const DepthCells& now, const View& view) const;
  /// Of a lost camera: what is confirmed by Find, else by a search, if it is time for one.
  std::optional<Found> FindLost(const DepthCells& now, const View& view, std::int64_t t_ns);
  /// Without what was thought of where the camera is.
  std::optional<Found> Search(const DepthCells& now, const View& view) const;
  /// For a search around what is thought where the rotation is still known, else around the keyframe's own view. Empty
  /// where that view is too far off.
  std::vector<Rigid3> StartsFor(const Keyframe& keyframe, const View& view) const;
  /// Takes it where more of the image overlaps than with the best.
  void Try(std::size_t index, Reach reach, const DepthCells& now, const View& view, Match* best) const;
  bool MayOverlap(const Keyframe& keyframe, Reach reach, const View& view) const;
  /// To the keyframe of this index. Where one thing alone tells a direction and the events deny what comes of it,
  /// without that thing, unless all else denies the events, too. Empty where too little overlaps.
  std::optional<Match> AlignTo(std::size_t index, Reach reach, const DepthCells& now, const View& view) const;
  DepthPose MakePose(const Match& match, const View& view) const;
  /// Whether an alignment that tells all directions ends where one from the other side does.
  bool IsConfirmed(const Match& match, const DepthPose& pose, const DepthCells& now, const View& view) const;
  void Keep(DepthCells cells, const View& view);
  DepthContinuity::Verdict Judge(const Match& match, const DepthPose& pose, const View& view, std::int64_t t_ns);
  /// From an image of which tracking knows where it was taken, how the camera errs; for the next one.
  void Learn(const Match& match, const DepthCells& now, const View& view);

  DepthAligner aligner_;
  DepthErrors errors_;
  MappingOptions options_;
  Rigid3 T_event_depth_;
  std::deque<Keyframe> keyframes_;
  int current_ = -1;
  std::uint64_t calls_ = 0, jumps_ = 0, without_things_ = 0;
  std::int64_t searched_ns_ = 0;
  DepthContinuity continuity_;  // of the images compared with current_ while tracking is trusted
};

}  // namespace devo
