// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/time_surface_node.h"

#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include "devo/core/time.h"
#include "devo/ros/parameters.h"
#include "devo/ros/played_again.h"
#include "devo/ros/rendering.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

using diagnostic_msgs::DiagnosticStatus;

// Stamps a little out of order are the builder's business; more than this is another recording, or the same again.
// Without events for this long there is nothing to render in between.
constexpr double kSilence_s = 0.5;
// How long a surface waits for the pose before, in wall time, and after how many vain waits it waits no more (until
// tracking answers again): tracking may not be there.
constexpr double kPoseTimeout_s = 0.05;
constexpr int kMaxUnanswered = 3;
// A larger share of events outside the image is no disturbance but the calibration of another camera, as offline.
constexpr double kTolerableOutside = 0.01;
// A surface is due when the newest event is nearer to its time than this part of the period, and no other waits.
constexpr std::int64_t kTickTolerance = 100;

std::string Seconds(double seconds) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f s", seconds);
  return text;
}

}  // namespace

TimeSurfaceNode::TimeSurfaceNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), config_(ReadRigConfig(private_nh)),
      max_backlog_s_(ReadDouble(private_nh, "max_backlog_s", 0.15, 0.01, 10)),
      reset_after_gap_s_(ReadDouble(private_nh, "reset_after_gap_s", kRecordingGap_s, 0.5, 1e6)),
      max_queued_events_(1000 * static_cast<std::size_t>(ReadInt(private_nh, "max_queued_kevents", 2000, 10, 1000000))),
      period_ns_(NsFromSeconds(1 / config_.odometry.surface.rate_hz)), health_(nh, private_nh), image_transport_(nh) {
  const int queue_size = ReadInt(private_nh, "event_queue_size", 1000, 1, 1000000);
  const std::string event_frame = ReadString(private_nh, "event_frame", "");
  RefuseUnknown(private_nh,
                WithTunables(Module::kSurface, {"config", "set", "event_frame", "max_backlog_s", "reset_after_gap_s",
                                                "max_queued_kevents", "event_queue_size", "diagnostic_period"}));
  config_.odometry = ReadTunables(private_nh, Module::kSurface, config_.odometry);
  if (!event_frame.empty()) config_.frames.event = event_frame;
  const std::string topic = InputTopic(nh_, "events", config_.topics.events);
  if (topic.empty()) throw std::invalid_argument("topics.events is empty; expected the topic of the events");

  surface_publisher_ = nh_.advertise<Surface>(topics::kSurface, 8);
  image_publisher_ = image_transport_.advertise(topics::kSurfaceImage, 2);
  input_ = health_.AddInput("events", topic, "EventArray or EventPacket");
  rig_ =
      std::make_unique<RigResolver>(nh_, config_, RigResolver::Need{}, [this](const ResolvedRig& rig) { OnRig(rig); });
  health_.AddMissing([this](const KnownTopics& known) { return rig_->Missing(known); });
  health_.AddTask("time surface", [this](auto& status) { FillStatus(status); });
  worker_ = std::make_unique<Worker>(Worker::Urgency::kUrgent, [this] { return Step(); });

  scene_depth_subscriber_ = nh_.subscribe<SceneDepth>(topics::kSceneDepth, 2,
                                                      boost::function<void(const boost::shared_ptr<const SceneDepth>&)>(
                                                          [this](const boost::shared_ptr<const SceneDepth>& depth) {
                                                            const std::lock_guard<std::mutex> lock(mutex_);
                                                            scene_depth_ = depth;
                                                          }));
  tunables_ = std::make_unique<Tunables>(nh_, private_nh_, Module::kSurface, config_.odometry,
                                         [this](const OdometryOptions& options) { OnOptions(options); });
  services_.push_back(private_nh_.advertiseService("reset", &TimeSurfaceNode::OnReset, this));
  services_.push_back(private_nh_.advertiseService("pause", &TimeSurfaceNode::OnPause, this));
  rig_->Start();
  events_ = std::make_unique<EventSource>(nh_, topic, queue_size,
                                          [this](EventMessage message) { OnEvents(std::move(message)); });
  // Last, since nothing may throw any more: it must go before its worker.
  pose_subscriber_ = worker_->HandleOf(nh_).subscribe<PoseEstimate>(
      topics::kTrackedPose, 8,
      boost::function<void(const boost::shared_ptr<const PoseEstimate>&)>(
          [this](const boost::shared_ptr<const PoseEstimate>& pose) { OnPose(pose); }));
  health_.Start();
}

TimeSurfaceNode::~TimeSurfaceNode() {
  // No callback may find the worker gone.
  events_.reset();
  tunables_.reset();
  pose_subscriber_.shutdown();
  scene_depth_subscriber_.shutdown();
  services_.clear();
  worker_.reset();
}

void TimeSurfaceNode::OnEvents(EventMessage message) {
  if (paused_) {
    input_->ArrivedUnread();
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    message.after_pause = std::exchange(pause_ended_, false);
    queued_events_ += message.num_events;
    messages_.push_back(std::move(message));
    while (queued_events_ > max_queued_events_ && messages_.size() > 1) {
      const bool after_pause = messages_.front().after_pause;
      queued_events_ -= messages_.front().num_events;
      dropped_events_ += messages_.front().num_events;
      messages_.pop_front();
      messages_.front().after_loss = true;
      messages_.front().after_pause |= after_pause;
    }
  }
  worker_->Wake();
}

void TimeSurfaceNode::OnRig(const ResolvedRig& rig) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    new_builder_ = std::make_unique<SurfaceBuilder>(rig.rig.event_camera, config_.odometry.surface);
    event_frame_ = rig.event_frame;
  }
  worker_->Wake();
}

void TimeSurfaceNode::OnOptions(const OdometryOptions& options) {
  const std::lock_guard<std::mutex> lock(mutex_);
  config_.odometry = options;
  options_changed_ = true;
}

void TimeSurfaceNode::OnPose(const boost::shared_ptr<const PoseEstimate>& estimate) {
  // This thread may be busy with the next events when the pose is out.
  ros::WallTime published = ros::WallTime::now();
  if (estimate->published_ns > 0) published.fromNSec(static_cast<std::uint64_t>(estimate->published_ns));
  const std::lock_guard<std::mutex> lock(mutex_);
  if (estimate->epoch != epoch_) return;
  const bool had_pose = last_pose_ && last_pose_->state != TrackingState::kInitialising;
  if (had_pose && estimate->state == TrackingState::kInitialising && reset_because_.empty()) {
    reset_because_ = "tracking or mapping has been started again";
  }
  last_pose_ = estimate;
  if (estimate->state != TrackingState::kInitialising) ++poses_of_epoch_;
  while (!awaiting_pose_.empty() && awaiting_pose_.front().first <= estimate->t_ns) {
    if (awaiting_pose_.front().first == estimate->t_ns && estimate->state != TrackingState::kInitialising) {
      latency_ms_.Add(1e3 * (published - awaiting_pose_.front().second).toSec());
    }
    awaiting_pose_.pop_front();
  }
}

bool TimeSurfaceNode::OnReset(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    reset_because_ = "a reset was asked for";
  }
  worker_->Wake();
  response.success = 1;
  response.message = "the next surface begins a new epoch in all three modules";
  return true;
}

bool TimeSurfaceNode::OnPause(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (paused_ && !request.data) pause_ended_ = true;
    paused_ = request.data;
  }
  response.success = 1;
  response.message = paused_ ? "paused: events are not taken" : "running";
  return true;
}

bool TimeSurfaceNode::Step() {
  try {
    TakeRequests();
    TakeMessages();
    if (!builder_) DropBatches();
    if (batches_.empty()) return UseTheWait();
    Batch& batch = batches_.front();
    PrepareFor(&batch);
    const auto begin = batch.events.begin() + static_cast<std::ptrdiff_t>(batch.next);
    const auto until =
        std::partition_point(begin, batch.events.end(), [&](const Event& e) { return e.t_ns < next_tick_ns_; });
    const auto count = static_cast<std::size_t>(until - begin);
    if (count > 0) {
      builder_->Insert({&*begin, count});
      inserted_ns_ = std::max(inserted_ns_, std::prev(until)->t_ns);
      batch.next += count;
    }
    last_arrival_ = batch.arrival;
    if (batch.next == batch.events.size()) {
      Finish(std::move(batch));
      batches_.pop_front();
      return true;
    }
    if (!SkipWhenBehind()) RenderTick();
    return true;
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM_THROTTLE(1, private_nh_.getNamespace() << ": " << error.what());
    const std::lock_guard<std::mutex> lock(mutex_);
    failures_.Add(error.what());
    return false;
  }
}

void TimeSurfaceNode::PrepareFor(Batch* batch) {
  const std::int64_t first_ns = batch->events[batch->next].t_ns;
  const std::string why = std::exchange(batch->begins_epoch, {});
  if (!why.empty()) BeginEpoch(why);
  if (std::exchange(batch->after_pause, false) && next_tick_ns_ != 0) {
    next_tick_ns_ = std::max(next_tick_ns_, TickAfter(first_ns));
    builder_->OnLoss(first_ns);
  }
  if (std::exchange(batch->after_loss, false) && next_tick_ns_ != 0) {
    SkipTo(TickAfter(first_ns));
    builder_->OnLoss(first_ns);
  }
  // Surfaces lie on multiples of the period, as in the offline runner.
  const bool silence = next_tick_ns_ != 0 && first_ns - inserted_ns_ > NsFromSeconds(kSilence_s);
  if (next_tick_ns_ == 0 || silence) next_tick_ns_ = TickAfter(first_ns);
}

bool TimeSurfaceNode::UseTheWait() {
  if (!builder_ || next_tick_ns_ == 0) return false;
  // Drivers that cut their stream at multiples of the period would else have every surface wait for one more message.
  if (next_tick_ns_ - inserted_ns_ < period_ns_ / kTickTolerance) {
    RenderTick();
    return true;
  }
  builder_->Filter();
  return false;
}

void TimeSurfaceNode::TakeRequests() {
  std::string reset_because;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (new_builder_) builder_ = std::move(new_builder_);
    std::swap(reset_because, reset_because_);
    if (builder_) counters_ = builder_->counters();
    if (builder_ && std::exchange(options_changed_, false)) builder_->SetOptions(config_.odometry.surface);
  }
  if (reset_because.empty() || !builder_) return;
  DropBatches();
  BeginEpoch(reset_because);
}

void TimeSurfaceNode::TakeMessages() {
  while (std::optional<EventMessage> message = NextMessage()) {
    Batch batch;
    batch.arrival = message->arrival;
    batch.queued_as = message->num_events;
    lost_ |= message->after_loss;
    resumed_ |= message->after_pause;
    batch.events = std::exchange(spare_, {});
    batch.events.clear();
    try {
      message->append(&packets_, &batch.events);
    } catch (const std::exception&) {
      Finish(std::move(batch));
      throw;
    }
    CountAs(batch.events.size(), &batch);
    if (batch.events.empty()) {
      input_->ArrivedEmpty();
      Finish(std::move(batch));
      continue;
    }
    Accept(std::move(batch));
  }
  if (batches_.empty() && burst_) ReturnMemory();
}

std::optional<EventMessage> TimeSurfaceNode::NextMessage() {
  const std::lock_guard<std::mutex> lock(mutex_);
  burst_ = burst_ || queued_events_ > max_queued_events_ / 4;
  // The rest waits as it came, where the oldest can be dropped at no cost.
  if (messages_.empty() || decoded_events_ > max_queued_events_ / 2) return std::nullopt;
  EventMessage message = std::move(messages_.front());
  messages_.pop_front();
  decoded_events_ += message.num_events;
  return message;
}

void TimeSurfaceNode::Accept(Batch batch) {
  // Within a message stamps may go back a little, too.
  if (!std::is_sorted(batch.events.begin(), batch.events.end(), IsEarlier)) {
    std::stable_sort(batch.events.begin(), batch.events.end(), IsEarlier);
  }
  CountDropped(DropStrayEvents(reset_after_gap_s_, &batch.events));
  const std::int64_t first_ns = batch.events.front().t_ns, last_ns = batch.events.back().t_ns;
  batch.after_pause = std::exchange(resumed_, false);
  batch.after_loss = std::exchange(lost_, false);
  if (newest_event_ns_ != 0) {
    // The whole message must be older: single events that are, the builder leaves out.
    const double ahead_s = SecondsFromNs(last_ns - newest_event_ns_);
    const double gap_s = batch.after_pause ? 0 : SecondsFromNs(first_ns - newest_event_ns_);
    if (ahead_s < -kPlayedAgain_s) batch.begins_epoch = "the events' time went back by " + Seconds(-ahead_s);
    if (gap_s > reset_after_gap_s_) {
      batch.begins_epoch = "no events came for " + Seconds(gap_s) + ", longer than reset_after_gap_s";
    }
  }
  newest_event_ns_ = batch.begins_epoch.empty() ? std::max(newest_event_ns_, last_ns) : last_ns;
  input_->Arrived(first_ns);
  batches_.push_back(std::move(batch));
}

void TimeSurfaceNode::ReturnMemory() {
  burst_ = false;
  spare_ = {};
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

void TimeSurfaceNode::CountAs(std::size_t events, Batch* batch) {
  const std::size_t before = std::exchange(batch->queued_as, events);
  decoded_events_ = decoded_events_ - before + events;
  const std::lock_guard<std::mutex> lock(mutex_);
  queued_events_ = queued_events_ - before + events;
}

void TimeSurfaceNode::Finish(Batch batch) {
  spare_ = std::move(batch.events);
  decoded_events_ -= batch.queued_as;
  const std::lock_guard<std::mutex> lock(mutex_);
  queued_events_ -= batch.queued_as;
}

void TimeSurfaceNode::DropBatches() {
  for (; !batches_.empty(); batches_.pop_front()) {
    CountDropped(batches_.front().events.size());
    Finish(std::move(batches_.front()));
  }
}

void TimeSurfaceNode::CountDropped(std::size_t events) {
  const std::lock_guard<std::mutex> lock(mutex_);
  dropped_events_ += events;
}

void TimeSurfaceNode::BeginEpoch(const std::string& why) {
  builder_->Reset();
  next_tick_ns_ = 0;
  last_surface_ns_ = 0;
  inserted_ns_ = 0;
  unanswered_ = 0;
  const std::lock_guard<std::mutex> lock(mutex_);
  epoch_ = builder_->epoch();
  last_pose_.reset();
  scene_depth_.reset();
  awaiting_pose_.clear();
  const std::string begins = private_nh_.getNamespace() + ": epoch " + std::to_string(epoch_) + " begins, since " + why;
  const std::uint64_t poses = std::exchange(poses_of_epoch_, 0);
  if (poses > 0) {
    ROS_WARN_STREAM(begins << ": " << poses
                           << " poses, their path and their map are forgotten (save_at_shutdown keeps the poses)");
  } else {
    ROS_INFO_STREAM(begins);
  }
}

std::int64_t TimeSurfaceNode::TickAfter(std::int64_t t_ns) const { return (t_ns / period_ns_ + 1) * period_ns_; }

void TimeSurfaceNode::SkipTo(std::int64_t tick_ns) {
  const std::int64_t ticks = std::max<std::int64_t>(0, (tick_ns - next_tick_ns_) / period_ns_);
  next_tick_ns_ += ticks * period_ns_;
  const std::lock_guard<std::mutex> lock(mutex_);
  skipped_ += static_cast<std::uint64_t>(ticks);
}

bool TimeSurfaceNode::SkipWhenBehind() {
  // Only this epoch's events count: those of the next have times of their own.
  std::int64_t newest_ns = next_tick_ns_;
  for (const Batch& batch : batches_) {
    if (!batch.begins_epoch.empty() || batch.after_pause) break;
    newest_ns = std::max(newest_ns, batch.events.back().t_ns);
  }
  const std::int64_t backlog_ns = newest_ns - next_tick_ns_;
  if (backlog_ns <= NsFromSeconds(max_backlog_s_)) return false;
  SkipTo(TickAfter(next_tick_ns_ + backlog_ns / 2));
  return true;
}

std::optional<ExpectedMotion> TimeSurfaceNode::AwaitMotion() {
  const auto answered = [this](std::int64_t t_ns) { return last_pose_ && last_pose_->t_ns >= t_ns; };
  if (last_surface_ns_ != 0 && unanswered_ < kMaxUnanswered) {
    const bool in_time =
        worker_->RunCallbacksUntil([&] { return answered(last_surface_ns_); }, ros::WallDuration(kPoseTimeout_s));
    unanswered_ = in_time ? 0 : unanswered_ + 1;
  } else if (answered(last_surface_ns_ - 2 * period_ns_)) {
    unanswered_ = 0;
  }
  if (!last_pose_) return std::nullopt;
  if (last_pose_->state != TrackingState::kInitialising) return ExpectedMotion(*last_pose_);
  return ExpectedMotion::OfTurn(last_pose_->velocity_event.tail<3>());
}

void TimeSurfaceNode::RenderTick() {
  const std::optional<ExpectedMotion> motion = AwaitMotion();
  boost::shared_ptr<const SceneDepth> depth;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    depth = scene_depth_;
  }
  const ros::WallTime begin = ros::WallTime::now();
  const SurfacePtr surface = builder_->Render(next_tick_ns_, motion, depth ? *depth : SceneDepth());
  const double render_ms = 1e3 * (ros::WallTime::now() - begin).toSec();
  last_surface_ns_ = surface->t_ns;
  next_tick_ns_ += period_ns_;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    render_ms_.Add(render_ms);
    counters_ = builder_->counters();
    surface_rate_.Add(surface->t_ns);
    event_rate_hz_ = surface->event_rate_hz;
    ++surfaces_;
    awaiting_pose_.emplace_back(surface->t_ns, last_arrival_);
    if (awaiting_pose_.size() > 64) awaiting_pose_.pop_front();
  }
  surface_publisher_.publish(ToBoost(surface));
  if (image_publisher_.getNumSubscribers() > 0) PublishImage(*surface);
}

void TimeSurfaceNode::PublishImage(const Surface& surface) {
  image_publisher_.publish(ToImageMsg(surface.image, surface.t_ns, event_frame_));
}

void TimeSurfaceNode::FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (failures_.Fill(status)) {
    // its summary stays
  } else if (paused_) {
    status.summary(DiagnosticStatus::WARN, "paused");
  } else if (input_->IsSilent()) {
    status.summary(DiagnosticStatus::WARN, "no data");
  } else if (surfaces_ == 0) {
    status.summary(DiagnosticStatus::WARN, "no surface yet");
  } else {
    status.summary(DiagnosticStatus::OK, "rendering");
  }
  if (static_cast<double>(counters_.outside) > kTolerableOutside * static_cast<double>(counters_.in)) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "events lie outside the image: is event_camera (or its CameraInfo) this camera's?");
  }
  const std::string of_lamps = LampComplaint(counters_);
  if (!of_lamps.empty()) status.mergeSummary(DiagnosticStatus::WARN, of_lamps);
  status.add("epoch", epoch_);
  status.add("surfaces", surfaces_);
  status.add("surfaces skipped", skipped_);
  status.addf("surface rate (Hz of data time)", "%.1f", surface_rate_.Hz());
  status.addf("event rate (Mev/s)", "%.3f", 1e-6 * event_rate_hz_);
  status.add("events in", counters_.in);
  status.add("events outside the image", counters_.outside);
  status.add("events out of order", counters_.unordered);
  status.add("events of lamps that flicker", counters_.of_lamps);
  status.add("events taken for noise", counters_.noise);
  status.add("events dropped", dropped_events_);
  status.addf("rendering p50 (ms)", "%.2f", render_ms_.At(0.5));
  status.addf("rendering p99 (ms)", "%.2f", render_ms_.At(0.99));
  status.addf("latency event to pose p50 (ms)", "%.2f", latency_ms_.At(0.5));
  status.addf("latency event to pose p99 (ms)", "%.2f", latency_ms_.At(0.99));
  status.addf("latency event to pose max (ms)", "%.2f", latency_ms_.At(1));
}

}  // namespace devo
