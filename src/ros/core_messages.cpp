// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/core_messages.h"

#include <cstring>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "devo/ros/conversions.h"

namespace devo {
namespace {

using ros::serialization::IStream;
using ros::serialization::LStream;
using ros::serialization::OStream;

// ROS's wire format is little-endian and packed, as these structs are in memory: arrays of them go in one copy.
static_assert(sizeof(EdgePoint) == 6 * 4, "EdgePoint must have the layout of SurfaceEdge.msg");
static_assert(sizeof(MapPoint) == 12 * 4, "MapPoint must have the layout of SemiDensePoint.msg");

template <typename Stream>
void WriteBytes(Stream& stream, [[maybe_unused]] const void* data, std::size_t bytes) {
  if constexpr (std::is_same_v<Stream, LStream>) {
    stream.advance(static_cast<std::uint32_t>(bytes));  // only counts
  } else {
    std::uint8_t* const to = stream.advance(static_cast<std::uint32_t>(bytes));
    if (bytes > 0) std::memcpy(to, data, bytes);
  }
}

template <typename Stream, typename T>
void WriteArray(Stream& stream, const std::vector<T>& items) {
  stream.next(static_cast<std::uint32_t>(items.size()));
  WriteBytes(stream, items.data(), items.size() * sizeof(T));
}

/// The array's length and its values row by row: a cv::Mat's rows need not be adjacent.
template <typename Stream>
void WriteMat(Stream& stream, const cv::Mat& mat) {
  stream.next(static_cast<std::uint32_t>(mat.total()));
  for (int y = 0; y < mat.rows; ++y) WriteBytes(stream, mat.ptr(y), mat.cols * mat.elemSize());
}

template <typename T>
void ReadArray(IStream& stream, std::vector<T>& items) {
  std::uint32_t size = 0;
  stream.next(size);
  if (size > stream.getLength() / sizeof(T)) ros::serialization::throwStreamOverrun();
  items.resize(size);
  const std::size_t bytes = items.size() * sizeof(T);
  const std::uint8_t* from = stream.advance(static_cast<std::uint32_t>(bytes));
  if (bytes > 0) std::memcpy(static_cast<void*>(items.data()), from, bytes);
}

/// An array of height x width values, or of none.
template <typename T>
void ReadMat(IStream& stream, std::uint32_t height, std::uint32_t width, const char* name, cv::Mat_<T>& mat) {
  std::uint32_t size = 0;
  stream.next(size);
  if (size != 0 && size != std::uint64_t{height} * width) {
    throw std::runtime_error(std::string(name) + " has " + std::to_string(size) + " values; expected " +
                             std::to_string(std::uint64_t{height} * width) + " (height x width) or none");
  }
  const std::uint8_t* from = stream.advance(static_cast<std::uint32_t>(size * sizeof(T)));
  mat.release();
  if (size == 0) return;
  mat.create(static_cast<int>(height), static_cast<int>(width));
  std::memcpy(mat.data, from, size * sizeof(T));
}

bool ReadBool(IStream& stream) {
  std::uint8_t byte = 0;
  stream.next(byte);
  return byte != 0;
}

ros::Time ReadTime(IStream& stream) {
  ros::Time stamp;
  stream.next(stamp);
  return stamp;
}

/// A fixed array of numbers, row by row.
template <typename Stream, int kRows, int kCols>
void WriteMatrix(Stream& stream, const Eigen::Matrix<double, kRows, kCols>& matrix) {
  for (int row = 0; row < kRows; ++row) {
    for (int col = 0; col < kCols; ++col) stream.next(matrix(row, col));
  }
}

template <int kRows, int kCols>
void ReadMatrix(IStream& stream, Eigen::Matrix<double, kRows, kCols>& matrix) {
  for (int row = 0; row < kRows; ++row) {
    for (int col = 0; col < kCols; ++col) stream.next(matrix(row, col));
  }
}

template <typename Stream>
void WritePose(Stream& stream, const Rigid3& T) {
  stream.next(ToPoseMsg(T));
}

Rigid3 ReadPose(IStream& stream) {
  geometry_msgs::Pose pose;
  stream.next(pose);
  return FromPoseMsg(pose);
}

void ReadEarlier(IStream& stream, std::vector<PoseHistory::Stamped>& earlier) {
  constexpr std::size_t kBytes = 8 + 7 * sizeof(double);  // of an EarlierPose
  std::uint32_t size = 0;
  stream.next(size);
  if (size > stream.getLength() / kBytes) ros::serialization::throwStreamOverrun();
  earlier.resize(size);
  for (PoseHistory::Stamped& pose : earlier) {
    pose.t_ns = FromRosTime(ReadTime(stream));
    pose.T_world_event = ReadPose(stream);
  }
}

/// Tracking follows the indices without looking: none of another process may lead out of the edges.
void CheckNearestEdges(const Surface& surface) {
  for (const std::int32_t packed : surface.nearest_edge) {
    if (packed == Surface::kNoEdge || static_cast<std::size_t>(packed & 0xFFFF) < surface.edges.size()) continue;
    throw std::runtime_error("TimeSurface.nearest_edge names edge " + std::to_string(packed & 0xFFFF) +
                             "; expected 0 to " + std::to_string(surface.edges.size()) + " exclusive, or 0x7E000000");
  }
}

}  // namespace

template <typename Stream>
void WriteMessage(Stream& stream, const Surface& surface) {
  stream.next(ToRosTime(surface.t_ns));
  stream.next(ToRosTime(surface.t_edges_ns));
  stream.next(surface.epoch);
  stream.next(static_cast<std::uint32_t>(surface.height()));
  stream.next(static_cast<std::uint32_t>(surface.width()));
  WriteMat(stream, surface.image);
  WriteArray(stream, surface.edges);
  WriteMat(stream, surface.nearest_edge);
  stream.next(surface.event_rate_hz);
  stream.next(surface.activity_hz);
  stream.next(surface.window_s);
  stream.next(surface.events_used);
  stream.next(static_cast<std::uint8_t>(surface.still));
  stream.next(static_cast<std::uint8_t>(surface.maybe_noise));
  stream.next(static_cast<std::uint8_t>(surface.noise_goes_on));
  WriteMatrix(stream, surface.turn_event);
}

void ReadMessage(IStream& stream, Surface& surface) {
  surface.t_ns = FromRosTime(ReadTime(stream));
  surface.t_edges_ns = FromRosTime(ReadTime(stream));
  stream.next(surface.epoch);
  std::uint32_t height = 0, width = 0;
  stream.next(height);
  stream.next(width);
  ReadMat(stream, height, width, "TimeSurface.image", surface.image);
  ReadArray(stream, surface.edges);
  ReadMat(stream, height, width, "TimeSurface.nearest_edge", surface.nearest_edge);
  CheckNearestEdges(surface);
  stream.next(surface.event_rate_hz);
  stream.next(surface.activity_hz);
  stream.next(surface.window_s);
  stream.next(surface.events_used);
  for (bool* flag : {&surface.still, &surface.maybe_noise, &surface.noise_goes_on}) *flag = ReadBool(stream);
  ReadMatrix(stream, surface.turn_event);
}

template <typename Stream>
void WriteMessage(Stream& stream, const PoseEstimate& estimate) {
  stream.next(ToRosTime(estimate.t_ns));
  stream.next(estimate.epoch);
  WritePose(stream, estimate.T_world_event);
  stream.next(ToRosTime(estimate.t_edges_ns));
  WritePose(stream, estimate.T_world_event_edges);
  stream.next(static_cast<std::uint32_t>(estimate.earlier.size()));
  for (const PoseHistory::Stamped& earlier : estimate.earlier) {
    stream.next(ToRosTime(earlier.t_ns));
    WritePose(stream, earlier.T_world_event);
  }
  WriteMatrix(stream, estimate.velocity_event);
  stream.next(static_cast<std::uint8_t>(estimate.velocity_of_poses));
  WriteMatrix(stream, estimate.acceleration_event);
  WriteMatrix(stream, estimate.covariance_event);
  WriteMatrix(stream, estimate.covariance_in_chapter);
  for (const double delay_s :
       {estimate.delays.event_s, estimate.delays.depth_s, estimate.delays.depth_sigma_s, estimate.delays.inertial_s}) {
    stream.next(delay_s);
  }
  stream.next(estimate.inertial_fit.gyroscope);
  stream.next(estimate.inertial_fit.accelerometer);
  stream.next(estimate.inertial_fit.force_m_s2);
  stream.next(estimate.inertial_fit.gyroscope_noise);
  stream.next(estimate.inertial_fit.accelerometer_noise);
  stream.next(static_cast<std::uint8_t>(estimate.inertial_fit.left_out));
  stream.next(static_cast<std::int32_t>(estimate.chapter));
  stream.next(static_cast<std::uint8_t>(estimate.needs_map));
  stream.next(static_cast<std::uint8_t>(estimate.state));
  stream.next(static_cast<std::int32_t>(estimate.reference_id));
  stream.next(static_cast<std::int32_t>(estimate.points_used));
  stream.next(estimate.inlier_share);
  stream.next(estimate.mean_residual_px);
  stream.next(static_cast<std::int32_t>(estimate.iterations));
}

void ReadMessage(IStream& stream, PoseEstimate& estimate) {
  estimate.t_ns = FromRosTime(ReadTime(stream));
  stream.next(estimate.epoch);
  estimate.T_world_event = ReadPose(stream);
  estimate.t_edges_ns = FromRosTime(ReadTime(stream));
  estimate.T_world_event_edges = ReadPose(stream);
  ReadEarlier(stream, estimate.earlier);
  ReadMatrix(stream, estimate.velocity_event);
  std::uint8_t of_poses = 0;
  stream.next(of_poses);
  estimate.velocity_of_poses = of_poses != 0;
  ReadMatrix(stream, estimate.acceleration_event);
  ReadMatrix(stream, estimate.covariance_event);
  ReadMatrix(stream, estimate.covariance_in_chapter);
  SensorDelays& delays = estimate.delays;
  for (double* delay_s : {&delays.event_s, &delays.depth_s, &delays.depth_sigma_s, &delays.inertial_s}) {
    stream.next(*delay_s);
  }
  stream.next(estimate.inertial_fit.gyroscope);
  stream.next(estimate.inertial_fit.accelerometer);
  stream.next(estimate.inertial_fit.force_m_s2);
  stream.next(estimate.inertial_fit.gyroscope_noise);
  stream.next(estimate.inertial_fit.accelerometer_noise);
  std::uint8_t left_out = 0;
  stream.next(left_out);
  estimate.inertial_fit.left_out = left_out != 0;
  stream.next(estimate.chapter);
  std::uint8_t needs_map = 0;
  stream.next(needs_map);
  estimate.needs_map = needs_map != 0;
  std::uint8_t state = 0;
  stream.next(state);
  if (state > static_cast<std::uint8_t>(TrackingState::kRecovered)) {
    throw std::runtime_error("TrackedPose.state is " + std::to_string(state) + "; expected 0 to 4");
  }
  estimate.state = static_cast<TrackingState>(state);
  stream.next(estimate.reference_id);
  stream.next(estimate.points_used);
  stream.next(estimate.inlier_share);
  stream.next(estimate.mean_residual_px);
  stream.next(estimate.iterations);
}

template <typename Stream>
void WriteMessage(Stream& stream, const LocalMap& map) {
  stream.next(ToRosTime(map.t_ns));
  stream.next(map.epoch);
  stream.next(static_cast<std::int32_t>(map.id));
  stream.next(static_cast<std::int32_t>(map.chapter));
  stream.next(static_cast<std::uint8_t>(map.found_by_depth));
  WritePose(stream, map.T_world_ref);
  WriteArray(stream, map.points);
}

void ReadMessage(IStream& stream, LocalMap& map) {
  map.t_ns = FromRosTime(ReadTime(stream));
  stream.next(map.epoch);
  stream.next(map.id);
  stream.next(map.chapter);
  map.found_by_depth = ReadBool(stream);
  map.T_world_ref = ReadPose(stream);
  ReadArray(stream, map.points);
}

template <typename Stream>
void WriteMessage(Stream& stream, const SceneDepth& depth) {
  stream.next(ToRosTime(depth.t_ns));
  stream.next(depth.median_m);
  stream.next(static_cast<std::uint32_t>(depth.inverse_depth.rows));
  stream.next(static_cast<std::uint32_t>(depth.inverse_depth.cols));
  WriteMat(stream, depth.inverse_depth);
}

void ReadMessage(IStream& stream, SceneDepth& depth) {
  depth.t_ns = FromRosTime(ReadTime(stream));
  stream.next(depth.median_m);
  std::uint32_t height = 0, width = 0;
  stream.next(height);
  stream.next(width);
  ReadMat(stream, height, width, "SceneInverseDepth.inverse_depth", depth.inverse_depth);
}

template <typename Stream>
void WriteMessage(Stream& stream, const DepthPose& pose) {
  stream.next(ToRosTime(pose.t_ns));
  stream.next(pose.epoch);
  stream.next(static_cast<std::int32_t>(pose.chapter));
  WritePose(stream, pose.T_world_event);
  WriteMatrix(stream, pose.information);
  WriteMatrix(stream, pose.per_delay);
  stream.next(pose.delay_sigma_s);
  stream.next(pose.shared_share);
  stream.next(static_cast<std::uint8_t>(pose.confirmed));
}

void ReadMessage(IStream& stream, DepthPose& pose) {
  pose.t_ns = FromRosTime(ReadTime(stream));
  stream.next(pose.epoch);
  stream.next(pose.chapter);
  pose.T_world_event = ReadPose(stream);
  ReadMatrix(stream, pose.information);
  ReadMatrix(stream, pose.per_delay);
  stream.next(pose.delay_sigma_s);
  stream.next(pose.shared_share);
  pose.confirmed = ReadBool(stream);
}

template void WriteMessage(OStream&, const Surface&);
template void WriteMessage(LStream&, const Surface&);
template void WriteMessage(OStream&, const PoseEstimate&);
template void WriteMessage(LStream&, const PoseEstimate&);
template void WriteMessage(OStream&, const LocalMap&);
template void WriteMessage(LStream&, const LocalMap&);
template void WriteMessage(OStream&, const SceneDepth&);
template void WriteMessage(LStream&, const SceneDepth&);
template void WriteMessage(OStream&, const DepthPose&);
template void WriteMessage(LStream&, const DepthPose&);

}  // namespace devo
