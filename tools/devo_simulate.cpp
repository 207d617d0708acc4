// SPDX-License-Identifier: BSD-3-Clause
//
// Simulates a rig of event, depth, frame camera, LiDAR and IMU in a scene, into bags with ground truth.
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>

#include "command_line.h"
#include "devo/ros/sim_bag_writer.h"
#include "devo/sim/sequence.h"

namespace {

using devo::sim::SequenceOptions;

struct Arguments {
  SequenceOptions sequence;
  std::string out = "simulated";
  std::string dialect = "plain";
  std::string depth = "kinect";
  std::vector<double> stops;
  bool no_frames = false, no_imu = false, quiet = false, right = false;
};

void AddOptions(devo::CommandLine* line, Arguments* a) {
  using devo::Shown;
  SequenceOptions& s = a->sequence;
  line->Add("out", Shown(&a->out), "file name without extension: OUT.bag, OUT.yaml, OUT_groundtruth.txt");
  line->BeginGroup("What is seen");
  line->Add(
      "scene", Shown(&s.scene),
      "cali (textured boards), table (desk), sofa (living room, few edges), hall (36 m, for LiDAR), or a scene of "
      "your own: copy config/sim/example_scene.yaml");
  line->Add("light", Shown(&s.light), "bright (500 lux), darkish (100), dim (20), dark (3), hdr (dim room, one spot)");
  line->Add("flicker", Shown(&s.flicker), "modulation of the light, as of lamps at the mains: 0.1 bulbs, 0.4 tubes");
  line->Add("flicker-rate", devo::ShownNumberIn(&s.flicker_hz, 10, 1000), "times per second that it flickers");
  line->BeginGroup("Motion");
  line->Add("speed", Shown(&s.speed), "slow (0.3 m/s, 30 deg/s), mid (0.8, 80) or fast (1.5, 200)");
  line->Add("trajectory", devo::po::value(&s.trajectory_file),
            "instead of random motion: TUM file (t tx ty tz qx qy qz qw) with poses of the event camera (z forward, x "
            "right, y down) in the scene's world (z up); sets the duration");
  line->Add("duration", Shown(&s.duration_s), "seconds");
  line->Add("rest", Shown(&s.rest_s), "seconds at rest at the begin");
  line->AddFlag("closed", &s.closed, "random motion that comes back and stops where it began: for rosbag play --loop");
  line->Add("stop", devo::Several(&a->stops), "stand still: BEGIN DURATION in seconds; may be repeated");
  line->Add("seed", devo::ShownNumberIn(&s.seed, 0, 9e15), "of motion and noise; the same seed gives the same bytes");
  line->BeginGroup("Sensors");
  line->Add("sensor", Shown(&s.sensor),
            "gen3 (640x480), davis346, davis240, gen4 (1280x720), gen3_vector, davis346_mvsec");
  line->AddFlag("ideal", &s.ideal_pixels, "event pixels without noise, mismatch, latency or limits");
  line->Add("depth", Shown(&a->depth),
            "kinect (Azure Kinect beside the event camera, with its errors), exact (the same without), registered "
            "(exact, in the event camera's image), none");
  line->Add("depth-rate", Shown(&s.depth_rate_hz), "depth images per second");
  line->Add("depth-offset", Shown(&s.depth_time_offset_s), "seconds by which depth stamps are late");
  line->Add("multipath", Shown(&s.multipath), "strength of the depth's bias in corners, e.g. 0.2");
  line->AddFlag("lidar", &s.lidar, "add a 16-beam LiDAR");
  line->Add("lidar-rate", devo::ShownNumberIn(&s.lidar_rate_hz, 1, 30), "turns of the LiDAR per second");
  line->AddFlag("no-frames", &a->no_frames, "no frames of the event camera");
  line->AddFlag("no-imu", &a->no_imu, "no IMU");
  line->BeginGroup("Output");
  line->Add("dialect", Shown(&a->dialect),
            "plain, mvsec or vector: topics, files and calibration as these data sets have them (and their sensors, "
            "unless given)");
  line->AddFlag("right", &a->right, "mvsec: the right camera, too (takes twice as long)");
  line->Add("threads", devo::ShownNumberIn(&s.threads, 0, 64), "0: one per processor; does not change the result");
  line->AddFlag("quiet", &a->quiet, "no progress");
}

/// What a data set's rig has, where the user did not say otherwise.
void ApplyDialect(const devo::CommandLine& line, Arguments* a) {
  const devo::BagDialect dialect = devo::BagDialectOf(a->dialect);
  if (dialect == devo::BagDialect::kPlain) return;
  const bool mvsec = dialect == devo::BagDialect::kMvsec;
  if (!line.Has("sensor")) a->sequence.sensor = mvsec ? "davis346_mvsec" : "gen3_vector";
  if (!line.Has("depth") && mvsec) a->depth = "registered";
  if (!line.Has("depth-rate") && mvsec) a->sequence.depth_rate_hz = 20;
  if (!line.Has("lidar-rate") && mvsec) a->sequence.lidar_rate_hz = 20;
  a->sequence.lidar = true;
  a->sequence.T_event_imu =
      mvsec ? devo::sim::ImuInDavis()
            : devo::sim::VectorRegularCamera().T_event_camera * devo::sim::ImuBesideVectorRegularCamera();
  if (!mvsec) {
    a->sequence.regular_camera = true;
    a->sequence.pose_rate_hz = 120;
  }
}

/// A given motion is simulated to its end, unless the user says how long.
void ApplyTrajectory(const devo::CommandLine& line, SequenceOptions* s) {
  if (s->trajectory_file.empty() || line.Has("duration")) return;
  devo::sim::Trajectory motion = devo::sim::TrajectoryFromTum(s->trajectory_file);
  motion.SetPauses(s->rest_s, {});
  s->duration_s = motion.duration_s();
}

SequenceOptions Finish(Arguments* a) {
  using Depth = SequenceOptions::Depth;
  SequenceOptions& s = a->sequence;
  if (a->depth == "kinect") {
    s.depth = Depth::kKinect;
  } else if (a->depth == "exact") {
    s.depth = Depth::kKinectExact;
  } else if (a->depth == "registered") {
    s.depth = Depth::kRegistered;
  } else if (a->depth == "none") {
    s.depth = Depth::kNone;
  } else {
    throw std::invalid_argument("--depth '" + a->depth +
                                "' is not known; expected one of kinect, exact, registered, none");
  }
  if (a->stops.size() % 2 != 0) {
    throw std::invalid_argument("--stop has " + std::to_string(a->stops.size()) +
                                " numbers, expected two each time: BEGIN DURATION in seconds");
  }
  for (std::size_t i = 0; i + 1 < a->stops.size(); i += 2) s.stops.push_back({a->stops[i], a->stops[i + 1]});
  s.frames = !a->no_frames;
  s.imu = !a->no_imu;
  return s;
}

/// A bar on a terminal, a line every ten percent elsewhere.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}

  void Show(double share, const devo::sim::SequenceStatistics& s) {
    if (quiet_) return;
    const double passed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    const int tenth = static_cast<int>(share * 10);
    if (terminal_) {
      std::string bar(40, '.');
      for (int i = 0; i < static_cast<int>(share * 40); ++i) bar[i] = '#';
      std::fprintf(stderr, "\r[%s] %3.0f %%  %6.2f Mev  %3.0f s left ", bar.c_str(), 100 * share,
                   1e-6 * static_cast<double>(s.events), passed * (1 / share - 1));
      if (share >= 1) std::fprintf(stderr, "\n");
    } else if (tenth > last_tenth_) {
      std::fprintf(stderr, "%d %% after %.1f s, %.2f Mev\n", 10 * tenth, passed, 1e-6 * static_cast<double>(s.events));
    }
    last_tenth_ = tenth;
  }

 private:
  bool quiet_, terminal_;
  int last_tenth_ = 0;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

void Run(Arguments* arguments) {
  devo::sim::Sequence sequence(Finish(arguments));
  std::unique_ptr<devo::sim::Sequence> right;
  if (arguments->right) right = std::make_unique<devo::sim::Sequence>(devo::RightCameraOf(sequence.options()));
  const auto writer =
      devo::SimBagWriter::Create(devo::BagDialectOf(arguments->dialect), arguments->out, sequence, right.get());
  Progress progress(arguments->quiet);
  devo::sim::Chunk chunk;
  while (sequence.Next(&chunk)) {
    writer->Write(chunk);
    if (right && right->Next(&chunk)) writer->WriteRight(chunk);
    progress.Show(static_cast<double>(chunk.end_ns - sequence.begin_ns()) /
                      static_cast<double>(sequence.end_ns() - sequence.begin_ns()),
                  sequence.statistics());
  }
  writer->Close();
  const auto& s = sequence.statistics();
  const double duration = sequence.options().duration_s;
  std::printf("%llu events (%.2f Mev/s, %llu lost in the readout), path %.2f m, up to %.2f m/s and %.0f deg/s\n",
              static_cast<unsigned long long>(s.events), 1e-6 * static_cast<double>(s.events) / duration,
              static_cast<unsigned long long>(s.events_lost_in_readout), s.path_m, s.max_speed_m_s,
              s.max_rate_rad_s * 57.29578);
  std::printf("%llu renderings; %.1f s for events and frames, %.1f s for depth\n",
              static_cast<unsigned long long>(s.renderings), s.render_s, s.depth_s);
  for (const auto& file : writer->files()) std::printf("wrote %s\n", file.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  devo::CommandLine line(
      "[options]",
      "Simulates an event camera with a depth camera, frames, IMU and ground truth in a synthetic scene and writes ROS "
      "bags.",
      "\n"
      "First steps (1 s of 640x480 takes some 15 s on two cores, of davis240 3 s):\n"
      "  devo_simulate --scene table --sensor davis240 --duration 4 --out /tmp/table\n"
      "  devo_offline --config /tmp/table.yaml --bag /tmp/table.bag --out /tmp/result\n"
      "  devo_evaluate /tmp/table_groundtruth.txt /tmp/result/trajectory.txt\n"
      "  roslaunch devo replay.launch config:=/tmp/table.yaml bag:=/tmp/table.bag\n"
      "More: --scene sofa --light dark --speed fast is hard; --ideal --depth exact is as easy as it gets;\n"
      "--dialect mvsec or vector writes a data set's files. Models and their sources: docs/simulation.md\n");
  Arguments arguments;
  AddOptions(&line, &arguments);
  if (const auto status = line.Read(argc, argv)) return *status;
  try {
    ApplyDialect(line, &arguments);
    ApplyTrajectory(line, &arguments.sequence);
    Run(&arguments);
  } catch (const std::exception& e) {
    std::cerr << "devo_simulate: " << e.what() << '\n';
    return 2;
  }
  return 0;
}
