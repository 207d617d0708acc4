// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/message_conversion.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include <sensor_msgs/image_encodings.h>
#include <boost/endian/conversion.hpp>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"

namespace devo {
namespace {

constexpr std::size_t kBytesPerEvent = 13;  // x, y, sec, nsec, polarity, without padding
constexpr std::int64_t kNsPerSecond = 1000000000;

template <typename T>
T LittleEndian(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return boost::endian::little_to_native(value);
}

/// Reads the fields of a serialised message in turn.
class Cursor {
 public:
  Cursor(const std::uint8_t* bytes, std::size_t size) : bytes_(bytes), left_(size) {}

  const std::uint8_t* Take(std::size_t size) {
    if (size > left_)
      throw std::runtime_error("event array: its bytes end early, expected " + std::to_string(size - left_) + " more");
    const std::uint8_t* taken = bytes_;
    bytes_ += size;
    left_ -= size;
    return taken;
  }
  std::uint32_t TakeUint32() { return LittleEndian<std::uint32_t>(Take(4)); }

 private:
  const std::uint8_t* bytes_;
  std::size_t left_;
};

float ValidOrZero(float metres) { return std::isfinite(metres) && metres > 0 ? metres : 0.0F; }

float MetresFromMillimetres(std::uint16_t millimetres, float scale) {
  return static_cast<float>(millimetres) * 1e-3F * scale;
}

std::uint16_t Swapped(std::uint16_t value) { return boost::endian::endian_reverse(value); }
float Swapped(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, 4);
  bits = boost::endian::endian_reverse(bits);
  std::memcpy(&value, &bits, 4);
  return value;
}

template <typename Reading, typename ToMetres>
void FillDepth(const sensor_msgs::Image& message, ToMetres&& to_metres, cv::Mat1f* depth_m) {
  const bool swap = (message.is_bigendian != 0) != (boost::endian::order::native == boost::endian::order::big);
  std::vector<Reading> row(message.width);
  for (std::uint32_t y = 0; y < message.height; ++y) {
    std::memcpy(row.data(), message.data.data() + std::size_t{y} * message.step, sizeof(Reading) * message.width);
    float* out = depth_m->ptr<float>(static_cast<int>(y));
    for (std::uint32_t x = 0; x < message.width; ++x) out[x] = to_metres(swap ? Swapped(row[x]) : row[x]);
  }
}

void CheckSize(const sensor_msgs::Image& message, std::size_t bytes_per_pixel) {
  if (message.width == 0 || message.height == 0) throw std::runtime_error("depth image is empty, expected pixels");
  const std::size_t row = bytes_per_pixel * message.width;
  if (message.step < row || message.data.size() < std::size_t{message.step} * (message.height - 1) + row) {
    throw std::runtime_error("depth image " + std::to_string(message.width) + "x" + std::to_string(message.height) +
                             " " + message.encoding + " has step " + std::to_string(message.step) + " and " +
                             std::to_string(message.data.size()) + " bytes, expected rows of at least " +
                             std::to_string(row) + " bytes");
  }
}

}  // namespace

std::size_t DropStrayEvents(double most_gap_s, std::vector<Event>* events) {
  const std::int64_t most_gap_ns = NsFromSeconds(most_gap_s);
  if (events->empty() || events->back().t_ns - events->front().t_ns <= most_gap_ns) return 0;
  const auto wide = [most_gap_ns](const Event& a, const Event& b) { return b.t_ns - a.t_ns > most_gap_ns; };
  auto best_begin = events->begin(), best_end = events->begin();
  for (auto begin = events->begin(); begin != events->end();) {
    auto end = std::adjacent_find(begin, events->end(), wide);
    if (end != events->end()) ++end;
    if (end - begin > best_end - best_begin) {
      best_begin = begin;
      best_end = end;
    }
    begin = end;
  }
  const auto dropped = static_cast<std::size_t>(events->end() - events->begin() - (best_end - best_begin));
  events->erase(best_end, events->end());
  events->erase(events->begin(), best_begin);
  return dropped;
}

std::string AppendSerializedEvents(const std::uint8_t* bytes, std::size_t size, std::vector<Event>* events) {
  Cursor cursor(bytes, size);
  cursor.Take(12);  // header.seq, header.stamp
  const std::uint32_t name_size = cursor.TakeUint32();
  const auto* name = reinterpret_cast<const char*>(cursor.Take(name_size));
  cursor.Take(8);  // height, width
  const std::size_t count = cursor.TakeUint32();
  const std::uint8_t* raw = cursor.Take(count * kBytesPerEvent);
  events->reserve(events->size() + count);
  // Room is made for some at a time: made for all at once, it would have left the nearest cache when it is written.
  constexpr std::size_t kAtOnce = 512;
  for (std::size_t done = 0; done < count; done += kAtOnce) {
    const std::size_t begin = events->size();
    events->resize(begin + std::min(kAtOnce, count - done));
    for (std::size_t i = begin; i < events->size(); ++i, raw += kBytesPerEvent) {
      Event& event = (*events)[i];
      event.x = LittleEndian<std::uint16_t>(raw);
      event.y = LittleEndian<std::uint16_t>(raw + 2);
      event.t_ns = kNsPerSecond * LittleEndian<std::uint32_t>(raw + 4) + LittleEndian<std::uint32_t>(raw + 8);
      event.polarity = raw[12] != 0 ? 1 : 0;
    }
  }
  return {name, name_size};
}

EventArray ToEventArrayMsg(EventSpan events, int width, int height, const std::string& frame_id) {
  EventArray message;
  message.header.frame_id = frame_id;
  if (!events.empty()) message.header.stamp = ToRosTime(events.data[events.size - 1].t_ns);
  message.width = static_cast<std::uint32_t>(width);
  message.height = static_cast<std::uint32_t>(height);
  message.events.resize(events.size);
  for (std::size_t i = 0; i < events.size; ++i) {
    RawEvent& raw = message.events[i];
    raw.x = events.data[i].x;
    raw.y = events.data[i].y;
    raw.ts = ToRosTime(events.data[i].t_ns);
    raw.polarity = events.data[i].polarity;
  }
  return message;
}

void EventPacketConverter::Append(const View& packet, std::vector<Event>* events) {
  if (packet.is_bigendian) throw std::runtime_error("event packet is big-endian, expected little-endian words");
  const bool restarted = decoder_ && (decoder_->encoding() != packet.encoding || packet.seq < last_seq_);
  if (!decoder_ || restarted) {
    decoder_.emplace(packet.encoding);
    offset_ns_.reset();
  } else if (packet.seq > last_seq_ + 1) {
    decoder_->NoteLoss();
    after_loss_ = true;
  }
  last_seq_ = packet.seq;
  const std::size_t begin = events->size();
  decoder_->Decode(packet.bytes, packet.size, events);
  if (events->size() == begin) return;
  const std::int64_t stamp_ns = FromRosTime(packet.stamp), wrap_ns = decoder_->wrap_ns();
  if (!offset_ns_) {
    offset_ns_ = stamp_ns - (*events)[begin].t_ns;
  } else if (after_loss_ || stamp_ns - last_stamp_ns_ > wrap_ns / 4) {
    // The decoder sees one wrap at most, and that only in a gap of less than half the counter's range.
    const auto late_ns = static_cast<double>(stamp_ns - (*events)[begin].t_ns - *offset_ns_);
    *offset_ns_ += wrap_ns * std::llround(late_ns / static_cast<double>(wrap_ns));
  }
  last_stamp_ns_ = stamp_ns;
  after_loss_ = false;
  std::for_each(events->begin() + static_cast<std::ptrdiff_t>(begin), events->end(),
                [&](Event& event) { event.t_ns += *offset_ns_; });
}

DepthImage ToDepthImage(const sensor_msgs::Image& message, double scale, std::int64_t time_offset_ns) {
  namespace encodings = sensor_msgs::image_encodings;
  DepthImage depth;
  depth.t_ns = FromRosTime(message.header.stamp) + time_offset_ns;
  const auto factor = static_cast<float>(scale);
  if (message.encoding == encodings::TYPE_16UC1) {
    CheckSize(message, 2);
    depth.depth_m.create(static_cast<int>(message.height), static_cast<int>(message.width));
    FillDepth<std::uint16_t>(
        message, [&](std::uint16_t v) { return MetresFromMillimetres(v, factor); }, &depth.depth_m);
  } else if (message.encoding == encodings::TYPE_32FC1) {
    CheckSize(message, 4);
    depth.depth_m.create(static_cast<int>(message.height), static_cast<int>(message.width));
    FillDepth<float>(
        message, [&](float v) { return ValidOrZero(v) * factor; }, &depth.depth_m);
  } else {
    throw std::runtime_error("depth image has encoding '" + message.encoding +
                             "', expected 16UC1 (millimetres) or 32FC1 (metres)");
  }
  return depth;
}

Camera ToCamera(const sensor_msgs::CameraInfo& m) {
  const double bin_x = std::max(1U, m.binning_x), bin_y = std::max(1U, m.binning_y);
  const bool has_roi = m.roi.width > 0 && m.roi.height > 0;
  if (has_roi && m.roi.do_rectify) {
    throw std::invalid_argument(
        "camera_info asks for a rectified region of interest (roi.do_rectify), expected the raw image");
  }
  const std::uint32_t width = has_roi ? m.roi.width : m.width, height = has_roi ? m.roi.height : m.height;
  // REP-104: the region is in full-resolution pixels and binning comes after it. A binned pixel's centre lies half a
  // binned pixel in from its edge, hence the halves.
  const double x0 = has_roi ? m.roi.x_offset : 0, y0 = has_roi ? m.roi.y_offset : 0;
  return {static_cast<int>(width / bin_x),   static_cast<int>(height / bin_y),  m.K[0] / bin_x,     m.K[4] / bin_y,
          (m.K[2] - x0 + 0.5) / bin_x - 0.5, (m.K[5] - y0 + 0.5) / bin_y - 0.5, m.distortion_model, m.D};
}

Rigid3 PoseOfImu(const std::string& imu_frame, const ImuSurroundings& known, const tf2::BufferCore& transforms) {
  if (known.T_event_imu) return *known.T_event_imu;
  const std::string imu = WithoutLeadingSlash(imu_frame), event = WithoutLeadingSlash(known.event_frame);
  if (imu.empty() || imu == event) return Rigid3();
  const std::string depth = known.T_event_depth ? WithoutLeadingSlash(known.depth_frame) : "";
  if (event.empty() && depth.empty()) {
    throw std::runtime_error("their frame is '" + imu + "' and the event camera's frame is not known; expected key " +
                             "'frames.event' or 'T_event_imu', or a CameraInfo with a frame_id");
  }
  std::string reason;
  if (const auto T_event_imu = LookupTransform(transforms, event, imu, &reason)) return *T_event_imu;
  if (const auto T_depth_imu = LookupTransform(transforms, depth, imu, &reason))
    return *known.T_event_depth * *T_depth_imu;
  throw std::runtime_error("no transformation from the IMU's frame '" + imu + "' to the event frame '" + event + "'" +
                           (depth.empty() ? "" : " or the depth's, '" + depth + "'") +
                           "; expected it on /tf_static or as key 'T_event_imu' (" + reason + ")");
}

ImuSample ToImuSample(const sensor_msgs::Imu& message, const Rigid3& T_event_imu, std::int64_t time_offset_ns) {
  ImuSample sample;
  sample.t_ns = FromRosTime(message.header.stamp) + time_offset_ns;
  const auto& w = message.angular_velocity;
  const auto& a = message.linear_acceleration;
  sample.angular_velocity = T_event_imu.rotation() * Eigen::Vector3d(w.x, w.y, w.z);
  sample.linear_acceleration = T_event_imu.rotation() * Eigen::Vector3d(a.x, a.y, a.z);
  // sensor_msgs/Imu: what it does not measure.
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (message.linear_acceleration_covariance[0] == -1) sample.linear_acceleration.setConstant(kNone);
  if (message.angular_velocity_covariance[0] == -1) sample.angular_velocity.setConstant(kNone);
  sample.p_event_imu = T_event_imu.translation();
  return sample;
}

}  // namespace devo
