// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/tracking_node.h"

#include <cstdio>
#include <cstdlib>
#include <utility>

#include <boost/make_shared.hpp>

#include "devo/core/time.h"
#include "devo/io/evaluation.h"
#include "devo/ros/parameters.h"
#include "devo/ros/rendering.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr std::size_t kMaxWaitingDepthPoses = 8;

int LevelOf(TrackingState state) {
  switch (state) {
    case TrackingState::kTracking:
    case TrackingState::kRecovered: return DiagnosticStatus::OK;
    case TrackingState::kLost: return DiagnosticStatus::ERROR;
    default: return DiagnosticStatus::WARN;
  }
}

}  // namespace

TrackingNode::TrackingNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), config_(ReadRigConfig(private_nh)),
      max_poses_(static_cast<std::size_t>(ReadInt(private_nh, "trajectory_max_poses", 1'440'000, 1, 100'000'000))),
      trajectory_(max_poses_), health_(nh, private_nh), image_transport_(nh) {
  frames_.odom = ReadString(private_nh, "odom_frame", "odom");
  frames_.event = ReadString(private_nh, "event_frame", "");
  frames_.base = ReadString(private_nh, "base_frame", "");
  frames_.initial_pose = ReadPose(private_nh, "initial_pose", Rigid3());
  output_.publish_tf = ReadBool(private_nh, "publish_tf", true);
  output_.invert_tf = ReadBool(private_nh, "invert_tf", false);
  output_.path_min_distance_m = ReadDouble(private_nh, "path_min_distance_m", 0.01, 0, 100);
  trajectory_file_ = ReadPath(private_nh, "trajectory_file", "devo_trajectory.txt");
  save_at_shutdown_ = ReadBool(private_nh, "save_at_shutdown", false);
  surface_queue_size_ = static_cast<std::size_t>(ReadInt(private_nh, "surface_queue_size", 4, 1, 1000));
  RefuseUnknown(private_nh,
                WithTunables(Module::kTracking,
                             {"config", "set", "odom_frame", "event_frame", "base_frame", "initial_pose", "publish_tf",
                              "invert_tf", "path_min_distance_m", "trajectory_file", "save_at_shutdown",
                              "surface_queue_size", "trajectory_max_poses", "diagnostic_period"}));
  config_.odometry = ReadTunables(private_nh, Module::kTracking, config_.odometry);
  if (frames_.odom.empty())
    throw std::invalid_argument("parameter " + private_nh.resolveName("odom_frame") + " is empty");
  if (!frames_.event.empty()) config_.frames.event = frames_.event;

  tracked_pose_publisher_ = nh_.advertise<PoseEstimate>(topics::kTrackedPose, 8);
  reprojection_publisher_ = image_transport_.advertise(topics::kReprojectionImage, 2);
  surface_input_ = health_.AddInput("surfaces", nh_.resolveName(topics::kSurface), "TimeSurface");
  map_input_ =
      health_.AddInput("local maps", nh_.resolveName(topics::kSemiDenseMap), "SemiDenseMap", Input::Kind::kOccasional);
  RigResolver::Need need;
  need.base_frame = frames_.base;
  const std::string imu_topic = InputTopic(nh_, "imu", config_.topics.imu);
  need.imu = !imu_topic.empty();
  rig_ = std::make_unique<RigResolver>(nh_, config_, need, [this](const ResolvedRig& rig) { OnRig(rig); });
  if (!imu_topic.empty()) {
    imu_input_ = health_.AddInput("IMU samples", nh_.resolveName(imu_topic), "Imu", Input::Kind::kOptional);
    imu_ = std::make_unique<ImuInput>(
        nh_, imu_topic, NsFromSeconds(config_.imu_time_offset_s), [this] { return rig_->imu_surroundings(); },
        [this](std::int64_t t_ns) { imu_input_->Arrived(t_ns); });
  }
  health_.AddMissing([this](const KnownTopics& known) { return rig_->Missing(known); });
  health_.AddTask("tracking", [this](auto& status) { FillStatus(status); });
  worker_ = std::make_unique<Worker>(Worker::Urgency::kUrgent, [this] { return Step(); });

  if (!config_.topics.ground_truth.empty()) {
    const GroundTruth::Options options{max_poses_, output_.path_min_distance_m};
    ground_truth_ = std::make_unique<GroundTruth>(nh_, config_.topics.ground_truth,
                                                  config_.T_body_event.value_or(Rigid3()), options);
  }
  map_subscriber_ = nh_.subscribe<LocalMap>(topics::kSemiDenseMap, 4,
                                            boost::function<void(const boost::shared_ptr<const LocalMap>&)>(
                                                [this](const boost::shared_ptr<const LocalMap>& map) { OnMap(map); }));
  depth_pose_subscriber_ =
      nh_.subscribe<DepthPose>(topics::kDepthPose, 8,
                               boost::function<void(const boost::shared_ptr<const DepthPose>&)>(
                                   [this](const boost::shared_ptr<const DepthPose>& pose) { OnDepthPose(pose); }));
  tunables_ = std::make_unique<Tunables>(nh_, private_nh_, Module::kTracking, config_.odometry,
                                         [this](const OdometryOptions& options) { OnOptions(options); });
  save_service_ =
      save_thread_.HandleOf(private_nh_).advertiseService("save_trajectory", &TrackingNode::OnSaveTrajectory, this);
  rig_->Start();
  // Last, since nothing may throw any more: it must go before its worker.
  surface_subscriber_ = worker_->HandleOf(nh_).subscribe<Surface>(
      topics::kSurface, 64,
      boost::function<void(const SurfaceConstPtr&)>([this](const SurfaceConstPtr& surface) { OnSurface(surface); }));
  health_.Start();
}

TrackingNode::~TrackingNode() {
  surface_subscriber_.shutdown();
  map_subscriber_.shutdown();
  depth_pose_subscriber_.shutdown();
  tunables_.reset();
  save_service_.shutdown();
  save_thread_.Stop();
  worker_.reset();
  if (!save_at_shutdown_) return;
  try {
    // ROS's log is closed by now.
    std::printf("%s: %s\n", private_nh_.getNamespace().c_str(), SaveTrajectory().c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", private_nh_.getNamespace().c_str(), error.what());
  }
}

void TrackingNode::OnRig(const ResolvedRig& rig) {
  OdometryFrames frames;
  frames.odom_frame = frames_.odom;
  frames.child_frame = frames_.base.empty() ? rig.event_frame : frames_.base;
  frames.T_event_child = rig.T_event_base.value_or(Rigid3());
  frames.T_odom_world = frames_.initial_pose * frames.T_event_child.inverse();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    new_tracker_ = std::make_unique<Tracker>(rig.rig.event_camera, config_.odometry);
    new_publisher_ = std::make_unique<OdometryPublisher>(nh_, frames, output_);
    camera_ = rig.rig.event_camera.Undistorted();
    event_frame_ = rig.event_frame;
  }
  worker_->Wake();
}

void TrackingNode::OnOptions(const OdometryOptions& options) {
  const std::lock_guard<std::mutex> lock(mutex_);
  config_.odometry = options;
  options_changed_ = true;
}

void TrackingNode::OnSurface(const SurfaceConstPtr& surface) {
  surface_input_->Arrived(surface->t_ns);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    surfaces_.push_back(surface);
    if (surfaces_.size() > surface_queue_size_) {
      surfaces_.pop_front();
      ++dropped_;
    }
  }
  worker_->Wake();
}

void TrackingNode::OnMap(const boost::shared_ptr<const LocalMap>& map) {
  map_input_->Arrived(map->t_ns);
  const std::lock_guard<std::mutex> lock(mutex_);
  new_map_ = map;
}

void TrackingNode::OnDepthPose(const boost::shared_ptr<const DepthPose>& pose) {
  const std::lock_guard<std::mutex> lock(mutex_);
  depth_poses_.push_back(pose);
  if (depth_poses_.size() > kMaxWaitingDepthPoses) depth_poses_.erase(depth_poses_.begin());
}

bool TrackingNode::Step() {
  SurfaceConstPtr surface;
  boost::shared_ptr<const LocalMap> map;
  std::vector<boost::shared_ptr<const DepthPose>> depth_poses;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (new_tracker_) {
      tracker_ = std::move(new_tracker_);
      publisher_ = std::move(new_publisher_);
    }
    if (!tracker_ || surfaces_.empty()) return false;
    if (std::exchange(options_changed_, false)) tracker_->SetOptions(config_.odometry);
    surface = surfaces_.front();
    surfaces_.pop_front();
    map.swap(new_map_);
    depth_poses.swap(depth_poses_);
  }
  try {
    if (epoch_ && *epoch_ != surface->epoch) {
      publisher_->Clear();
      if (ground_truth_) ground_truth_->Clear();
      EndTrajectory(*epoch_);
    }
    epoch_ = surface->epoch;
    const ros::WallTime begin = ros::WallTime::now();
    tracker_->BeginEpoch(surface->epoch);
    for (const auto& pose : depth_poses) tracker_->AddDepthPose(*pose);
    if (map) TakeMap(map);
    if (imu_) {
      for (const ImuSample& sample : imu_->TakeUntil(surface->t_ns)) tracker_->AddImu(sample);
    }
    const std::optional<PoseEstimate> pose = tracker_->Track(ToStd(surface));
    Answer(*surface, pose, 1e3 * (ros::WallTime::now() - begin).toSec());
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM_THROTTLE(1, private_nh_.getNamespace() << ": " << error.what());
    const std::lock_guard<std::mutex> lock(mutex_);
    failures_.Add(error.what());
  }
  return true;
}

void TrackingNode::TakeMap(const boost::shared_ptr<const LocalMap>& map) {
  // A mapping that was started again counts its maps anew, and in a world of its own. Without a map, the next answer
  // makes the surfaces begin a new epoch, for all three.
  if (map_ && map->epoch == map_->epoch && map->id <= map_->id) {
    map_.reset();
    tracker_->Reset();
    return;
  }
  map_ = map;
  tracker_->SetMap(ToStd(map));
}

void TrackingNode::Answer(const Surface& surface, const std::optional<PoseEstimate>& pose, double tracking_ms) {
  auto answer = boost::make_shared<PoseEstimate>();
  if (pose) {
    *answer = *pose;
  } else {
    answer->t_ns = surface.t_ns;
    answer->epoch = surface.epoch;
    if (const auto turn = tracker_->TurnRead(surface.t_ns)) answer->velocity_event.tail<3>() = *turn;
  }
  answer->published_ns = static_cast<std::int64_t>(ros::WallTime::now().toNSec());
  tracked_pose_publisher_.publish(boost::shared_ptr<const PoseEstimate>(answer));
  std::uint64_t dropped = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    last_ = *answer;
    dropped = dropped_;
    if (pose) {
      ++tracked_;
      tracking_ms_.Add(tracking_ms);
      pose_rate_.Add(pose->t_ns);
      const std::size_t before = trajectory_.size();
      trajectory_.Add({pose->t_ns, publisher_->frames().T_odom_world * pose->T_world_event});
      forgotten_ += trajectory_.size() == before ? 1 : 0;
    } else {
      ++untracked_;
    }
  }
  const std::string complaint = Complaint(answer->inertial_fit);
  if (!complaint.empty()) ROS_WARN_STREAM_THROTTLE(5, private_nh_.getNamespace() << ": " << complaint);
  publisher_->PublishStatus(surface, *answer, dropped);
  if (!pose) return;
  publisher_->Publish(*pose);
  if (ground_truth_) {
    ground_truth_->PublishPath(pose->t_ns, publisher_->frames().T_odom_world * pose->T_world_event, frames_.odom);
  }
  if (reprojection_publisher_.getNumSubscribers() > 0) DrawReprojection(surface, *pose);
}

void TrackingNode::DrawReprojection(const Surface& surface, const PoseEstimate& pose) {
  if (!map_ || map_->epoch != surface.epoch) return;
  const cv::Mat3b picture =
      RenderReprojection(surface, *map_, pose.T_world_event.inverse() * map_->T_world_ref, *camera_);
  reprojection_publisher_.publish(ToImageMsg(picture, surface.t_ns, event_frame_));
}

void TrackingNode::EndTrajectory(std::uint64_t epoch) {
  Trajectory trajectory;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (save_at_shutdown_) trajectory = trajectory_.Poses();
    trajectory_.Clear();
  }
  if (trajectory.empty()) return;
  const std::string file = WithEpoch(trajectory_file_, epoch);
  try {
    WriteTum(file, trajectory);
    ROS_INFO_STREAM(private_nh_.getNamespace()
                    << ": " << trajectory.size() << " poses of epoch " << epoch << " written to " << file);
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM(private_nh_.getNamespace()
                     << ": " << trajectory.size() << " poses of epoch " << epoch << " are lost: " << error.what());
  }
}

std::string TrackingNode::SaveTrajectory() {
  Trajectory trajectory;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    trajectory = trajectory_.Poses();
  }
  WriteTum(trajectory_file_, trajectory);
  std::string text = std::to_string(trajectory.size()) + " poses written to " + trajectory_file_;
  if (!ground_truth_) return text;
  try {
    const Evaluation e = Evaluate(ground_truth_->poses(), trajectory);
    char error[200];
    std::snprintf(error, sizeof(error), "; against ground truth: ATE RMSE %.4f m (%s), %s", e.ate_rmse_m,
                  DriftText(e, 2).c_str(), RpeText(e).c_str());
    return text + error;
  } catch (const std::exception& error) {
    return text + "; not compared with ground truth: " + error.what();
  }
}

bool TrackingNode::OnSaveTrajectory(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  try {
    response.message = SaveTrajectory();
    response.success = 1;
  } catch (const std::exception& error) {
    response.message = error.what();
    response.success = 0;
  }
  return true;
}

void TrackingNode::FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (failures_.Fill(status)) {
    // its summary stays
  } else if (tracked_ + untracked_ == 0 || surface_input_->IsSilent()) {
    status.summary(DiagnosticStatus::WARN, "no data");
  } else {
    status.summary(static_cast<unsigned char>(LevelOf(last_.state)), ToString(last_.state));
    const std::string complaint = Complaint(last_.inertial_fit);
    if (!complaint.empty()) status.mergeSummary(DiagnosticStatus::WARN, complaint);
  }
  status.add("tracking state", ToString(last_.state));
  status.add("epoch", last_.epoch);
  status.add("poses", tracked_);
  status.add("surfaces before the first map", untracked_);
  status.add("surfaces dropped", dropped_);
  status.add("oldest poses forgotten", forgotten_);
  if (imu_) imu_->Fill(status);
  status.addf("pose rate (Hz of data time)", "%.1f", pose_rate_.Hz());
  status.add("chapter of the map", last_.chapter);
  status.add("reference", last_.reference_id);
  status.add("points used", last_.points_used);
  status.addf("matched share", "%.2f", last_.inlier_share);
  status.addf("mean residual (px)", "%.2f", last_.mean_residual_px);
  status.addf("delay of events (ms)", "%.1f", 1e3 * last_.delays.event_s);
  status.addf("delay of depth images (ms)", "%.1f", 1e3 * last_.delays.depth_s);
  status.addf("delay of the IMU (ms)", "%.1f", 1e3 * last_.delays.inertial_s);
  status.addf("gyroscope's errors (times a good one's)", "%.1f", last_.inertial_fit.gyroscope);
  status.addf("accelerometer's errors (times a good one's)", "%.1f", last_.inertial_fit.accelerometer);
  status.addf("noise of the gyroscope (deg/s/sqrt(Hz))", "%.4f", 180 / M_PI * last_.inertial_fit.gyroscope_noise);
  status.addf("noise of the accelerometer (m/s^2/sqrt(Hz))", "%.4f", last_.inertial_fit.accelerometer_noise);
  if (last_.inertial_calibration) {
    const auto add = [&status](const char* key, const Eigen::Vector3d& v) {
      status.addf(key, "%.2f %.2f %.2f", v.x(), v.y(), v.z());
    };
    add("gyroscope reads too much about x, y, z (%)", 100 * last_.inertial_calibration->gyroscope_scale);
    add("IMU turned against T_event_imu (deg)", 180 / M_PI * last_.inertial_calibration->rotation);
    add("IMU shifted against T_event_imu (cm)", 100 * last_.inertial_calibration->translation_m);
  }
  status.addf("tracking p50 (ms)", "%.2f", tracking_ms_.At(0.5));
  status.addf("tracking p99 (ms)", "%.2f", tracking_ms_.At(0.99));
  status.addf("tracking max (ms)", "%.2f", tracking_ms_.At(1));
}

}  // namespace devo
