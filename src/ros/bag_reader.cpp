// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/bag_reader.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <std_msgs/Header.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/deserialise.h"

namespace devo {
namespace {

// Messages of one topic may have been recorded in another order than they were made, by some places.
constexpr std::size_t kLookAhead = 4;

template <typename Message>
std::string Md5() {
  return ros::message_traits::MD5Sum<Message>::value();
}

StampedPose PoseFrom(const std::string& md5, const ByteSpan& bytes) {
  if (md5 == Md5<geometry_msgs::PoseStamped>()) {
    const auto m = Deserialise<geometry_msgs::PoseStamped>(bytes);
    return {FromRosTime(m.header.stamp), FromPoseMsg(m.pose)};
  }
  if (md5 == Md5<nav_msgs::Odometry>()) {
    const auto m = Deserialise<nav_msgs::Odometry>(bytes);
    return {FromRosTime(m.header.stamp), FromPoseMsg(m.pose.pose)};
  }
  const auto m = Deserialise<geometry_msgs::TransformStamped>(bytes);
  return {FromRosTime(m.header.stamp), FromTransformMsg(m.transform)};
}

/// As the nodelets do, where one event lies far from the others; the order within a message is left as it is.
std::size_t DropStray(std::vector<Event>* events) {
  const auto ends = std::minmax_element(events->begin(), events->end(), IsEarlier);
  if (events->empty() || SecondsFromNs(ends.second->t_ns - ends.first->t_ns) <= kRecordingGap_s) return 0;
  std::stable_sort(events->begin(), events->end(), IsEarlier);
  return DropStrayEvents(kRecordingGap_s, events);
}

}  // namespace

/// One topic, out of bags that follow each other.
struct BagReader::Stream {
  struct Ahead {
    std::int64_t t_ns;
    BagItem item;
  };

  Role role = Role::kEvents;
  std::string topic;
  std::string error;  // of the first message that cannot be used
  std::vector<BagMessage> messages;
  std::size_t next = 0;
  std::deque<Ahead> ahead;   // ordered by time
  std::int64_t lead_ns = 0;  // they are given this much before their time
  EventPacketConverter packets;

  std::int64_t due_ns() const { return ahead.front().t_ns - lead_ns; }
};

BagReader::~BagReader() = default;

BagReader::BagReader(const std::vector<std::string>& paths, const RigConfig& config, const BagRange& range)
    : config_(config), bags_(OpenBags(paths)) {
  if (paths.empty()) throw std::runtime_error("no bag is given, expected at least one");
  TakeInfoBeside(config.topics.events, &config_.topics.event_camera_info);
  TakeInfoBeside(config.topics.depth, &config_.topics.depth_camera_info);
  const Topics& topics = config_.topics;
  const bool lidar = config_.depth_from_lidar();
  const std::string depth_topic = lidar ? "" : topics.depth;
  AddStreams(Role::kDepth, "topics.depth", depth_topic, !lidar, {Md5<sensor_msgs::Image>()}, "sensor_msgs/Image");
  AddStreams(Role::kPoints, "topics.points", topics.points, lidar, {Md5<sensor_msgs::PointCloud2>()},
             "sensor_msgs/PointCloud2");
  AddStreams(Role::kImu, "topics.imu", topics.imu, false, {Md5<sensor_msgs::Imu>()}, "sensor_msgs/Imu");
  AddStreams(Role::kGroundTruth, "topics.ground_truth", topics.ground_truth, false,
             {Md5<geometry_msgs::PoseStamped>(), Md5<nav_msgs::Odometry>(), Md5<geometry_msgs::TransformStamped>()},
             "geometry_msgs/PoseStamped, nav_msgs/Odometry or geometry_msgs/TransformStamped");
  AddStreams(Role::kEvents, "topics.events", topics.events, true, {Md5<EventArray>(), Md5<EventPacket>()}, kEventTypes);
  FindBegin(range);
}

void BagReader::TakeInfoBeside(const std::string& topic, std::string* info_topic) const {
  if (!info_topic->empty()) return;
  const std::string beside = SiblingCameraInfo(topic);
  for (const auto& bag : bags_) {
    for (const BagTopic& candidate : bag->topics()) {
      if (candidate.name == beside && candidate.md5 == Md5<sensor_msgs::CameraInfo>()) *info_topic = beside;
    }
  }
}

void BagReader::AddStreams(Role role, const std::string& key, const std::string& topic, bool required,
                           const std::vector<std::string>& md5s, const std::string& types) {
  if (!HasTopic(key, topic, required, md5s, types)) return;
  std::vector<BagRun> runs = RunsOf(bags_, topic);
  if (role == Role::kEvents && runs.size() > 1) {
    throw std::runtime_error(ComplaintOfOverlap(topic, runs[0], runs[1]) + "; all in both would count twice");
  }
  for (BagRun& run : runs) {
    auto stream = std::make_unique<Stream>();
    stream->role = role;
    stream->topic = topic;
    // Live, a sample comes at its time, whatever its clock says. By how much that is late is estimated.
    if (role == Role::kImu) stream->lead_ns = NsFromSeconds(config_.odometry.tracking.max_delay_s);
    stream->messages = std::move(run.messages);
    streams_.push_back(std::move(stream));
  }
}

void BagReader::FindBegin(const BagRange& range) {
  std::int64_t first_ns = std::numeric_limits<std::int64_t>::max();
  for (const auto& stream : streams_) {
    if (stream->role != Role::kEvents) continue;
    FillAhead(stream.get());
    DropStrayBeginning(stream.get());
    if (!stream->ahead.empty()) first_ns = std::min(first_ns, stream->ahead.front().t_ns);
  }
  if (first_ns == std::numeric_limits<std::int64_t>::max()) {
    throw std::runtime_error("topic '" + config_.topics.events +
                             "' (key 'topics.events') holds no events, expected at least one");
  }
  begin_ns_ = first_ns + NsFromSeconds(range.start_s);
  if (range.duration_s < 1e9) end_ns_ = begin_ns_ + NsFromSeconds(range.duration_s);
  // Depth from before the first event is welcome unless the caller cut it off.
  const bool cut = range.start_s > 0;
  if (!cut) begin_ns_ = first_ns;
  last_ns_.fill(cut ? begin_ns_ - 1 : std::numeric_limits<std::int64_t>::min());
}

std::string BagReader::TopicsInBags() const {
  std::set<std::string> names;
  for (const auto& bag : bags_) {
    for (const BagTopic& topic : bag->topics()) names.insert(topic.name + " (" + topic.type + ")");
  }
  if (names.empty()) return "the bags hold no messages";
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return "the bags hold: " + list;
}

bool BagReader::HasTopic(const std::string& key, const std::string& topic, bool required,
                         const std::vector<std::string>& md5s, const std::string& types) {
  if (topic.empty()) {
    if (required) throw std::runtime_error("key '" + key + "' is empty, expected a topic; " + TopicsInBags());
    return false;
  }
  bool found = false;
  for (const auto& bag : bags_) {
    for (const BagTopic& candidate : bag->topics()) {
      if (candidate.name != topic) continue;
      if (std::find(md5s.begin(), md5s.end(), candidate.md5) == md5s.end()) {
        throw std::runtime_error("topic '" + topic + "' (key '" + key + "') has type " + candidate.type + " (md5 " +
                                 candidate.md5 + "), expected " + types);
      }
      found = true;
    }
  }
  if (!found && required) {
    throw std::runtime_error("topic '" + topic + "' (key '" + key + "') is in none of the bags, expected " + types +
                             "; " + TopicsInBags());
  }
  if (!found) {
    missing_optional_.push_back("topic '" + topic + "' (key '" + key +
                                "') is in none of the bags: the run goes on without it");
  }
  return found;
}

template <typename Message>
std::optional<Message> BagReader::FirstMessage(const std::string& topic) {
  for (const auto& bag : bags_) {
    for (const BagEntry& entry : bag->entries()) {
      if (bag->topics()[entry.topic].name != topic) continue;
      const ByteSpan bytes = bag->Read(entry);
      if (bytes.data != nullptr) return Deserialise<Message>(bytes);
    }
  }
  return std::nullopt;
}

Camera BagReader::CameraFor(const std::string& key, const std::optional<Camera>& configured,
                            const std::string& info_topic) {
  if (configured) return *configured;
  const std::string info_key = "topics." + key + "_info";
  if (info_topic.empty()) {
    throw std::runtime_error("no CameraInfo: neither key '" + key + "' nor key '" + info_key +
                             "' is given, expected one");
  }
  HasTopic(info_key, info_topic, true, {Md5<sensor_msgs::CameraInfo>()}, "sensor_msgs/CameraInfo or key '" + key + "'");
  const auto info = FirstMessage<sensor_msgs::CameraInfo>(info_topic);
  if (!info) {
    throw std::runtime_error("topic '" + info_topic + "' (key '" + info_key +
                             "') has no readable message, expected a CameraInfo");
  }
  try {
    return ToCamera(*info);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument("topic '" + info_topic + "' (key '" + info_key + "'): " + e.what() + "; or give key '" +
                                key + "'");
  }
}

std::string BagReader::FrameFor(const std::string& configured, const std::string& info_topic,
                                const std::string& data_topic) {
  if (!configured.empty()) return WithoutLeadingSlash(configured);
  for (const std::string& topic : {info_topic, data_topic}) {
    const auto header = topic.empty() ? std::nullopt : FirstMessage<std_msgs::Header>(topic);
    if (header && !header->frame_id.empty()) return WithoutLeadingSlash(header->frame_id);
  }
  return "";
}

const tf2::BufferCore& BagReader::Transforms() {
  if (transforms_) return *transforms_;
  transforms_ = std::make_unique<tf2::BufferCore>();
  for (const auto& bag : bags_) {
    for (const BagEntry& entry : bag->entries()) {
      const BagTopic& topic = bag->topics()[entry.topic];
      if (WithoutLeadingSlash(topic.name) != "tf_static" || topic.md5 != Md5<tf2_msgs::TFMessage>()) continue;
      const ByteSpan bytes = bag->Read(entry);
      if (bytes.data == nullptr) continue;
      for (auto transform : Deserialise<tf2_msgs::TFMessage>(bytes).transforms) {
        transform.header.frame_id = WithoutLeadingSlash(transform.header.frame_id);
        transform.child_frame_id = WithoutLeadingSlash(transform.child_frame_id);
        transforms_->setTransform(transform, bag->path(), true);
      }
    }
  }
  return *transforms_;
}

ImuSample BagReader::ImuInEventFrame(const sensor_msgs::Imu& message) {
  if (!imu_surroundings_) {
    imu_surroundings_ = ImuSurroundings{config_.T_event_imu, EventFrame(), config_.T_event_apart_depth(), DepthFrame()};
  }
  return ToImuSample(message, PoseOfImu(message.header.frame_id, *imu_surroundings_, Transforms()),
                     NsFromSeconds(config_.imu_time_offset_s));
}

std::string BagReader::EventFrame() {
  return FrameFor(config_.frames.event, config_.topics.event_camera_info, config_.topics.events);
}

std::string BagReader::DepthFrame() {
  const Topics& topics = config_.topics;
  return config_.depth_from_lidar() ? FrameFor(config_.frames.depth, "", topics.points)
                                    : FrameFor(config_.frames.depth, topics.depth_camera_info, topics.depth);
}

Rigid3 BagReader::DepthToEvent() {
  if (config_.T_event_depth) return *config_.T_event_depth;
  const bool lidar = config_.depth_from_lidar();
  const std::string hint =
      std::string("; expected key 'T_event_depth'") +
      (lidar ? " (the LiDAR's pose) or '/tf_static' in a bag" : ", '/tf_static' in a bag, or 'registered: true'");
  const std::string event = EventFrame(), depth = DepthFrame();
  if (event.empty() || depth.empty()) {
    throw std::runtime_error(std::string("no extrinsics: the ") +
                             (event.empty() ? "event camera"
                              : lidar       ? "LiDAR"
                                            : "depth camera") +
                             "'s messages name no frame_id (key 'frames." + (event.empty() ? "event" : "depth") + "')" +
                             hint);
  }
  try {
    return FromTransformMsg(Transforms().lookupTransform(event, depth, ros::Time(0)).transform);
  } catch (const tf2::TransformException& e) {
    throw std::runtime_error("no extrinsics from frame '" + depth + "' to frame '" + event + "': " + e.what() + hint);
  }
}

Rig BagReader::ReadRig() {
  Rig rig;
  rig.event_camera = CameraFor("event_camera", config_.event_camera, config_.topics.event_camera_info);
  rig.depth_from_lidar = config_.depth_from_lidar();
  rig.depth_registered = !config_.depth_apart();
  if (rig.depth_from_lidar) {
    rig.T_event_depth = DepthToEvent();
    return rig;
  }
  if (rig.depth_registered) {
    rig.depth_camera = rig.event_camera;
    return rig;
  }
  rig.depth_camera = CameraFor("depth_camera", config_.depth_camera, config_.topics.depth_camera_info);
  rig.T_event_depth = DepthToEvent();
  return rig;
}

bool BagReader::Decode(Stream* stream, const BagMessage& message) {
  const ByteSpan bytes = message.bag->Read(message.entry);
  if (bytes.data == nullptr) return false;
  Stream::Ahead ahead{0, EventSlice()};
  if (stream->role == Role::kEvents) {
    auto events = std::make_shared<std::vector<Event>>();
    if (message.topic().md5 == Md5<EventPacket>()) {
      stream->packets.Append(Deserialise<EventPacket>(bytes), events.get());
    } else {
      AppendSerializedEvents(bytes.data, bytes.size, events.get());
    }
    left_out_.events_stray += DropStray(events.get());
    if (events->empty()) return false;
    ahead.t_ns = events->front().t_ns;
    EventSlice slice;
    slice.events = EventSpan(*events);
    slice.owner = std::move(events);
    ahead.item = std::move(slice);
  } else if (stream->role == Role::kDepth) {
    DepthImage depth = ToDepthImage(Deserialise<sensor_msgs::Image>(bytes), config_.depth_scale,
                                    NsFromSeconds(config_.depth_time_offset_s));
    ahead.t_ns = depth.t_ns;
    ahead.item = std::move(depth);
  } else if (stream->role == Role::kPoints) {
    LidarSweep sweep = ToLidarSweep(Deserialise<sensor_msgs::PointCloud2>(bytes), config_.points_turn_s,
                                    NsFromSeconds(config_.depth_time_offset_s));
    ahead.t_ns = sweep.end_ns;
    ahead.item = std::move(sweep);
  } else if (stream->role == Role::kImu) {
    const ImuSample sample = ImuInEventFrame(Deserialise<sensor_msgs::Imu>(bytes));
    if (!IsReading(sample)) {
      ++left_out_.imu_no_reading;
      return false;
    }
    ahead.t_ns = sample.t_ns;
    ahead.item = sample;
  } else {
    GroundTruthPose pose;
    try {
      pose.pose = PoseFrom(message.topic().md5, bytes);
    } catch (const std::invalid_argument&) {  // motion capture that has lost its body; nothing but figures needs it
      ++left_out_.ground_truth_invalid;
      return false;
    }
    ahead.t_ns = pose.pose.t_ns;
    ahead.item = pose;
  }
  const auto place = std::upper_bound(stream->ahead.begin(), stream->ahead.end(), ahead.t_ns,
                                      [](std::int64_t t, const Stream::Ahead& other) { return t < other.t_ns; });
  stream->ahead.insert(place, std::move(ahead));
  return true;
}

void BagReader::FillAhead(Stream* stream) {
  while (stream->ahead.size() < kLookAhead && stream->next < stream->messages.size() && stream->error.empty()) {
    const BagMessage& message = stream->messages[stream->next++];
    try {
      Decode(stream, message);
    } catch (const std::exception& e) {  // a stream overrun of roscpp says nothing about where
      stream->error = "bag '" + message.bag->path() + "', topic '" + stream->topic + "': " + e.what();
    }
  }
  // What was looked ahead before the bad message comes out first.
  if (stream->ahead.empty() && !stream->error.empty()) throw std::runtime_error(stream->error);
}

void BagReader::DropStrayBeginning(Stream* stream) {
  std::deque<Stream::Ahead>& ahead = stream->ahead;
  while (ahead.size() > 1 && SecondsFromNs(ahead[1].t_ns - ahead[0].t_ns) > kRecordingGap_s) {
    left_out_.events_stray += std::get<EventSlice>(ahead[0].item).events.size;
    ahead.pop_front();
  }
}

BagItem BagReader::TakeEvents(Stream* stream) {
  std::int64_t limit_ns = end_ns_;
  for (const auto& other : streams_) {
    if (other.get() != stream && !other->ahead.empty()) limit_ns = std::min(limit_ns, other->due_ns());
  }
  Stream::Ahead& front = stream->ahead.front();
  auto& rest = std::get<EventSlice>(front.item);
  EventSlice slice = rest;
  const Event* end = slice.events.end();
  if ((end - 1)->t_ns > limit_ns) {
    end = std::upper_bound(slice.events.begin(), end, limit_ns,
                           [](std::int64_t t, const Event& e) { return t < e.t_ns; });
    end = std::max(end, slice.events.begin() + 1);  // unordered events must not stop the stream
  }
  slice.events.size = static_cast<std::size_t>(end - slice.events.begin());
  if (end == rest.events.end()) {
    stream->ahead.pop_front();
    FillAhead(stream);
  } else {
    rest.events = EventSpan(end, rest.events.size - slice.events.size);
    front.t_ns = rest.events.data->t_ns;
  }
  return slice;
}

void BagReader::CountUnordered(Role role) {
  if (role == Role::kDepth || role == Role::kPoints) ++left_out_.depth_unordered;
  if (role == Role::kImu) ++left_out_.imu_unordered;
}

std::optional<BagItem> BagReader::Next() {
  for (;;) {
    Stream* first = nullptr;
    for (const auto& stream : streams_) {
      FillAhead(stream.get());
      if (stream->ahead.empty()) continue;
      if (first == nullptr || stream->due_ns() < first->due_ns()) first = stream.get();
    }
    if (first == nullptr || first->due_ns() >= end_ns_) return std::nullopt;
    const std::int64_t t_ns = first->ahead.front().t_ns;
    if (first->role == Role::kEvents) {
      BagItem item = TakeEvents(first);
      auto& slice = std::get<EventSlice>(item);
      if (slice.events.end()[-1].t_ns < begin_ns_) continue;
      return item;
    }
    BagItem item = std::move(first->ahead.front().item);
    first->ahead.pop_front();
    std::int64_t& last_ns = last_ns_[static_cast<std::size_t>(first->role)];
    if (t_ns <= last_ns) {
      if (t_ns >= begin_ns_) CountUnordered(first->role);
      continue;
    }
    last_ns = t_ns;
    return item;
  }
}

double BagReader::progress() const {
  std::size_t done = 0, all = 0;
  for (const auto& stream : streams_) {
    if (stream->role != Role::kEvents) continue;
    done += stream->next;
    all += stream->messages.size();
  }
  return all > 0 ? static_cast<double>(done) / static_cast<double>(all) : 1.0;
}

std::vector<std::string> BagReader::Defects() const {
  std::vector<std::string> defects;
  for (const auto& bag : bags_) {
    if (!bag->defect().empty()) defects.push_back(bag->defect());
  }
  return defects;
}

}  // namespace devo
