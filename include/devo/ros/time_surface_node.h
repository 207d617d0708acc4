// SPDX-License-Identifier: BSD-3-Clause
//
// The time-surface module as a ROS class: event messages in, one surface per tick of data time out.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "devo/core/surface_builder.h"
#include "devo/ros/core_messages.h"
#include "devo/ros/event_source.h"
#include "devo/ros/health.h"
#include "devo/ros/rig_resolver.h"
#include "devo/ros/tunables.h"
#include "devo/ros/worker.h"

namespace devo {

/// Renders a surface whenever the events pass a multiple of the surface period, or end just before it. The velocity of
/// the pose before flows back from tracking: a surface waits for it as long as tracking keeps up. When the backlog of
/// events grows beyond `max_backlog_s`, surfaces are skipped, and when more than `max_queued_kevents` wait, the oldest
/// messages are dropped undecoded: both are counted, never the newest.
///
/// Owns the epoch: time going backwards, a gap of `reset_after_gap_s` or the service ~reset begin a new one, which
/// every surface carries to the other modules. What passes while ~pause holds is no gap.
class TimeSurfaceNode {
 public:
  /// Throws std::invalid_argument naming the parameter or yaml key that is wrong, before anything is subscribed.
  TimeSurfaceNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~TimeSurfaceNode();

 private:
  struct Batch {
    std::vector<Event> events;  // ordered, not empty
    std::size_t next = 0;       // first event that is not inserted yet
    std::size_t queued_as = 0;  // events, in queued_events_
    bool after_loss = false;    // of messages before it
    bool after_pause = false;
    std::string begins_epoch;  // why; empty: it does not
    ros::WallTime arrival;
  };

  // Callbacks.
  void OnEvents(EventMessage message);
  void OnRig(const ResolvedRig& rig);
  void OnOptions(const OdometryOptions& options);
  bool OnReset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool OnPause(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response);
  void FillStatus(diagnostic_updater::DiagnosticStatusWrapper& status);

  // On the worker's thread.
  void OnPose(const boost::shared_ptr<const PoseEstimate>& estimate);
  bool Step();
  /// The epoch and the tick that the batch's next event belongs to.
  void PrepareFor(Batch* batch);
  /// With no events to insert: renders a surface that waits for none, else does ahead what the next one will need.
  bool UseTheWait();
  void TakeRequests();
  void TakeMessages();
  std::optional<EventMessage> NextMessage();  ///< none, too, while enough are decoded
  void Accept(Batch batch);
  /// So many are in it as it turns out: its place in the queue.
  void CountAs(std::size_t events, Batch* batch);
  void Finish(Batch batch);  ///< has its place in the queue back
  void DropBatches();
  void CountDropped(std::size_t events);
  /// To the system, what queues took that are empty now: the allocator would keep it.
  void ReturnMemory();
  void BeginEpoch(const std::string& why);
  std::int64_t TickAfter(std::int64_t t_ns) const;
  void SkipTo(std::int64_t tick_ns);  ///< counts the surfaces in between
  bool SkipWhenBehind();
  std::optional<ExpectedMotion> AwaitMotion();  ///< empty where nothing is known of it
  void RenderTick();
  void PublishImage(const Surface& surface);

  ros::NodeHandle nh_, private_nh_;
  RigConfig config_;
  double max_backlog_s_, reset_after_gap_s_;
  std::size_t max_queued_events_;
  std::int64_t period_ns_;

  // Shared between callbacks and worker.
  std::mutex mutex_;
  std::deque<EventMessage> messages_;
  std::size_t queued_events_ = 0;  // in messages_ and batches_
  std::uint64_t dropped_events_ = 0;
  boost::shared_ptr<const SceneDepth> scene_depth_;
  std::unique_ptr<SurfaceBuilder> new_builder_;                       // from the rig, until the worker takes it
  std::deque<std::pair<std::int64_t, ros::WallTime>> awaiting_pose_;  // surface time, arrival of its last events
  Quantiles latency_ms_, render_ms_;
  SurfaceCounters counters_;
  std::uint64_t epoch_ = 0, surfaces_ = 0, skipped_ = 0;
  std::uint64_t poses_of_epoch_ = 0;
  RateMeter surface_rate_;
  double event_rate_hz_ = 0;
  std::string event_frame_;       // set once, before the worker gets its builder
  std::string reset_because_;     // empty: no reset is asked for
  bool options_changed_ = false;  // in config_.odometry, until the worker's builder has them
  Failures failures_;
  std::atomic<bool> paused_{false};
  bool pause_ended_ = false;  // since the last message that was taken

  // The worker's own.
  std::unique_ptr<SurfaceBuilder> builder_;
  EventPacketConverter packets_;
  std::deque<Batch> batches_;
  std::size_t decoded_events_ = 0;  // in batches_
  std::vector<Event> spare_;        // memory for the next batch
  boost::shared_ptr<const PoseEstimate> last_pose_;
  std::int64_t newest_event_ns_ = 0;
  bool resumed_ = false;              // the next events follow on a pause
  bool lost_ = false;                 // before them some were dropped
  std::int64_t inserted_ns_ = 0;      // time of the last inserted event
  std::int64_t next_tick_ns_ = 0;     // 0: not set
  std::int64_t last_surface_ns_ = 0;  // 0: none in this epoch
  bool burst_ = false;                // many events waited since memory was returned
  int unanswered_ = 0;                // surfaces in a row that tracking did not answer in time
  ros::WallTime last_arrival_;

  Health health_;
  std::shared_ptr<Input> input_;
  std::unique_ptr<RigResolver> rig_;
  image_transport::ImageTransport image_transport_;
  image_transport::Publisher image_publisher_;
  ros::Publisher surface_publisher_;
  ros::Subscriber pose_subscriber_, scene_depth_subscriber_;
  std::unique_ptr<Tunables> tunables_;
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<EventSource> events_;
  std::unique_ptr<Worker> worker_;  // last: joined before anything that it uses goes
};

}  // namespace devo
