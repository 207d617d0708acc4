// SPDX-License-Identifier: BSD-3-Clause
//
// A simulated recording, produced piece by piece in the order of time: for files, for live nodelets, for tests.
//
//   devo::sim::SequenceOptions options;       // scene "table", sensor "gen3", speed "mid", light "bright", ...
//   devo::sim::Sequence sequence(options);
//   devo::sim::Chunk chunk;
//   while (sequence.Next(&chunk)) odometry.AddEvents(chunk.events);
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "devo/core/depth_image.h"
#include "devo/core/event.h"
#include "devo/core/odometry.h"
#include "devo/sim/depth_sensor.h"
#include "devo/sim/event_sensor.h"
#include "devo/sim/frame_sensor.h"
#include "devo/sim/imu_sensor.h"
#include "devo/sim/lidar.h"
#include "devo/sim/regular_camera.h"
#include "devo/sim/scene.h"
#include "devo/sim/sensors.h"
#include "devo/sim/trajectory.h"

namespace devo::sim {

struct SequenceOptions {
  std::string scene = "table";   ///< a name of SceneNames() or a yaml file
  std::string sensor = "gen3";   ///< a name of EventSensorNames()
  std::string light = "bright";  ///< a name of LightNames()
  double flicker = 0;            ///< modulation of all light, 0 to 1: a sine of 1 -+ that; frames average it
  double flicker_hz = 100;       ///< twice the mains' frequency
  std::string speed = "mid";     ///< slow, mid or fast; unused with `trajectory_file`
  std::string trajectory_file;   ///< TUM file with T_world_event, in the scene's world; empty: random motion
  double duration_s = 5;
  double rest_s = 0.3;  ///< at rest first
  bool closed = false;  ///< random motion that comes back and stops where it began, so that it may be repeated
  std::vector<Stop> stops;
  Rigid3
      T_motion_event;  ///< where on what moves the event camera sits; a second camera of a stereo pair sits elsewhere
  std::uint64_t seed = 1;        ///< of motion and noise
  std::uint64_t noise_seed = 0;  ///< not 0: noise of its own for the same motion
  double start_s = 1000;         ///< stamp of the begin
  int threads = 0;               ///< 0: one per processor. Does not change the result.

  bool ideal_pixels = false;  ///< a perfect event sensor, see IdealPixel

  enum class Depth { kNone, kKinect, kKinectExact, kRegistered } depth = Depth::kKinect;
  double depth_rate_hz = 30;       ///< up to 30
  double depth_time_offset_s = 0;  ///< depth stamps are late by this much
  double multipath = 0;            ///< see DepthModel
  bool lidar = false;              ///< 16 beams beside the camera
  double lidar_rate_hz = 10;
  bool frames = true;           ///< blurred, noisy frames of the event camera's pixels
  bool regular_camera = false;  ///< frames are those of VectorRegularCamera beside the event camera instead
  double frame_rate_hz = 30;
  bool imu = true;
  Rigid3 T_event_imu;         ///< in whose frame the samples are; the plain dialect and the live sensor have none
  double pose_rate_hz = 200;  ///< of ground truth

  double max_flow_px = 0.6;        ///< flow between two renderings, anywhere in the image
  EventPixels::Accuracy accuracy;  ///< sampling of a pixel's light between renderings
  double chunk_s = 0.01;           ///< length of a chunk
};

struct TimedPose {
  std::int64_t t_ns = 0;
  Rigid3 T_world_event;
};

/// Everything whose stamp lies in (begin, end], and the frames whose exposure ends there; each list in the order of its
/// stamps.
struct Chunk {
  std::int64_t begin_ns = 0, end_ns = 0;
  std::vector<Event> events;
  std::vector<DepthImage> depth;
  std::vector<LidarScan> scans;
  std::vector<Frame> frames;
  std::vector<ImuSample> imu;
  std::vector<TimedPose> poses;  ///< ground truth
};

struct SequenceStatistics {
  std::uint64_t events = 0, events_lost_in_readout = 0, renderings = 0;
  double path_m = 0, max_speed_m_s = 0, max_rate_rad_s = 0;
  double render_s = 0, depth_s = 0;  ///< wall time
};

class Sequence {
 public:
  /// Builds scene, light, sensors and motion. Throws std::invalid_argument naming the option and what was expected,
  /// std::runtime_error for files that cannot be read.
  explicit Sequence(const SequenceOptions& options);
  ~Sequence();

  /// The next chunk; false at the end of the sequence. Buffers of `chunk` are reused.
  bool Next(Chunk* chunk);

  const SequenceOptions& options() const;
  const Rig& rig() const;  ///< cameras and extrinsics; the depth camera's are the event camera's without depth
  const EventSensor& sensor() const;
  const DepthModel& depth_model() const;
  const LidarModel& lidar_model() const;
  const RegularCameraModel& regular_camera_model() const;
  const Trajectory& trajectory() const;  ///< time 0 is begin_ns()
  const SequenceStatistics& statistics() const;
  std::int64_t begin_ns() const;
  std::int64_t end_ns() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace devo::sim
