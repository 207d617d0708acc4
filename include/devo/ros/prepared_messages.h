// SPDX-License-Identifier: BSD-3-Clause
//
// A simulated sequence as messages, made once and streamed as often as wanted.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include "devo/EventArray.h"
#include "devo/core/odometry.h"
#include "devo/sim/sequence.h"

namespace devo {

/// What a rig's drivers publish in (begin, end]: topics and frames of the plain dialect (devo/sim/rig_file.h).
struct SensorMessages {
  std::int64_t begin_ns = 0, end_ns = 0;
  EventArrayPtr events;  ///< null: none
  std::vector<sensor_msgs::ImagePtr> depth, frames;
  std::vector<sensor_msgs::PointCloud2Ptr> scans;
  std::vector<sensor_msgs::ImuPtr> imu;
  std::vector<geometry_msgs::PoseStampedPtr> truth;

  std::size_t event_count() const { return events ? events->events.size() : 0; }
};

SensorMessages ToMessages(const sim::Chunk& chunk, const Rig& rig);

/// A sequence in memory: 8 bytes per event, images as they are published.
class PreparedMessages {
 public:
  explicit PreparedMessages(const Rig& rig) : rig_(rig) {}

  /// Chunks in the order of time. Events must be within 71 minutes of their chunk's begin.
  void Add(const sim::Chunk& chunk);

  std::size_t chunks() const { return chunks_.size(); }
  std::uint64_t events() const { return events_; }
  std::size_t bytes() const { return bytes_; }

  /// New messages of a chunk, every stamp later by `later_ns`. The caller may publish them without copying.
  SensorMessages At(std::size_t chunk, std::int64_t later_ns) const;

 private:
  struct PackedEvent {
    std::uint32_t after_us;  ///< after the chunk's begin
    std::uint16_t x;
    std::uint16_t y_and_polarity;  ///< polarity in the highest bit
  };
  struct Stored {
    SensorMessages others;  ///< all but the events
    std::vector<PackedEvent> events;
  };
  EventArrayPtr UnpackedEvents(const Stored& stored, std::int64_t later_ns) const;

  Rig rig_;
  std::vector<Stored> chunks_;
  std::uint64_t events_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace devo
