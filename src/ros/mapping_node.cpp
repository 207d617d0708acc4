// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/mapping_node.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include <sensor_msgs/PointCloud2.h>
#include <boost/make_shared.hpp>

#include "devo/core/time.h"
#include "devo/io/point_cloud_file.h"
#include "devo/ros/conversions.h"
#include "devo/ros/depth_clock.h"
#include "devo/ros/message_conversion.h"
#include "devo/ros/parameters.h"
#include "devo/ros/played_again.h"
#include "devo/ros/rendering.h"
#include "devo/ros/scheduling.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kShown_s = 10;
constexpr char kTooLate[] =
    "depth comes when surfaces of its time are kept no longer and is not used, expected within 0.3 s: its driver's "
    "latency, or depth_time_offset_s";
constexpr double kGlobalMapEvery_s = 1, kMaxCopy_s = 2;
constexpr std::size_t kMaxWaitingSurfaces = 32;
// Depth is compared with the events twice per second; the figures are of the last ten seconds of motion.
constexpr double kJudgePeriod_s = 0.5;
constexpr std::size_t kJudgedImages = 20;
// Of that many silhouettes at least, an aligned depth camera's meet edges clearly more often than places beside them.
constexpr int kEnoughSilhouettes = 1000;
constexpr double kMoreThanChance = 1.2;

}  // namespace

MappingNode::MappingNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), config_(ReadRigConfig(private_nh)), health_(nh, private_nh),
      image_transport_(nh) {
  odom_frame_ = ReadString(private_nh, "odom_frame", "odom");
  base_frame_ = ReadString(private_nh, "base_frame", "");
  initial_pose_ = ReadPose(private_nh, "initial_pose", Rigid3());
  const std::string event_frame = ReadString(private_nh, "event_frame", "");
  const std::string transport = ReadString(private_nh, "image_transport", "raw");
  map_file_ = ReadPath(private_nh, "map_file", "devo_map.pcd");
  depth_queue_size_ = static_cast<std::size_t>(ReadInt(private_nh, "depth_queue_size", 10, 1, 1000));
  RefuseUnknown(private_nh, WithTunables(Module::kMapping,
                                         {"config", "set", "odom_frame", "event_frame", "base_frame", "initial_pose",
                                          "map_file", "image_transport", "depth_queue_size", "diagnostic_period",
                                          // What the transport's own reconfiguration leaves there.
                                          transport}));
  config_.odometry = ReadTunables(private_nh, Module::kMapping, config_.odometry);
  if (!event_frame.empty()) config_.frames.event = event_frame;
  config_.topics.points = InputTopic(nh_, "points", config_.topics.points);
  const bool lidar = config_.depth_from_lidar();
  depth_topic_ = lidar ? config_.topics.points : InputTopic(nh_, "depth/image_raw", config_.topics.depth);
  if (depth_topic_.empty())
    throw std::invalid_argument("topics.depth is empty; expected the topic of the depth images");

  map_publisher_ = nh_.advertise<LocalMap>(topics::kSemiDenseMap, 4);
  depth_pose_publisher_ = nh_.advertise<DepthPose>(topics::kDepthPose, 8);
  scene_depth_publisher_ = nh_.advertise<SceneDepth>(topics::kSceneDepth, 2);
  local_cloud_publisher_ = nh_.advertise<sensor_msgs::PointCloud2>(topics::kLocalMap, 2, true);
  global_cloud_publisher_ = nh_.advertise<sensor_msgs::PointCloud2>(topics::kGlobalMap, 1, true);
  overlay_publisher_ = image_transport_.advertise(topics::kDepthOverlayImage, 2);
  surface_input_ = health_.AddInput("surfaces", nh_.resolveName(topics::kSurface), "TimeSurface");
  depth_input_ = health_.AddInput("depth", depth_topic_, lidar ? "PointCloud2" : "Image");
  RigResolver::Need need;
  need.depth = true;
  need.base_frame = base_frame_;
  rig_ = std::make_unique<RigResolver>(nh_, config_, need, [this](const ResolvedRig& rig) { OnRig(rig); });
  health_.AddMissing([this](const KnownTopics& known) { return rig_->Missing(known); });
  health_.AddTask("mapping", [this](auto& status) { FillStatus(status); });
  worker_ = std::make_unique<Worker>(Worker::Urgency::kUsual, [this] { return Step(); });

  tunables_ = std::make_unique<Tunables>(nh_, private_nh_, Module::kMapping, config_.odometry,
                                         [this](const OdometryOptions& options) { OnOptions(options); });
  save_service_ = save_thread_.HandleOf(private_nh_).advertiseService("save_map", &MappingNode::OnSaveMap, this);
  rig_->Start();
  SubscribeToDepth(transport);  // its callback tells the rig a frame
  // Last, since nothing may throw any more: they must go before their worker.
  ros::NodeHandle on_worker = worker_->HandleOf(nh_);
  surface_subscriber_ = on_worker.subscribe<Surface>(
      topics::kSurface, 64,
      boost::function<void(const SurfaceConstPtr&)>([this](const SurfaceConstPtr& surface) { OnSurface(surface); }));
  pose_subscriber_ = on_worker.subscribe<PoseEstimate>(
      topics::kTrackedPose, 64,
      boost::function<void(const PoseConstPtr&)>([this](const PoseConstPtr& pose) { OnPose(pose); }));
  health_.Start();
}

void MappingNode::SubscribeToDepth(const std::string& transport) {
  const auto queue_size = static_cast<std::uint32_t>(depth_queue_size_);
  if (config_.depth_from_lidar()) {
    points_subscriber_ = nh_.subscribe<sensor_msgs::PointCloud2>(
        depth_topic_, queue_size, [this](const sensor_msgs::PointCloud2ConstPtr& points) {
          OnDepth(points->header, {nullptr, points});
        });
  } else {
    depth_subscriber_ = image_transport_.subscribe(
        depth_topic_, queue_size,
        [this](const sensor_msgs::ImageConstPtr& image) {
          OnDepth(image->header, {image, nullptr});
        },
        ros::VoidPtr(), image_transport::TransportHints(transport, ros::TransportHints(), private_nh_));
  }
}

MappingNode::~MappingNode() {
  surface_subscriber_.shutdown();
  pose_subscriber_.shutdown();
  depth_subscriber_.shutdown();
  tunables_.reset();
  points_subscriber_.shutdown();
  save_service_.shutdown();
  save_thread_.Stop();
  worker_.reset();
}

void MappingNode::OnRig(const ResolvedRig& rig) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    new_mapper_ = std::make_unique<Mapper>(rig.rig, config_.odometry);
    resolved_ = rig;
    undistorted_ = rig.rig.event_camera.Undistorted();
    T_odom_world_ = initial_pose_ * rig.T_event_base.value_or(Rigid3()).inverse();
  }
  worker_->Wake();
}

void MappingNode::OnOptions(const OdometryOptions& options) {
  const std::lock_guard<std::mutex> lock(mutex_);
  config_.odometry = options;
  options_changed_ = true;
}

void MappingNode::OnSurface(const SurfaceConstPtr& surface) {
  surface_input_->Arrived(surface->t_ns);
  const std::lock_guard<std::mutex> lock(mutex_);
  surfaces_.push_back(surface);
  if (surfaces_.size() > kMaxWaitingSurfaces) {
    surfaces_.pop_front();
    ++surfaces_dropped_;
  }
}

void MappingNode::OnPose(const PoseConstPtr& pose) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    answers_.push_back(pose);
    if (answers_.size() > kMaxWaitingSurfaces) {
      answers_.pop_front();
      ++poses_dropped_;
    }
  }
  worker_->Wake();
}

void MappingNode::OnDepth(const std_msgs::Header& header, DepthMessage message) {
  const std::int64_t t_ns = FromRosTime(header.stamp) + NsFromSeconds(config_.depth_time_offset_s);
  message.t_ns = t_ns;
  depth_input_->Arrived(t_ns);
  rig_->SetDepthFrame(header.frame_id);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (t_ns == last_depth_ns_) {
    ++depth_of_same_stamp_;
    return;
  }
  if (last_depth_ns_ != 0 && SecondsFromNs(t_ns - last_depth_ns_) < -kPlayedAgain_s) {
    depths_.clear();
    // Already there when the surfaces went back first.
    depth_awaits_epoch_ = SecondsFromNs(surface_ns_ - t_ns) > kPlayedAgain_s;
    before_step_back_ns_ = last_depth_ns_;
  } else if (t_ns > before_step_back_ns_) {
    depth_awaits_epoch_ = false;  // one stamp was wrong
  }
  last_depth_ns_ = t_ns;
  depths_.push_back(std::move(message));
  if (depths_.size() > depth_queue_size_) {
    depths_.pop_front();
    ++depth_dropped_;
    depth_awaits_epoch_ = false;  // only the depth's clock was set back
  }
}

bool MappingNode::IsCopyWanted() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (copy_wanted_ && !mapper_) {
    copy_wanted_ = false;
    copied_.notify_all();
  }
  return copy_wanted_;
}

std::deque<MappingNode::DepthMessage> MappingNode::TakeDepth() {
  std::deque<DepthMessage> taken, waiting;
  if (depth_awaits_epoch_) return taken;
  for (DepthMessage& message : depths_) {
    (IsOfTheirTime(message.t_ns, surface_ns_) ? taken : waiting).push_back(std::move(message));
  }
  depths_.swap(waiting);
  return taken;
}

std::optional<MappingNode::Work> MappingNode::TakeWork() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (new_mapper_) mapper_ = std::move(new_mapper_);
  if (!mapper_ || answers_.empty()) return std::nullopt;
  if (std::exchange(options_changed_, false)) mapper_->SetOptions(config_.odometry);
  Work work;
  work.answer = answers_.front();
  answers_.pop_front();
  const PoseEstimate& answer = *work.answer;
  // Surfaces of an older epoch get no answer any more.
  while (!surfaces_.empty() && surfaces_.front()->epoch < answer.epoch) surfaces_.pop_front();
  while (!surfaces_.empty() && surfaces_.front()->epoch == answer.epoch && surfaces_.front()->t_ns <= answer.t_ns) {
    work.surfaces.push_back(surfaces_.front());
    surfaces_.pop_front();
  }
  if (work.surfaces.empty()) return work;
  if (answer.epoch != epoch_) {
    depth_awaits_epoch_ = false;
    before_step_back_ns_ = 0;
  }
  epoch_ = answer.epoch;
  surface_ns_ = answer.t_ns;
  work.depths = TakeDepth();
  return work;
}

bool MappingNode::Step() {
  if (IsCopyWanted()) CopyGlobalMap();
  const std::optional<Work> work = TakeWork();
  if (!work || work->surfaces.empty()) return work.has_value();
  try {
    Map(*work);
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM_THROTTLE(1, private_nh_.getNamespace() << ": " << error.what());
    const std::lock_guard<std::mutex> lock(mutex_);
    failures_.Add(error.what());
  }
  return true;
}

void MappingNode::Map(const Work& work) {
  const ros::WallTime begin = ros::WallTime::now();
  // Surfaces first: those of a new epoch have the mapper forget what it was given before.
  Feed(work.surfaces, *work.answer);
  for (const DepthMessage& message : work.depths) AddDepth(message);
  // Tracking need not wait for the map to learn where depth saw the camera.
  mapper_->AlignDepth();
  PublishDepthPoses();
  const LocalMapPtr map = mapper_->Update();
  const double ms = 1e3 * (ros::WallTime::now() - begin).toSec();
  if (mapper_->last_match().surface && !resolved_.rig.depth_from_lidar) JudgeAlignment(mapper_->last_match());
  DrawLidarOverlay();
  if (mapper_->scene_depth().t_ns != scene_depth_ns_) {
    scene_depth_ns_ = mapper_->scene_depth().t_ns;
    scene_depth_publisher_.publish(boost::make_shared<const SceneDepth>(mapper_->scene_depth()));
  }
  PublishDepthPoses();
  if (map) {
    // Until then all poses wait for this thread.
    if (!std::exchange(yields_, true)) LetOthersFirst();
    Publish(map);
  }
  PublishGlobalMap();
  NoteCounters();
  const std::lock_guard<std::mutex> lock(mutex_);
  scene_depth_ = mapper_->scene_depth();
  if (!work.depths.empty()) mapping_ms_.Add(ms);
}

void MappingNode::PublishDepthPoses() {
  for (const DepthPose& pose : mapper_->TakeDepthPoses()) {
    depth_pose_publisher_.publish(boost::make_shared<const DepthPose>(pose));
  }
}

void MappingNode::NoteCounters() {
  const MappingCounters& now = mapper_->counters();
  const std::string name = private_nh_.getNamespace();
  if (now.depth_jumps > counters_.depth_jumps) {
    ROS_WARN_STREAM_THROTTLE(1,
                             name << ": the depth camera sees the same scene otherwise from one image to the next (a "
                                     "correction of its own calibration); earlier images are forgotten");
  }
  if (now.depth_repeated > counters_.depth_repeated) {
    ROS_WARN_STREAM_THROTTLE(
        1, name << ": a depth image came again with another stamp, expected one of that time; it is not used");
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (now.depth_too_late > counters_.depth_too_late) {
    ROS_WARN_STREAM_THROTTLE(10, name << ": " << kTooLate);
    too_late_ = ros::WallTime::now();
  }
  counters_ = now;
}

void MappingNode::AddImage(const sensor_msgs::Image& image) {
  const DepthImage depth = ToDepthImage(image, config_.depth_scale, NsFromSeconds(config_.depth_time_offset_s));
  const Camera& camera = resolved_.rig.depth_camera;
  if (depth.depth_m.cols != camera.width() || depth.depth_m.rows != camera.height()) {
    throw std::runtime_error("depth images are " + std::to_string(depth.depth_m.cols) + "x" +
                             std::to_string(depth.depth_m.rows) + "; expected " + std::to_string(camera.width()) + "x" +
                             std::to_string(camera.height()) + " as the depth camera's calibration says");
  }
  mapper_->AddDepth(depth);
  DrawDepthOverlay(depth, resolved_.rig.T_event_depth);
}

void MappingNode::AddDepth(const DepthMessage& message) {
  try {
    if (message.image) {
      AddImage(*message.image);
    } else {
      mapper_->AddSweep(
          ToLidarSweep(*message.points, config_.points_turn_s, NsFromSeconds(config_.depth_time_offset_s)));
    }
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM_THROTTLE(10, private_nh_.getNamespace() << ": " << error.what());
    const std::lock_guard<std::mutex> lock(mutex_);
    ++depth_refused_;
    failures_.Add(error.what());
  }
}

void MappingNode::Feed(const std::deque<SurfaceConstPtr>& surfaces, const PoseEstimate& pose) {
  if (!last_surface_ || last_surface_->epoch != pose.epoch) {
    // The mapper resets itself with the surface below; what was drawn of the old epoch goes here.
    const std::lock_guard<std::mutex> lock(mutex_);
    global_map_.clear();
    global_map_ns_ = 0;
  }
  for (const SurfaceConstPtr& surface : surfaces) mapper_->AddSurface(ToStd(surface));
  last_surface_ = surfaces.back();
  if (pose.state != TrackingState::kInitialising) mapper_->AddPose(pose);
}

void MappingNode::JudgeAlignment(const Mapper::Match& match) {
  if (std::abs(SecondsFromNs(match.depth.t_ns - judged_ns_)) < kJudgePeriod_s || match.surface->still) return;
  judged_ns_ = match.depth.t_ns;
  const SilhouetteFit fit =
      FitSilhouettes(ProjectSilhouettes(match.depth.depth_m, DepthRays(), match.T_event_depth, undistorted_),
                     *match.surface, match.velocity_event, undistorted_);
  if (fit.silhouettes == 0) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  alignment_.push_back(fit);
  if (alignment_.size() > kJudgedImages) alignment_.pop_front();
}

void MappingNode::Publish(const LocalMapPtr& map) {
  map_publisher_.publish(ToBoost(map));
  local_cloud_publisher_.publish(
      ToPointCloudMsg(map->points, T_odom_world_ * map->T_world_ref, map->t_ns, odom_frame_));
  // Copying all points for each map would cost more the longer it runs.
  if (SecondsFromNs(map->t_ns - global_map_ns_) < kGlobalMapEvery_s && global_map_ns_ != 0) return;
  global_map_ns_ = map->t_ns;
  CopyGlobalMap();
  global_map_wanted_ = true;
}

void MappingNode::CopyGlobalMap() {
  std::vector<MapPoint> all = mapper_->GlobalMap();
  const std::lock_guard<std::mutex> lock(mutex_);
  global_map_ = std::move(all);
  copy_wanted_ = false;
  copied_.notify_all();
}

void MappingNode::PublishGlobalMap() {
  // Latched: the last one also reaches those who come later.
  if (!global_map_wanted_) return;
  global_map_wanted_ = false;
  global_cloud_publisher_.publish(ToPointCloudMsg(global_map_, T_odom_world_, last_surface_->t_ns, odom_frame_));
}

const cv::Mat2f& MappingNode::DepthRays() {
  if (depth_rays_.empty()) {
    // What a LiDAR's sweeps become is in the undistorted event image.
    depth_rays_ = RayTable(resolved_.rig.depth_from_lidar ? undistorted_ : resolved_.rig.depth_camera);
  }
  return depth_rays_;
}

void MappingNode::DrawDepthOverlay(const DepthImage& depth, const Rigid3& T_event_depth) {
  if (!last_surface_ || overlay_publisher_.getNumSubscribers() == 0) return;
  const cv::Mat3b picture = RenderDepthOverlay(*last_surface_, depth, DepthRays(), T_event_depth, undistorted_);
  overlay_publisher_.publish(ToImageMsg(picture, depth.t_ns, resolved_.event_frame));
}

void MappingNode::DrawLidarOverlay() {
  const DepthImage& depth = mapper_->lidar_depth();
  if (depth.depth_m.empty() || depth.t_ns == drawn_ns_) return;
  drawn_ns_ = depth.t_ns;
  DrawDepthOverlay(depth, Rigid3());
}

bool MappingNode::OnSaveMap(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  std::vector<MapPoint> points;
  Rigid3 T_odom_world;
  {
    std::unique_lock<std::mutex> lock(mutex_);
    copy_wanted_ = true;
    worker_->Wake();
    // The one of up to a second ago, where the worker is busy for so long.
    copied_.wait_for(lock, std::chrono::duration<double>(kMaxCopy_s), [this] { return !copy_wanted_; });
    points = global_map_;
    T_odom_world = T_odom_world_;
  }
  for (MapPoint& point : points) point.p_ref = (T_odom_world * point.p_ref.cast<double>()).cast<float>();
  try {
    WritePointCloud(map_file_, points);
    response.success = 1;
    response.message = std::to_string(points.size()) + " points written to " + map_file_;
  } catch (const std::exception& error) {
    response.success = 0;
    response.message = error.what();
  }
  return true;
}

void MappingNode::FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (failures_.Fill(status)) {
    // its summary stays
  } else if (surface_input_->IsSilent()) {
    status.summary(DiagnosticStatus::WARN, "no data");
  } else if (counters_.references == 0) {
    status.summary(DiagnosticStatus::WARN, "no reference yet");
  } else {
    status.summary(DiagnosticStatus::OK, "mapping");
  }
  // Of what comes now: depth goes on while events are paused, or have ended.
  if (surface_ns_ != 0 && last_depth_ns_ != 0 && !surface_input_->IsSilent() && !depth_input_->IsSilent()) {
    const std::string complaint = ComplaintOfDepthClock(last_depth_ns_, surface_ns_);
    if (!complaint.empty()) status.mergeSummary(DiagnosticStatus::WARN, complaint);
    if (ros::WallTime::now() - too_late_ < ros::WallDuration(kShown_s)) {
      status.mergeSummary(DiagnosticStatus::WARN, kTooLate);
    }
  }
  SilhouetteFit fit;
  for (const SilhouetteFit& one : alignment_) fit += one;
  if (fit.silhouettes >= kEnoughSilhouettes && fit.MatchedShare() < kMoreThanChance * fit.ChanceShare()) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "silhouettes of the depth do not lie on edges of the events: check T_event_depth and "
                        "depth_time_offset_s (devo_check_alignment)");
  }
  status.add("silhouettes of the depth that moved", fit.silhouettes);
  status.addf("of these on an edge of the events (share)", "%.2f", fit.MatchedShare());
  status.addf("on an edge by chance (share)", "%.2f", fit.ChanceShare());
  status.addf("silhouettes to their edges, mean (px)", "%.2f", fit.MeanDistancePx());
  status.add("epoch", epoch_);
  status.add("references", counters_.references);
  status.add("points in the global map", global_map_.size());
  status.add("depth images used", counters_.depth_used);
  status.add("depth images aligned to earlier ones", counters_.depth_aligned);
  status.add("depth images aligned without a thing that moves", counters_.depth_without_thing);
  status.add("times the depth camera began to see otherwise", counters_.depth_jumps);
  status.add("depth images that came again with another stamp", counters_.depth_repeated);
  status.add("depth images without a valid pixel", counters_.depth_without_valid_pixel);
  status.add("depth images with the stamp of the one before", depth_of_same_stamp_);
  status.add("depth images too late for their surfaces", counters_.depth_too_late);
  status.add("depth images dropped", depth_dropped_);
  status.add("depth images refused", depth_refused_);
  status.add("surfaces dropped", surfaces_dropped_);
  status.add("poses dropped", poses_dropped_);
  status.addf("scene depth, median (m)", "%.2f", scene_depth_.median_m);
  status.addf("mapping p50 (ms)", "%.2f", mapping_ms_.At(0.5));
  status.addf("mapping p99 (ms)", "%.2f", mapping_ms_.At(0.99));
}

}  // namespace devo
