// SPDX-License-Identifier: BSD-3-Clause
//
// Names of everything that the nodelets publish and exchange (docs/ros_api.md). Relative: a namespace or a remapping
// moves them.
#pragma once

namespace devo {
namespace topics {

// Between the nodelets; within one manager the frozen core struct itself is passed on.
constexpr char kSurface[] = "time_surface";         // TimeSurface, per surface
constexpr char kTrackedPose[] = "tracked_pose";     // TrackedPose, per surface
constexpr char kSemiDenseMap[] = "semi_dense_map";  // SemiDenseMap, per new local map
constexpr char kSceneDepth[] = "scene_depth";       // SceneInverseDepth, where it changed
constexpr char kDepthPose[] = "depth_pose";         // PoseByDepth, per depth image that could be aligned
constexpr char kTunedOptions[] = "tuned_options";   // dynamic_reconfigure/Config, latched, per change

// Results.
constexpr char kOdometry[] = "odometry";
constexpr char kPose[] = "pose";
constexpr char kPath[] = "path";
constexpr char kGroundTruthPath[] = "ground_truth_path";
constexpr char kStatus[] = "status";
constexpr char kLocalMap[] = "local_map";
constexpr char kGlobalMap[] = "global_map";
constexpr char kSurfaceImage[] = "time_surface/image";
constexpr char kReprojectionImage[] = "reprojection/image";
constexpr char kDepthOverlayImage[] = "depth_overlay/image";

}  // namespace topics
}  // namespace devo
