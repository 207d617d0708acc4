// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/sim_bag_writer.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>

#include <rosbag/bag.h>
#include <sensor_msgs/image_encodings.h>

#include "devo/EventArray.h"
#include "devo/core/time.h"
#include "devo/io/trajectory.h"
#include "devo/ros/message_conversion.h"
#include "devo/sim/rig_file.h"
#include "sim_bag_helpers.h"

namespace devo {
namespace {

using sim::PlainTopics;

ros::Time Stamp(std::int64_t t_ns) { return SimStamp(t_ns); }

geometry_msgs::TransformStamped ToTransform(std::int64_t t_ns, const Rigid3& T, const char* parent, const char* child) {
  geometry_msgs::TransformStamped m;
  m.header.stamp = Stamp(t_ns);
  m.header.frame_id = parent;
  m.child_frame_id = child;
  m.transform.translation.x = T.translation().x();
  m.transform.translation.y = T.translation().y();
  m.transform.translation.z = T.translation().z();
  m.transform.rotation.x = T.rotation().x();
  m.transform.rotation.y = T.rotation().y();
  m.transform.rotation.z = T.rotation().z();
  m.transform.rotation.w = T.rotation().w();
  return m;
}

class PlainWriter : public SimBagWriter {
 public:
  PlainWriter(const std::string& stem, const sim::Sequence& sequence) : sequence_(sequence), stem_(stem) {
    bag_.Open(stem + ".bag", rosbag::compression::LZ4);
    files_ = {stem + ".bag", stem + ".yaml", stem + "_groundtruth.txt"};
    using Depth = sim::SequenceOptions::Depth;
    const auto& o = sequence.options();
    const std::string comment = "Simulated: scene " + o.scene + ", sensor " + o.sensor + ", " + o.light + " light, " +
                                (o.trajectory_file.empty() ? o.speed + " motion" : "given motion") + ", seed " +
                                std::to_string(o.seed);
    WriteSimText(stem + ".yaml", sim::RigYaml(sequence.rig(), o.depth_time_offset_s, comment));
    if (o.lidar) {
      Rig rig = sequence.rig();
      rig.depth_registered = false;
      rig.depth_from_lidar = true;
      rig.T_event_depth = sequence.lidar_model().T_event_lidar;
      // The only source of depth, or one that can be had instead.
      const std::string path = stem + (o.depth == Depth::kNone ? ".yaml" : "_lidar.yaml");
      WriteSimText(path, sim::RigYaml(rig, 0, comment));
      if (o.depth != Depth::kNone) files_.push_back(path);
    }
    WriteTransforms();
  }

  void Write(const sim::Chunk& chunk) override {
    const Rig& rig = sequence_.rig();
    const std::string depth_frame = rig.depth_registered ? PlainTopics::kEventFrame : PlainTopics::kDepthFrame;
    if (!chunk.events.empty()) {
      bag_.Write(
          PlainTopics::kEvents, Stamp(chunk.events.back().t_ns),
          ToEventArrayMsg(chunk.events, rig.event_camera.width(), rig.event_camera.height(), PlainTopics::kEventFrame));
    }
    for (const auto& depth : chunk.depth) {
      bag_.Write(PlainTopics::kDepth, Stamp(depth.t_ns), ToDepthMsg(depth, "16UC1", depth_frame));
      bag_.Write(PlainTopics::kDepthCameraInfo, Stamp(depth.t_ns),
                 ToCameraInfoMsg(rig.depth_camera, depth.t_ns, depth_frame));
    }
    for (const auto& scan : chunk.scans) {
      bag_.Write(PlainTopics::kPoints, Stamp(scan.t_ns), ToPointCloudMsg(scan, PlainTopics::kLidarFrame));
    }
    for (const auto& frame : chunk.frames) {
      bag_.Write(PlainTopics::kFrames, Stamp(frame.t_ns), ToFrameMsg(frame, PlainTopics::kEventFrame));
    }
    for (const auto& sample : chunk.imu) {
      bag_.Write(PlainTopics::kImu, Stamp(sample.t_ns), ToImuMsg(sample, PlainTopics::kEventFrame));
    }
    for (const auto& pose : chunk.poses) {
      bag_.Write(PlainTopics::kGroundTruth, Stamp(pose.t_ns), ToPoseMsg(pose.t_ns, pose.T_world_event, "world"));
      truth_.push_back({pose.t_ns, pose.T_world_event});
    }
    if (++chunks_ % 10 == 1) {
      bag_.Write(PlainTopics::kEventCameraInfo, Stamp(chunk.end_ns),
                 ToCameraInfoMsg(rig.event_camera, chunk.end_ns, PlainTopics::kEventFrame));
    }
  }

  void Close() override {
    WriteTum(stem_ + "_groundtruth.txt", truth_);
    bag_.Close();  // last: who finds the bag takes the files beside it for complete
  }

 private:
  void WriteTransforms() {
    const tf2_msgs::TFMessage message = StaticTransforms(sequence_);
    if (!message.transforms.empty()) bag_.Write("/tf_static", Stamp(sequence_.begin_ns()), message);
  }

  const sim::Sequence& sequence_;
  std::string stem_;
  SimBag bag_;
  Trajectory truth_;
  int chunks_ = 0;
};

}  // namespace

tf2_msgs::TFMessage StaticTransforms(const sim::Sequence& sequence) {
  const std::int64_t t_ns = sequence.begin_ns();
  tf2_msgs::TFMessage message;
  if (!sequence.rig().depth_registered && sequence.options().depth != sim::SequenceOptions::Depth::kNone) {
    message.transforms.push_back(
        ToTransform(t_ns, sequence.rig().T_event_depth, PlainTopics::kEventFrame, PlainTopics::kDepthFrame));
  }
  if (sequence.options().lidar) {
    message.transforms.push_back(
        ToTransform(t_ns, sequence.lidar_model().T_event_lidar, PlainTopics::kEventFrame, PlainTopics::kLidarFrame));
  }
  return message;
}

ros::Time SimStamp(std::int64_t t_ns) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(t_ns));
  return time;
}

void SimBag::CloseOrLeak::operator()(rosbag::Bag* bag) const noexcept {
  try {
    bag->close();
  } catch (const std::exception&) {
    return;  // leaked: its destructor would close, and throw, again
  }
  delete bag;
}

void SimBag::Open(const std::string& path, rosbag::CompressionType compression) {
  path_ = path;
  bag_.reset(new rosbag::Bag);
  try {
    bag_->open(ActivePath(), rosbag::bagmode::Write);
  } catch (const rosbag::BagException& e) {
    ThrowCannotBeWritten(e.what());
  }
  bag_->setCompression(compression);
  std::remove(path.c_str());  // of another run, which calibration written now may not fit
}

void SimBag::Close() {
  if (!bag_) return;
  rosbag::Bag* bag = bag_.release();  // leaked where it cannot be closed, as in CloseOrLeak
  try {
    bag->close();
  } catch (const rosbag::BagException& e) {
    ThrowCannotBeWritten(e.what());
  }
  delete bag;
  if (std::rename(ActivePath().c_str(), path_.c_str()) != 0) ThrowCannotBeWritten(std::strerror(errno));
}

void SimBag::ThrowCannotBeWritten(const std::string& reason) const {
  throw std::runtime_error("bag '" + ActivePath() + "' cannot be written: " + reason);
}

void WriteSimText(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text << std::flush;
  if (!file) throw std::runtime_error("file '" + path + "' cannot be written");
}

sensor_msgs::CameraInfo ToCameraInfoMsg(const Camera& c, std::int64_t t_ns, const std::string& frame_id) {
  sensor_msgs::CameraInfo m;
  m.header.stamp = Stamp(t_ns);
  m.header.frame_id = frame_id;
  m.width = static_cast<std::uint32_t>(c.width());
  m.height = static_cast<std::uint32_t>(c.height());
  m.distortion_model = c.distortion() == DistortionModel::kNone ? "plumb_bob" : sim::DistortionName(c);
  m.D = c.coefficients();
  if (m.D.empty()) m.D.assign(5, 0.0);
  m.K = {c.fx(), 0, c.cx(), 0, c.fy(), c.cy(), 0, 0, 1};
  m.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  m.P = {c.fx(), 0, c.cx(), 0, 0, c.fy(), c.cy(), 0, 0, 0, 1, 0};
  return m;
}

sensor_msgs::Image ToDepthMsg(const DepthImage& depth, const std::string& encoding, const std::string& frame_id) {
  sensor_msgs::Image m;
  m.header.stamp = Stamp(depth.t_ns);
  m.header.frame_id = frame_id;
  m.encoding = encoding;
  m.width = static_cast<std::uint32_t>(depth.depth_m.cols);
  m.height = static_cast<std::uint32_t>(depth.depth_m.rows);
  const bool millimetres = encoding == sensor_msgs::image_encodings::TYPE_16UC1;
  m.step = m.width * (millimetres ? 2 : 4);
  m.data.resize(static_cast<std::size_t>(m.step) * m.height);
  for (int y = 0; y < depth.depth_m.rows; ++y) {
    for (int x = 0; x < depth.depth_m.cols; ++x) {
      const float z = depth.depth_m(y, x);
      std::uint8_t* to =
          &m.data[static_cast<std::size_t>(y) * m.step + static_cast<std::size_t>(x) * (millimetres ? 2 : 4)];
      if (millimetres) {
        const auto mm = static_cast<std::uint16_t>(std::lround(std::min(65.535F, z) * 1000));
        std::memcpy(to, &mm, 2);
      } else {
        const float value = z > 0 ? z : std::numeric_limits<float>::quiet_NaN();
        std::memcpy(to, &value, 4);
      }
    }
  }
  return m;
}

sensor_msgs::Image ToFrameMsg(const sim::Frame& frame, const std::string& frame_id) {
  sensor_msgs::Image m;
  m.header.stamp = Stamp(frame.t_ns);
  m.header.frame_id = frame_id;
  m.encoding = sensor_msgs::image_encodings::MONO8;
  m.width = m.step = static_cast<std::uint32_t>(frame.image.cols);
  m.height = static_cast<std::uint32_t>(frame.image.rows);
  m.data.assign(frame.image.begin(), frame.image.end());
  return m;
}

sensor_msgs::Imu ToImuMsg(const ImuSample& sample, const std::string& frame_id) {
  sensor_msgs::Imu m;
  m.header.stamp = Stamp(sample.t_ns);
  m.header.frame_id = frame_id;
  m.orientation_covariance[0] = -1;  // no orientation
  m.angular_velocity.x = sample.angular_velocity.x();
  m.angular_velocity.y = sample.angular_velocity.y();
  m.angular_velocity.z = sample.angular_velocity.z();
  m.linear_acceleration.x = sample.linear_acceleration.x();
  m.linear_acceleration.y = sample.linear_acceleration.y();
  m.linear_acceleration.z = sample.linear_acceleration.z();
  return m;
}

geometry_msgs::PoseStamped ToPoseMsg(std::int64_t t_ns, const Rigid3& T, const std::string& frame_id) {
  geometry_msgs::PoseStamped m;
  m.header.stamp = Stamp(t_ns);
  m.header.frame_id = frame_id;
  m.pose.position.x = T.translation().x();
  m.pose.position.y = T.translation().y();
  m.pose.position.z = T.translation().z();
  m.pose.orientation.x = T.rotation().x();
  m.pose.orientation.y = T.rotation().y();
  m.pose.orientation.z = T.rotation().z();
  m.pose.orientation.w = T.rotation().w();
  return m;
}

sensor_msgs::PointCloud2 ToPointCloudMsg(const sim::LidarScan& scan, const std::string& frame_id, PointLayout layout,
                                         double turn_s) {
  using sensor_msgs::PointField;
  sensor_msgs::PointCloud2 m;
  m.header.stamp = Stamp(scan.t_ns + (layout == PointLayout::kVelodyneOld ? NsFromSeconds(turn_s) : 0));
  m.header.frame_id = frame_id;
  const auto field = [&m](const char* name, std::uint32_t offset, std::uint8_t type) {
    PointField f;
    f.name = name;
    f.offset = offset;
    f.datatype = type;
    f.count = 1;
    m.fields.push_back(f);
  };
  field("x", 0, PointField::FLOAT32);
  field("y", 4, PointField::FLOAT32);
  field("z", 8, PointField::FLOAT32);
  field("intensity", 12, PointField::FLOAT32);
  if (layout == PointLayout::kOuster) {
    field("t", 16, PointField::UINT32);
    field("ring", 20, PointField::UINT8);
    m.point_step = 24;
  } else {
    field("ring", 16, PointField::UINT16);
    if (layout == PointLayout::kVelodyne) field("time", 18, PointField::FLOAT32);
    m.point_step = layout == PointLayout::kVelodyne ? 22 : 18;
  }
  m.height = 1;
  m.width = static_cast<std::uint32_t>(scan.points.size());
  m.row_step = m.width * m.point_step;
  m.is_dense = 1;
  m.data.resize(m.row_step);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const sim::LidarPoint& p = scan.points[i];
    std::uint8_t* to = &m.data[i * m.point_step];
    std::memcpy(to, &p.x, 16);  // x y z intensity
    if (layout == PointLayout::kOuster) {
      const auto t_ns = static_cast<std::uint32_t>(NsFromSeconds(p.time_s));
      std::memcpy(to + 16, &t_ns, 4);
      to[20] = static_cast<std::uint8_t>(p.ring);
    } else {
      std::memcpy(to + 16, &p.ring, 2);
      if (layout == PointLayout::kVelodyne) std::memcpy(to + 18, &p.time_s, 4);
    }
  }
  return m;
}

BagDialect BagDialectOf(const std::string& name) {
  if (name == "plain") return BagDialect::kPlain;
  if (name == "mvsec") return BagDialect::kMvsec;
  if (name == "vector") return BagDialect::kVector;
  throw std::invalid_argument("bag dialect '" + name + "' is not known; expected one of plain, mvsec, vector");
}

void SimBagWriter::WriteRight(const sim::Chunk& /*chunk*/) {
  throw std::logic_error("this dialect is written without a right camera");
}

sim::SequenceOptions RightCameraOf(const sim::SequenceOptions& left) {
  sim::SequenceOptions right = left;
  right.T_motion_event = left.T_motion_event * Rigid3::Translation({0.1, 0, 0});
  right.noise_seed = left.seed + 0x51e2e0;
  right.lidar = false;
  return right;
}

std::unique_ptr<SimBagWriter> SimBagWriter::Create(BagDialect dialect, const std::string& stem,
                                                   const sim::Sequence& sequence, const sim::Sequence* right) {
  if (right != nullptr && dialect != BagDialect::kMvsec)
    throw std::invalid_argument("a right camera is written in the mvsec dialect only");
  if (dialect == BagDialect::kMvsec) return MakeMvsecWriter(stem, sequence, right);
  if (dialect == BagDialect::kVector) return MakeVectorWriter(stem, sequence);
  return std::make_unique<PlainWriter>(stem, sequence);
}

}  // namespace devo
