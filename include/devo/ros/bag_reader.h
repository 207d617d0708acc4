// SPDX-License-Identifier: BSD-3-Clause
//
// The recordings of one rig, from any number of bags, as one stream in the order of data time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <tf2/buffer_core.h>

#include "devo/core/odometry.h"
#include "devo/core/rig.h"
#include "devo/io/rig_config.h"
#include "devo/io/trajectory.h"
#include "devo/ros/bag_file.h"
#include "devo/ros/bag_runs.h"
#include "devo/ros/message_conversion.h"

namespace devo {

/// Consecutive events of one message. Shares the message's events, so that it may outlive the reader's next step.
struct EventSlice {
  std::shared_ptr<const std::vector<Event>> owner;
  EventSpan events;
};

/// The pose that a ground-truth topic holds.
struct GroundTruthPose {
  StampedPose pose;
};

using BagItem = std::variant<EventSlice, DepthImage, LidarSweep, ImuSample, GroundTruthPose>;

/// Seconds from the beginning of the events.
struct BagRange {
  double start_s = 0;
  double duration_s = std::numeric_limits<double>::infinity();
};

/// How many messages the reader left out, and why.
struct LeftOut {
  std::uint64_t events_stray =
      0;  ///< far in time from the others of their message, or, at the beginning, from the next one
  std::uint64_t depth_unordered = 0;  ///< images and sweeps that were not later than the one before
  std::uint64_t imu_unordered = 0;
  std::uint64_t imu_no_reading = 0;        ///< IsReading() says no
  std::uint64_t ground_truth_invalid = 0;  ///< no number, or no quaternion of length 1
};

class BagReader {
 public:
  /// Opens the bags and finds the topics of `config`. Throws std::runtime_error naming the bag that cannot be opened,
  /// the topic that is in none of them (and those that are), or the topic whose type is of no use (and those that are),
  /// or the bags that hold events of the same time.
  BagReader(const std::vector<std::string>& paths, const RigConfig& config, const BagRange& range = {});
  ~BagReader();

  /// Cameras and transformation: the configuration's where it gives them, else the bags' CameraInfo and tf_static.
  /// Throws std::runtime_error or std::invalid_argument naming what is missing and where it was looked for.
  Rig ReadRig();

  /// The next item, in the order of data time: events by their own stamps (an array is cut where other data lies
  /// between its events; header.stamp means something else in each driver), sweeps of a LiDAR by the time of their last
  /// point, the rest by header.stamp, depth and sweeps with config.depth_time_offset_s added. But an IMU's samples come
  /// ahead by tracking.max_delay_s, as its clock may be late and live they would be there all the same. Each topic is a
  /// stream of its own, of which a few messages are looked ahead, so that neither the order nor the clock of recording
  /// matters. Empty at the end. Throws std::runtime_error naming the topic of a message that cannot be used (wrong
  /// encoding; an IMU whose frame no tf_static connects with the event frame). IMU samples are turned into the event
  /// frame.
  std::optional<BagItem> Next();

  std::int64_t begin_ns() const { return begin_ns_; }  ///< first event's time plus start
  std::int64_t end_ns() const { return end_ns_; }      ///< largest int64 when the duration is not limited
  double progress() const;                             ///< share of the event messages read, 0..1

  /// What is wrong with the bags: one sentence each. Grows while reading.
  std::vector<std::string> Defects() const;

  /// Topics of the configuration that a run can do without and that are in none of the bags: one sentence each.
  const std::vector<std::string>& MissingOptional() const { return missing_optional_; }

  /// Grows while reading.
  const LeftOut& left_out() const { return left_out_; }

 private:
  enum class Role { kDepth, kPoints, kImu, kGroundTruth, kEvents };
  static constexpr std::size_t kRoles = 5;
  struct Stream;

  /// Where the configuration names none: as the nodelets do.
  void TakeInfoBeside(const std::string& topic, std::string* info_topic) const;
  void AddStreams(Role role, const std::string& key, const std::string& topic, bool required,
                  const std::vector<std::string>& md5s, const std::string& types);
  void FindBegin(const BagRange& range);
  /// Throws where it has another type, or is required and in none of the bags.
  bool HasTopic(const std::string& key, const std::string& topic, bool required, const std::vector<std::string>& md5s,
                const std::string& types);
  void CountUnordered(Role role);
  template <typename Message>
  std::optional<Message> FirstMessage(const std::string& topic);
  std::string TopicsInBags() const;
  Camera CameraFor(const std::string& key, const std::optional<Camera>& configured, const std::string& info_topic);
  std::string FrameFor(const std::string& configured, const std::string& info_topic, const std::string& data_topic);
  Rigid3 DepthToEvent();
  const tf2::BufferCore& Transforms();
  std::string EventFrame();
  std::string DepthFrame();  // the LiDAR's, where it measures depth
  ImuSample ImuInEventFrame(const sensor_msgs::Imu& message);
  void FillAhead(Stream* stream);
  bool Decode(Stream* stream, const BagMessage& message);
  /// Leaves out the first arrays of events where a long gap lies before the next: most often their stamps are 0.
  void DropStrayBeginning(Stream* stream);
  BagItem TakeEvents(Stream* stream);

  RigConfig config_;
  std::vector<std::unique_ptr<BagFile>> bags_;
  std::unique_ptr<tf2::BufferCore> transforms_;      // tf_static of all bags, once asked for
  std::optional<ImuSurroundings> imu_surroundings_;  // once asked for
  std::vector<std::unique_ptr<Stream>> streams_;
  std::array<std::int64_t, kRoles> last_ns_{};  // data time of the last item of each role
  std::int64_t begin_ns_ = 0, end_ns_ = std::numeric_limits<std::int64_t>::max();
  LeftOut left_out_;
  std::vector<std::string> missing_optional_;
};

}  // namespace devo
