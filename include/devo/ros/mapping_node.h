// SPDX-License-Identifier: BSD-3-Clause
//
// The mapping module as a ROS class: surfaces, poses and depth in, local maps and the scene's depth out.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>

#include "devo/core/mapper.h"
#include "devo/core/silhouettes.h"
#include "devo/ros/core_messages.h"
#include "devo/ros/health.h"
#include "devo/ros/rig_resolver.h"
#include "devo/ros/service_thread.h"
#include "devo/ros/tunables.h"
#include "devo/ros/worker.h"

namespace devo {

/// Gives the mapper surface and pose of one time together, in the order in which the offline runner does, and depth
/// images, or a LiDAR's sweeps, as they come. Depth from another epoch (a bag played again) waits until the surfaces
/// get there.
class MappingNode {
 public:
  /// Throws std::invalid_argument naming the parameter or yaml key that is wrong, before anything is subscribed.
  MappingNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~MappingNode();

 private:
  using SurfaceConstPtr = boost::shared_ptr<const Surface>;
  using PoseConstPtr = boost::shared_ptr<const PoseEstimate>;

  /// A message of the depth camera or of the LiDAR.
  struct DepthMessage {
    sensor_msgs::ImageConstPtr image;
    sensor_msgs::PointCloud2ConstPtr points;
    std::int64_t t_ns = 0;  // header.stamp on the event camera's clock
  };

  void SubscribeToDepth(const std::string& transport);
  void OnRig(const ResolvedRig& rig);
  void OnOptions(const OdometryOptions& options);
  void OnSurface(const SurfaceConstPtr& surface);
  void OnPose(const PoseConstPtr& pose);
  void OnDepth(const std_msgs::Header& header, DepthMessage message);
  bool OnSaveMap(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status);

  // On the worker's thread.
  struct Work {
    PoseConstPtr answer;
    std::deque<SurfaceConstPtr> surfaces;  // that it answers, and those before; without them there is nothing to do
    std::deque<DepthMessage> depths;
  };
  std::optional<Work> TakeWork();
  bool Step();
  void Map(const Work& work);
  void PublishDepthPoses();
  void NoteCounters();
  std::deque<DepthMessage> TakeDepth();
  void AddDepth(const DepthMessage& message);
  void AddImage(const sensor_msgs::Image& image);
  void Feed(const std::deque<SurfaceConstPtr>& surfaces, const PoseEstimate& pose);
  void JudgeAlignment(const Mapper::Match& match);
  void Publish(const LocalMapPtr& map);
  bool IsCopyWanted();
  void CopyGlobalMap();
  void PublishGlobalMap();
  const cv::Mat2f& DepthRays();  ///< computed once: of the depth images' camera, or of that of the LiDAR's sweeps
  void DrawDepthOverlay(const DepthImage& depth, const Rigid3& T_event_depth);
  void DrawLidarOverlay();

  ros::NodeHandle nh_, private_nh_;
  RigConfig config_;
  std::string odom_frame_, map_file_, depth_topic_;
  Rigid3 initial_pose_;
  std::string base_frame_;
  std::size_t depth_queue_size_;

  std::mutex mutex_;
  std::deque<SurfaceConstPtr> surfaces_;
  std::deque<PoseConstPtr> answers_;  // what tracking made of them
  std::deque<DepthMessage> depths_;
  bool depth_awaits_epoch_ = false;  // its stamps went back: the surfaces' will
  std::int64_t last_depth_ns_ = 0, before_step_back_ns_ = 0;
  std::uint64_t surfaces_dropped_ = 0, poses_dropped_ = 0;
  std::uint64_t depth_dropped_ = 0, depth_refused_ = 0, depth_of_same_stamp_ = 0;
  std::unique_ptr<Mapper> new_mapper_;
  bool options_changed_ = false;  // in config_.odometry, until the worker's mapper has them
  ResolvedRig resolved_;
  Camera undistorted_;  // event camera, as surfaces show it
  Rigid3 T_odom_world_;
  MappingCounters counters_;
  ros::WallTime too_late_;  // when depth last was
  SceneDepth scene_depth_;
  std::deque<SilhouetteFit> alignment_;  // of the last depth images that were judged
  Quantiles mapping_ms_;
  Failures failures_;
  std::vector<MapPoint> global_map_;  // frame `world`
  bool copy_wanted_ = false;          // of the mapper's, as it is now
  std::condition_variable copied_;
  std::uint64_t epoch_ = 0;
  std::int64_t surface_ns_ = 0;  // newest surface given to the mapper

  // The worker's own.
  std::unique_ptr<Mapper> mapper_;
  SurfaceConstPtr last_surface_;
  std::int64_t scene_depth_ns_ = 0, drawn_ns_ = 0;
  std::int64_t judged_ns_ = 0;  // depth image whose alignment was judged last
  cv::Mat2f depth_rays_;
  bool yields_ = false;  // its thread goes after others
  bool global_map_wanted_ = false;
  std::int64_t global_map_ns_ = 0;  // local map with which it was copied last; 0: none of this epoch

  Health health_;
  std::shared_ptr<Input> surface_input_, depth_input_;
  std::unique_ptr<RigResolver> rig_;
  image_transport::ImageTransport image_transport_;
  image_transport::Publisher overlay_publisher_;
  image_transport::Subscriber depth_subscriber_;
  ros::Publisher map_publisher_, depth_pose_publisher_, scene_depth_publisher_, local_cloud_publisher_,
      global_cloud_publisher_;
  ros::Subscriber surface_subscriber_, pose_subscriber_, points_subscriber_;
  std::unique_ptr<Tunables> tunables_;
  ServiceThread save_thread_;
  ros::ServiceServer save_service_;
  std::unique_ptr<Worker> worker_;  // last: joined before anything that it uses goes
};

}  // namespace devo
