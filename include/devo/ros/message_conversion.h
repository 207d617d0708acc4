// SPDX-License-Identifier: BSD-3-Clause
//
// Sensor messages to core types, for bags and for live topics.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2/buffer_core.h>
#include <Eigen/Geometry>

#include "devo/EventArray.h"
#include "devo/EventPacket.h"
#include "devo/core/camera.h"
#include "devo/core/depth_image.h"
#include "devo/core/event.h"
#include "devo/core/lidar_sweep.h"
#include "devo/core/odometry.h"
#include "devo/io/evt_decoder.h"

namespace devo {

/// A longer gap between events than this is one between recordings, unless it is said otherwise.
constexpr double kRecordingGap_s = 10;

/// Of events in the order of time, keeps the most that have no gap beyond `most_gap_s` between them; returns how many
/// went. One bit of a message that was transferred wrongly puts an event years away, and what decides by the newest
/// event's time would take it for another recording.
std::size_t DropStrayEvents(double most_gap_s, std::vector<Event>* events);

/// Appends the events of a message, with their own stamps. `Array`: EventArray of this package or another's of the same
/// layout.
template <typename Array>
void AppendEvents(const Array& message, std::vector<Event>* events) {
  const std::size_t begin = events->size();
  events->resize(begin + message.events.size());
  Event* event = events->data() + begin;
  for (const auto& raw : message.events) {
    event->t_ns = static_cast<std::int64_t>(raw.ts.toNSec());
    event->x = raw.x;
    event->y = raw.y;
    event->polarity = raw.polarity != 0 ? 1 : 0;
    ++event;
  }
}

/// The same from a serialised EventArray (of dvs_msgs, prophesee_event_msgs or devo) without making the message: one
/// copy from the bag's bytes to the events. Returns the header's frame_id. Throws std::runtime_error when the bytes are
/// too few.
std::string AppendSerializedEvents(const std::uint8_t* bytes, std::size_t size, std::vector<Event>* events);

/// The other way round; header.stamp is the time of the last event. Bags of the simulator and tests are made of these.
EventArray ToEventArrayMsg(EventSpan events, int width, int height, const std::string& frame_id);

/// For a sentence that says what was expected.
constexpr char kEventTypes[] = "dvs_msgs/EventArray, prophesee_event_msgs/EventArray or event_camera_msgs/EventPacket";

/// Decodes a stream of EventPackets. The sensor's clock is put on the host's by one constant offset, from the first
/// packet with events: its header.stamp (arrival of its first bytes) minus its first event's time. A sensor that is
/// restarted (encoding or size changes, sequence number falls) is put on the host's clock anew. Wraps of the sensor's
/// counter in a gap between packets are known from their stamps; where packets are missing, events before the next
/// complete time and row are skipped.
class EventPacketConverter {
 public:
  /// `Packet`: EventPacket of this package or another's of the same layout. Throws std::runtime_error naming an
  /// encoding that is not evt3 or evt2, or big-endian packets.
  template <typename Packet>
  void Append(const Packet& message, std::vector<Event>* events) {
    Append({message.header.stamp, message.seq, message.encoding, message.is_bigendian != 0, message.events.data(),
            message.events.size()},
           events);
  }

  const EvtDecoder* decoder() const { return decoder_ ? &*decoder_ : nullptr; }

 private:
  struct View {
    ros::Time stamp;
    std::uint64_t seq;
    const std::string& encoding;
    bool is_bigendian;
    const std::uint8_t* bytes;
    std::size_t size;
  };
  void Append(const View& packet, std::vector<Event>* events);

  std::optional<EvtDecoder> decoder_;
  bool after_loss_ = false;  // packets were missing, and no event has come since
  std::optional<std::int64_t> offset_ns_;
  std::uint64_t last_seq_ = 0;
  std::int64_t last_stamp_ns_ = 0;  // of a packet with events
};

/// 16UC1 (millimetres, 0 invalid) or 32FC1 (metres; NaN, infinite and not positive are invalid: REP-117, REP-118), of
/// any row step and endianness; readings are multiplied by `scale`. Throws std::runtime_error naming any other
/// encoding, or a step or data size that does not fit.
DepthImage ToDepthImage(const sensor_msgs::Image& message, double scale = 1, std::int64_t time_offset_ns = 0);

/// A sweep from fields x, y, z (float32); points that are no measurement (not finite, or at the origin) are left out.
/// `ring` or `line` (an integer) tells the beam, else the row of an organised cloud. Times of the points:
///   `time` (float32 or float64): seconds after header.stamp, negative where that is the end (velodyne_pointcloud);
///   `t` (uint32): nanoseconds after header.stamp (ouster_ros);
///   `timestamp` (float64): the time itself in seconds (hesai, robosense) or, when larger than 1e12, nanoseconds
///   (livox);
/// else all are measured at header.stamp, or, where `turn_s` is given, on a turn of that duration that ends at
/// header.stamp, their azimuth telling when: from the first point to the last where they come firing by firing
/// (velodyne_pointcloud before 1.6), along each ring where they come ring by ring (organised, or sorted by ring).
/// Throws std::runtime_error naming the field that is missing or of another type, a cloud that holds less than it
/// says, or big-endian data.
LidarSweep ToLidarSweep(const sensor_msgs::PointCloud2& message, double turn_s = 0, std::int64_t time_offset_ns = 0);

/// The camera of the image that is published: binning and region of interest are applied. Throws std::invalid_argument
/// as Camera does (an uncalibrated camera has K = 0), and for a region of interest that is to be rectified.
Camera ToCamera(const sensor_msgs::CameraInfo& message);

/// What is known of an IMU's place besides tf_static. Frames are empty while they are not known.
struct ImuSurroundings {
  std::optional<Rigid3> T_event_imu;  ///< configured
  std::string event_frame;
  std::optional<Rigid3> T_event_depth;  ///< configured: of the depth camera or LiDAR, which may carry the IMU
  std::string depth_frame;
};

/// How the IMU lies in the event frame: as configured; else the identity where `imu_frame` is empty (the message claims
/// no frame of its own) or is the event frame; else from `transforms`, to the event frame or, with T_event_depth, to
/// the depth's. Throws std::runtime_error naming the frames where nothing connects them.
Rigid3 PoseOfImu(const std::string& imu_frame, const ImuSurroundings& known, const tf2::BufferCore& transforms);

/// Turned into the event frame. The acceleration stays that of the IMU's own place; NaN where the message's covariance
/// says that there is none (-1, sensor_msgs/Imu). `time_offset_ns` is added to the stamp.
ImuSample ToImuSample(const sensor_msgs::Imu& message, const Rigid3& T_event_imu, std::int64_t time_offset_ns = 0);

}  // namespace devo
