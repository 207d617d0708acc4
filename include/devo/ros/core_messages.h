// SPDX-License-Identifier: BSD-3-Clause
//
// Makes the core's frozen structs ROS messages, as pcl_ros does with point clouds: within a process publisher and
// subscriber share one object; between processes, and in a bag, they have the layout and md5 of the .msg file of the
// same content (Surface: TimeSurface, PoseEstimate: TrackedPose, LocalMap: SemiDenseMap, SceneDepth:
// SceneInverseDepth, DepthPose: PoseByDepth), so that rostopic understands them.
#pragma once

#include <memory>

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <boost/shared_ptr.hpp>

#include "devo/PoseByDepth.h"
#include "devo/SceneInverseDepth.h"
#include "devo/SemiDenseMap.h"
#include "devo/TimeSurface.h"
#include "devo/TrackedPose.h"
#include "devo/core/depth_pose.h"
#include "devo/core/local_map.h"
#include "devo/core/pose_estimate.h"
#include "devo/core/surface.h"

namespace devo {

/// The same object, owned jointly, as the other library's pointer. Nothing is copied.
template <typename T>
boost::shared_ptr<T> ToBoost(std::shared_ptr<T> pointer) {
  T* const raw = pointer.get();
  return boost::shared_ptr<T>(raw, [keep = std::move(pointer)](T*) mutable { keep.reset(); });
}
template <typename T>
std::shared_ptr<T> ToStd(boost::shared_ptr<T> pointer) {
  T* const raw = pointer.get();
  return std::shared_ptr<T>(raw, [keep = std::move(pointer)](T*) mutable { keep.reset(); });
}

/// Serialisation, defined in src/ros/core_messages.cpp for ros::serialization's OStream, LStream and IStream. Read
/// throws ros::serialization::StreamOverrunException or std::runtime_error on bytes that are no such message.
template <typename Stream>
void WriteMessage(Stream& stream, const Surface& surface);
template <typename Stream>
void WriteMessage(Stream& stream, const PoseEstimate& estimate);
template <typename Stream>
void WriteMessage(Stream& stream, const LocalMap& map);
template <typename Stream>
void WriteMessage(Stream& stream, const SceneDepth& depth);
template <typename Stream>
void WriteMessage(Stream& stream, const DepthPose& pose);
void ReadMessage(ros::serialization::IStream& stream, Surface& surface);
void ReadMessage(ros::serialization::IStream& stream, PoseEstimate& estimate);
void ReadMessage(ros::serialization::IStream& stream, LocalMap& map);
void ReadMessage(ros::serialization::IStream& stream, SceneDepth& depth);
void ReadMessage(ros::serialization::IStream& stream, DepthPose& pose);

}  // namespace devo

namespace ros {
namespace message_traits {

/// Traits that a core struct takes over from the generated message of the same layout.
template <typename Core, typename Generated>
struct TraitsOf {
  static const char* Md5() { return MD5Sum<Generated>::value(); }
  static const char* Type() { return DataType<Generated>::value(); }
  static const char* Text() { return Definition<Generated>::value(); }
};

#define DEVO_CORE_MESSAGE(Core, Generated)                                   \
  template <>                                                                \
  struct IsMessage<Core> : TrueType {};                                      \
  template <>                                                                \
  struct IsMessage<const Core> : TrueType {};                                \
  template <>                                                                \
  struct MD5Sum<Core> {                                                      \
    static const char* value() { return TraitsOf<Core, Generated>::Md5(); }  \
    static const char* value(const Core&) { return value(); }                \
  };                                                                         \
  template <>                                                                \
  struct DataType<Core> {                                                    \
    static const char* value() { return TraitsOf<Core, Generated>::Type(); } \
    static const char* value(const Core&) { return value(); }                \
  };                                                                         \
  template <>                                                                \
  struct Definition<Core> {                                                  \
    static const char* value() { return TraitsOf<Core, Generated>::Text(); } \
    static const char* value(const Core&) { return value(); }                \
  };

DEVO_CORE_MESSAGE(devo::Surface, devo::TimeSurface)
DEVO_CORE_MESSAGE(devo::PoseEstimate, devo::TrackedPose)
DEVO_CORE_MESSAGE(devo::LocalMap, devo::SemiDenseMap)
DEVO_CORE_MESSAGE(devo::SceneDepth, devo::SceneInverseDepth)
DEVO_CORE_MESSAGE(devo::DepthPose, devo::PoseByDepth)
#undef DEVO_CORE_MESSAGE

}  // namespace message_traits

namespace serialization {

template <typename Core>
struct CoreSerializer {
  template <typename Stream>
  static void write(Stream& stream, const Core& message) {
    devo::WriteMessage(stream, message);
  }
  template <typename Stream>
  static void read(Stream& stream, Core& message) {
    devo::ReadMessage(stream, message);
  }
  static uint32_t serializedLength(const Core& message) {
    LStream stream;
    devo::WriteMessage(stream, message);
    return stream.getLength();
  }
};

template <>
struct Serializer<devo::Surface> : CoreSerializer<devo::Surface> {};
template <>
struct Serializer<devo::PoseEstimate> : CoreSerializer<devo::PoseEstimate> {};
template <>
struct Serializer<devo::LocalMap> : CoreSerializer<devo::LocalMap> {};
template <>
struct Serializer<devo::SceneDepth> : CoreSerializer<devo::SceneDepth> {};
template <>
struct Serializer<devo::DepthPose> : CoreSerializer<devo::DepthPose> {};

}  // namespace serialization
}  // namespace ros
