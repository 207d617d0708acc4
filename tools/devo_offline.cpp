// SPDX-License-Identifier: BSD-3-Clause
//
// The odometry on recorded bags, as fast as it can, without a roscore.
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <deque>
#include <exception>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <opencv2/core/utility.hpp>

#include "command_line.h"
#include "devo/core/odometry.h"
#include "devo/core/time.h"
#include "devo/io/disturbance.h"
#include "devo/io/output_folder.h"
#include "devo/io/point_cloud_file.h"
#include "devo/io/rig_config.h"
#include "devo/io/run_report.h"
#include "devo/ros/bag_reader.h"
#include "devo/ros/read_ahead.h"

namespace {

struct Arguments {
  std::vector<std::string> configs, bags, overrides, disturbances;
  std::string out, ground_truth;
  devo::BagRange range;
  double depth_rate_hz = 0;
  int threads = 2;
  devo::DisturbanceOptions disturbance;
};

volatile std::sig_atomic_t interrupted = 0;

/// What was computed until then is written. A second time ends the program at once.
void StopAtInterrupt() {
  const auto stop = [](int signal) {
    interrupted = 1;
    std::signal(signal, SIG_DFL);
  };
  std::signal(SIGINT, stop);
  std::signal(SIGTERM, stop);
}

/// A bar on a terminal, plain lines elsewhere; on standard error, so that it never mixes with results.
class Progress {
 public:
  void Show(double share) {
    const int percent = static_cast<int>(100 * share);
    if (percent < next_percent_) return;
    if (terminal_) {
      const std::string bar(static_cast<std::size_t>(percent / 2), '=');
      std::fprintf(stderr, "\r[%-50s] %3d %%%s", bar.c_str(), percent, percent >= 100 ? "\n" : "");
    } else {
      std::fprintf(stderr, "%d %% of the events\n", percent);
    }
    std::fflush(stderr);
    next_percent_ = percent + (terminal_ ? 1 : 25);
    if (next_percent_ > 100 && percent < 100) next_percent_ = 100;
    open_line_ = terminal_ && percent < 100;
  }
  void Finish() {
    if (open_line_) std::fprintf(stderr, "\n");
    open_line_ = false;
  }

 private:
  const bool terminal_ = isatty(STDERR_FILENO) != 0;
  int next_percent_ = 0;
  bool open_line_ = false;
};

/// Lets through `rate_hz` images per second, those nearest after the ticks of a clock that the first one starts.
class DepthThinning {
 public:
  explicit DepthThinning(double rate_hz) : rate_hz_(rate_hz) {}

  bool Keep(std::int64_t t_ns) {
    if (rate_hz_ <= 0) return true;
    constexpr std::int64_t kJitter_ns = 2000000;  // a camera's stamps are not exactly a period apart
    const auto period_ns = devo::NsFromSeconds(1 / rate_hz_);
    if (next_ns_ == 0) next_ns_ = t_ns;
    if (t_ns + kJitter_ns < next_ns_) return false;
    while (next_ns_ <= t_ns + kJitter_ns) next_ns_ += period_ns;
    return true;
  }

 private:
  double rate_hz_;
  std::int64_t next_ns_ = 0;
};

/// Everything that one run holds, from the opened bags to the written files.
class Run {
 public:
  explicit Run(const Arguments& arguments)
      : arguments_(arguments), config_(devo::LoadRigConfig(arguments.configs, arguments.overrides)),
        reader_(arguments.bags, config_, arguments.range),
        rig_(arguments.disturbance.miscalibration.Of(reader_.ReadRig())),
        odometry_(rig_, config_.odometry, arguments.threads), report_(config_.odometry.surface.rate_hz),
        thinning_(arguments.depth_rate_hz) {
    if (!arguments.ground_truth.empty()) truth_ = devo::ReadTum(arguments.ground_truth);
    if (arguments.disturbance.any()) {
      disturbance_.emplace(arguments.disturbance, rig_.event_camera.width(), rig_.event_camera.height());
    }
    odometry_.on_pose = [this](const devo::PoseEstimate& pose, const devo::Surface&) { report_.AddPose(pose); };
  }

  /// Reads to the end, or to the first item that cannot be used: then its error is in the report.
  void Process() {
    const auto wall = std::chrono::steady_clock::now();
    Progress progress;
    try {
      devo::ReadAhead items(&reader_, arguments_.threads > 1);
      while (const auto item = items.Next()) {
        if (interrupted != 0) throw std::runtime_error(InterruptedAt());
        std::visit([this](const auto& value) { Take(value); }, item->item);
        progress.Show(item->progress);
      }
    } catch (const std::exception& e) {
      report_.error = e.what();
    }
    try {
      odometry_.Finish();
    } catch (const std::exception& e) {
      if (report_.error.empty()) report_.error = e.what();
    }
    progress.Finish();
    report_.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall).count();
    report_.cpu_s = static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
    Judge();
    Evaluate();
  }

  /// Each of the files, whether the others can be written or not; throws the first error then.
  void Write() {
    const std::string base = arguments_.out + "/";
    const std::vector<devo::MapPoint> map = odometry_.GlobalMap();
    report_.map_points = map.size();
    report_.timings = odometry_.timings();
    report_.configuration = devo::Describe(config_);
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    report_.peak_memory_mb = static_cast<double>(usage.ru_maxrss) / 1024;
    std::exception_ptr first_error;
    const auto attempt = [&first_error](auto&& write) {
      try {
        write();
      } catch (const std::exception&) {
        if (!first_error) first_error = std::current_exception();
      }
    };
    attempt([&] { devo::WriteTum(base + "trajectory.txt", report_.trajectory()); });
    attempt([&] {
      std::ofstream file(base + "report.json");
      file << report_.ToJson() << '\n';
      if (!file.flush()) throw std::runtime_error("'" + base + "report.json': cannot be written");
    });
    attempt([&] { devo::WritePointCloud(base + "map.pcd", map); });
    if (first_error) std::rethrow_exception(first_error);
  }

  const devo::RunReport& report() const { return report_; }

 private:
  std::string InterruptedAt() const {
    char text[80];
    std::snprintf(text, sizeof(text), "interrupted after %.3f s of events",
                  devo::SecondsFromNs(report_.end_ns - report_.begin_ns));
    return text;
  }
  void Take(const devo::EventSlice& slice) {
    if (report_.begin_ns == 0) report_.begin_ns = slice.events.begin()->t_ns;
    report_.end_ns = std::max(report_.end_ns, slice.events.end()[-1].t_ns);
    AddEvents(disturbance_ ? disturbance_->Apply(slice.events) : slice.events);
  }
  /// With the depth that arrives among them.
  void AddEvents(devo::EventSpan events) {
    for (; !late_.empty() && !events.empty() && late_.front().due_ns <= events.end()[-1].t_ns; late_.pop_front()) {
      const devo::Event* until = std::partition_point(
          events.begin(), events.end(), [this](const devo::Event& e) { return e.t_ns < late_.front().due_ns; });
      odometry_.AddEvents({events.begin(), static_cast<std::size_t>(until - events.begin())});
      late_.front().deliver();
      events = {until, static_cast<std::size_t>(events.end() - until)};
    }
    odometry_.AddEvents(events);
  }
  void DeliverAfterLatency(std::int64_t t_ns, std::function<void()> deliver) {
    const double latency_s = arguments_.disturbance.depth_latency_s;
    if (latency_s > 0) {
      late_.push_back({t_ns + devo::NsFromSeconds(latency_s), std::move(deliver)});
    } else {
      deliver();
    }
  }
  void Take(const devo::DepthImage& depth) {
    if (depth.depth_m.cols != rig_.depth_camera.width() || depth.depth_m.rows != rig_.depth_camera.height()) {
      const auto size = [](int w, int h) { return std::to_string(w) + "x" + std::to_string(h); };
      throw std::runtime_error(
          "topic '" + config_.topics.depth + "': depth image is " + size(depth.depth_m.cols, depth.depth_m.rows) +
          ", expected " + size(rig_.depth_camera.width(), rig_.depth_camera.height()) +
          (rig_.depth_registered ? " as the event camera (registered: true)" : " as its calibration"));
    }
    if (disturbance_ && disturbance_->LosesDepth(depth.t_ns)) return;
    if (thinning_.Keep(depth.t_ns)) {
      DeliverAfterLatency(depth.t_ns, [this, depth] { odometry_.AddDepth(depth); });
    } else {
      ++report_.depth_skipped_by_rate;
    }
  }
  void Take(const devo::LidarSweep& sweep) {
    if (thinning_.Keep(sweep.end_ns)) {
      DeliverAfterLatency(sweep.end_ns, [this, sweep] { odometry_.AddSweep(sweep); });
    } else {
      ++report_.depth_skipped_by_rate;
    }
  }
  void Take(const devo::ImuSample& sample) {
    const devo::ImuSample read = arguments_.disturbance.miscalibration.Of(sample);
    odometry_.AddImu(disturbance_ ? disturbance_->Apply(read) : read);
  }
  void Take(const devo::GroundTruthPose& truth) {
    if (arguments_.ground_truth.empty()) truth_.push_back(truth.pose);
  }

  /// A few bad events or images are a warning; a share that shows a wrong calibration or a broken recording an error.
  void Complain(std::uint64_t bad, std::uint64_t all, const std::string& what) {
    constexpr double kTolerableShare = 0.01;
    if (bad == 0) return;
    const std::string sentence = std::to_string(bad) + " of " + std::to_string(all) + " " + what;
    if (static_cast<double>(bad) > kTolerableShare * static_cast<double>(all)) {
      if (report_.error.empty()) report_.error = sentence;
    } else {
      report_.warnings.push_back(sentence);
    }
  }

  void Judge() {
    report_.counters = odometry_.counters();
    report_.depth_unordered = reader_.left_out().depth_unordered;
    for (const std::string& defect : reader_.Defects()) {
      if (report_.error.empty()) report_.error = defect;
    }
    const auto& c = report_.counters;
    const std::string events = "events of topic '" + config_.topics.events + "' ";
    const bool lidar = config_.depth_from_lidar();
    const std::string& depth_topic = lidar ? config_.topics.points : config_.topics.depth;
    const std::string depth_kind = lidar ? "sweeps" : "depth images";
    const std::string depth = depth_kind + " of topic '" + depth_topic + "' ";
    Complain(c.events.outside, c.events.in,
             events + "lie outside the image, expected x below " + std::to_string(rig_.event_camera.width()) +
                 " and y below " + std::to_string(rig_.event_camera.height()) + " (is event_camera the right one?)");
    Complain(c.events.unordered, c.events.in,
             events + "are earlier than the one before, expected times that never fall");
    Complain(report_.depth_unordered, c.mapping.depth_in + report_.depth_unordered + report_.depth_skipped_by_rate,
             depth + "are not later than the one before, expected stamps that rise");
    const auto warn = [this](std::uint64_t count, const std::string& what) {
      if (count > 0) report_.warnings.push_back(std::to_string(count) + " " + what);
    };
    warn(c.mapping.depth_too_late,
         depth + "came when surfaces of their time were kept no longer, and made no map; expected within 0.3 s");
    for (const std::string& missing : reader_.MissingOptional()) report_.warnings.push_back(missing);
    warn(reader_.left_out().events_stray, events +
                                              "have times far from all others and are left out, expected times of "
                                              "one clock");
    warn(reader_.left_out().imu_unordered, "IMU samples of topic '" + config_.topics.imu +
                                               "' are not later than the one before and are left out, expected stamps "
                                               "that rise");
    warn(reader_.left_out().imu_no_reading,
         "IMU samples of topic '" + config_.topics.imu +
             "' are left out, expected finite numbers within any sensor's range, in rad/s and m/s^2");
    warn(reader_.left_out().ground_truth_invalid, "poses of topic '" + config_.topics.ground_truth +
                                                      "' are left out, expected finite numbers and a quaternion of "
                                                      "length 1");
    if (c.mapping.depth_without_valid_pixel > 0 && c.mapping.depth_used == 0 && report_.error.empty()) {
      report_.error = std::string("no ") + (lidar ? "sweep" : "image") + " of topic '" + depth_topic + "' (" +
                      std::to_string(c.mapping.depth_in) + ") has a " +
                      (lidar ? "point in the event camera's view" : "valid pixel") +
                      ", expected readings between mapping.min_depth_m and mapping.max_depth_m";
    }
    if (c.events.in == 0 && report_.error.empty()) {
      report_.error = "no events lie in the range that --start and --duration give, expected some of the recording's";
    }
    if (report_.trajectory().empty() && report_.error.empty()) {
      report_.error = "no pose: " + std::to_string(c.events.in) + " events and " + std::to_string(c.mapping.depth_in) +
                      " " + depth_kind +
                      " made no reference, expected events and depth of the same time and a moving camera";
    }
    constexpr double kLateFirstPose_s = 1;
    if (report_.FirstPoseAfter_s() > kLateFirstPose_s) {
      report_.warnings.push_back("the first pose comes after " + std::to_string(report_.FirstPoseAfter_s()) +
                                 " s of events, expected one with the first depth image of a moving camera");
    }
    for (const std::string& complaint : {devo::Complaint(report_.inertial_fit()), devo::LampComplaint(c.events)}) {
      if (!complaint.empty()) report_.warnings.push_back(complaint);
    }
  }

  void Evaluate() {
    devo::SortByTime(&truth_);
    if (truth_.empty() || report_.trajectory().empty()) return;
    if (config_.T_body_event) {
      for (devo::StampedPose& pose : truth_) pose.T_world_body = pose.T_world_body * *config_.T_body_event;
    }
    try {
      report_.evaluation = devo::Evaluate(truth_, report_.trajectory(), {}, report_.covariances());
    } catch (const std::runtime_error& e) {
      report_.warnings.emplace_back(e.what());
    }
  }

  Arguments arguments_;
  devo::RigConfig config_;
  devo::BagReader reader_;
  devo::Rig rig_;
  devo::Odometry odometry_;
  devo::RunReport report_;
  DepthThinning thinning_;
  std::optional<devo::Disturbance> disturbance_;
  struct Late {
    std::int64_t due_ns;
    std::function<void()> deliver;
  };
  std::deque<Late> late_;  // depth on its way
  devo::Trajectory truth_;
};

int RunOffline(const Arguments& arguments) {
  cv::setNumThreads(arguments.threads);
  devo::MakeOutputFolder(arguments.out);
  Run run(arguments);
  StopAtInterrupt();
  run.Process();
  for (const std::string& warning : run.report().warnings)
    std::fprintf(stderr, "devo_offline: warning: %s\n", warning.c_str());
  std::printf("%s", run.report().Summary().c_str());
  std::fflush(stdout);
  run.Write();
  std::printf("%s/trajectory.txt, map.pcd, report.json\n", arguments.out.c_str());
  if (run.report().error.empty()) return 0;
  std::fprintf(stderr, "devo_offline: %s\n", run.report().error.c_str());
  return 2;
}

void AddOptions(devo::CommandLine* line, Arguments* a) {
  line->Add("config", devo::Several(&a->configs), "rig's yaml; later files override earlier ones");
  line->Add("bag", devo::Several(&a->bags), "bags, merged by the time of their data");
  line->Add("out", devo::po::value(&a->out), "folder for the results, made if missing");
  line->Add("set", devo::Several(&a->overrides), "key=value that overrides the yaml, e.g. surface.rate_hz=200");
  line->Add("start", devo::NumberIn(&a->range.start_s, 0, 1e9), "skip this many seconds of events");
  line->Add("duration", devo::NumberIn(&a->range.duration_s, 1e-3, 1e9), "seconds of events");
  line->Add("depth-rate", devo::NumberIn(&a->depth_rate_hz, 1e-3, 1e6),
            "use at most this many depth images per second");
  line->Add("groundtruth", devo::po::value(&a->ground_truth), "TUM file; else the bags' topics.ground_truth");
  line->Add("threads", devo::ShownNumberIn(&a->threads, 1, 64),
            "1: read and compute in turn, else at once; same result");
  line->Add("disturb", devo::Several(&a->disturbances),
            "what to take from the recording or add to it, to test robustness: event_gap=FROM:TO, depth_gap=FROM:TO, "
            "depth_latency=SECONDS (s), event_loss=SHARE, hot_pixels=SHARE, flicker=SHARE (of the image, at 100 Hz), "
            "light=AT:FACTOR (times as bright from then on), imu_noise=DEG_S:M_S2 (of each reading); "
            "or of the calibration: depth_rotation=X:Y:Z, imu_rotation=X:Y:Z (deg), depth_translation=X:Y:Z, "
            "imu_translation=X:Y:Z (m), event_focal=SHARE, "
            "depth_focal=SHARE, gyroscope_bias=X:Y:Z (deg/s), accelerometer_bias=X:Y:Z (m/s^2), gyroscope_scale=SHARE, "
            "accelerometer_scale=SHARE");
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  bool print_parameters = false;
  devo::CommandLine line(
      "--config RIG.yaml --bag A.bag --out FOLDER [options]",
      "Depth-event visual odometry on bags: trajectory (TUM), map (PCD) and report (JSON) into a folder.");
  AddOptions(&line, &arguments);
  line.AddFlag("print-parameters", &print_parameters, "print docs/parameters.md and exit");
  if (const auto status = line.Read(argc, argv)) return *status;
  if (print_parameters) {
    std::printf("%s", devo::ParametersMarkdown().c_str());
    return 0;
  }
  try {
    for (const char* option : {"config", "bag", "out"}) {
      if (!line.Has(option)) throw devo::po::required_option(std::string("--") + option);
    }
    for (const std::string& text : arguments.disturbances) arguments.disturbance.Add(text);
    return RunOffline(arguments);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "devo_offline: %s\n", e.what());
    return 2;
  }
}
