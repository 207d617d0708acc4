// SPDX-License-Identifier: BSD-3-Clause
//
// What an RGB-D camera would have given: OpenCV's ICPOdometry (depth alone), RgbdOdometry (photometric) and
// RgbdICPOdometry (both) on the bags that devo_offline reads, at the same depth rate, judged by the same evaluation,
// beside devo_offline's trajectory at the same times. Frame to frame, one thread.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <exception>
#include <fstream>
#include <iostream>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/Image.h>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/rgbd.hpp>

#include "command_line.h"
#include "devo/core/camera.h"
#include "devo/core/rig.h"
#include "devo/core/time.h"
#include "devo/io/evaluation.h"
#include "devo/io/output_folder.h"
#include "devo/io/rig_config.h"
#include "devo/io/trajectory.h"
#include "devo/ros/bag_reader.h"
#include "devo/ros/conversions.h"

namespace devo {
namespace {

struct Arguments {
  std::vector<std::string> configs, bags;
  std::string image_topic = "/event_camera/image_raw";
  std::string out = ".";
  std::string ground_truth_file;
  std::string compare_file;
  double depth_rate_hz = 30;
  double max_gap_s = 0.02;
};

struct StampedImage {
  std::int64_t t_ns;
  cv::Mat image;  // CV_8UC1, or CV_32FC1 in metres
};

struct Recording {
  std::vector<StampedImage> frames, depths;
  Rig rig;
  Trajectory ground_truth;
  Trajectory compared;  // of another program, judged at the peers' times
};

std::vector<StampedImage> ReadFrames(const Arguments& arguments) {
  std::vector<StampedImage> frames;
  for (const std::string& path : arguments.bags) {
    rosbag::Bag bag(path);
    for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(arguments.image_topic))) {
      const auto image = message.instantiate<sensor_msgs::Image>();
      if (!image)
        throw std::runtime_error(arguments.image_topic + " is " + message.getDataType() + ", expected an Image");
      frames.push_back({FromRosTime(image->header.stamp), cv_bridge::toCvCopy(image, "mono8")->image});
    }
  }
  return frames;
}

Recording ReadRecording(const Arguments& arguments, const RigConfig& config) {
  Recording recording;
  if (config.depth_from_lidar()) throw std::runtime_error("key 'topics.points' is given, expected depth images");
  BagReader reader(arguments.bags, config);
  recording.rig = reader.ReadRig();
  if (recording.rig.depth_registered) {
    recording.rig.depth_camera = recording.rig.event_camera;
    recording.rig.T_event_depth = Rigid3();
  }
  const Rigid3 T_body_event = config.T_body_event.value_or(Rigid3());
  while (const std::optional<BagItem> item = reader.Next()) {
    if (const auto* depth = std::get_if<DepthImage>(&*item)) {
      cv::Mat depth_m = depth->depth_m.clone();
      // OpenCV's odometry takes NaN for "no measurement".
      depth_m.setTo(std::nanf(""), depth_m <= 0);
      recording.depths.push_back({depth->t_ns, depth_m});
    } else if (const auto* truth = std::get_if<GroundTruthPose>(&*item)) {
      recording.ground_truth.push_back({truth->pose.t_ns, truth->pose.T_world_body * T_body_event});
    }
  }
  if (recording.depths.empty()) throw std::runtime_error("no depth image on topic " + config.topics.depth);
  recording.frames = ReadFrames(arguments);
  if (!arguments.ground_truth_file.empty()) recording.ground_truth = ReadTum(arguments.ground_truth_file);
  SortByTime(&recording.ground_truth);
  if (!arguments.compare_file.empty()) recording.compared = ReadTum(arguments.compare_file);
  return recording;
}

/// Where each pixel of the undistorted image lies in the distorted one, for cv::remap.
cv::Mat2f UndistortionMap(const Camera& camera) {
  const Camera undistorted = camera.Undistorted();
  cv::Mat2f map(undistorted.height(), undistorted.width());
  for (int y = 0; y < map.rows; ++y) {
    for (int x = 0; x < map.cols; ++x) {
      const auto u = camera.Project(*undistorted.Unproject({x, y}));
      map(y, x) = u ? cv::Vec2f(static_cast<float>(u->x()), static_cast<float>(u->y())) : cv::Vec2f(-1e4F, -1e4F);
    }
  }
  return map;
}

cv::Mat Undistort(const cv::Mat& image, const cv::Mat2f& map) {
  const bool depth = image.type() == CV_32F;
  cv::Mat undistorted;
  // Interpolated depth would invent surfaces between foreground and background.
  cv::remap(image, undistorted, map, cv::noArray(), depth ? cv::INTER_NEAREST : cv::INTER_LINEAR, cv::BORDER_CONSTANT,
            depth ? cv::Scalar(std::nanf("")) : cv::Scalar(0));
  return undistorted;
}

cv::Mat1d Intrinsics(const Camera& camera) {
  return (cv::Mat1d(3, 3) << camera.fx(), 0, camera.cx(), 0, camera.fy(), camera.cy(), 0, 0, 1);
}

/// Depth of another camera in the undistorted image of `target`: each reading goes to the four pixels around its
/// place, the nearest wins. (cv::rgbd::registerDepth of OpenCV 4.6 writes out of bounds when the sizes differ.)
cv::Mat1f RegisterDepth(const cv::Mat1f& depth_m, const cv::Mat2f& rays, const Rigid3& T_target_depth,
                        const Camera& target) {
  cv::Mat1f registered(target.height(), target.width(), std::nanf(""));
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      const double z = depth_m(y, x);
      if (!(z > 0) || std::isnan(rays(y, x)[0])) continue;
      const Eigen::Vector3d p = T_target_depth * Eigen::Vector3d(z * rays(y, x)[0], z * rays(y, x)[1], z);
      const auto u = target.Project(p);
      if (!u) continue;
      const int column = static_cast<int>(std::floor(u->x())), row = static_cast<int>(std::floor(u->y()));
      for (const cv::Point pixel : {cv::Point(column, row), cv::Point(column + 1, row), cv::Point(column, row + 1),
                                    cv::Point(column + 1, row + 1)}) {
        if (pixel.x < 0 || pixel.y < 0 || pixel.x >= registered.cols || pixel.y >= registered.rows) continue;
        float& value = registered(pixel);
        if (std::isnan(value) || p.z() < value) value = static_cast<float>(p.z());
      }
    }
  }
  return registered;
}

Rigid3 FromCv(const cv::Mat& matrix) {
  Eigen::Matrix4d T;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) T(row, column) = matrix.at<double>(row, column);
  }
  return Rigid3::FromMatrix(T);
}

/// Depth images no closer together than the rate allows, from the first on.
std::vector<const StampedImage*> AtRate(const std::vector<StampedImage>& images, double rate_hz) {
  std::vector<const StampedImage*> kept;
  for (const StampedImage& image : images) {
    // A tenth of a period of slack, so that jittered stamps at the sensor's own rate all pass.
    if (kept.empty() || SecondsFromNs(image.t_ns - kept.back()->t_ns) >= 0.9 / rate_hz) kept.push_back(&image);
  }
  return kept;
}

const StampedImage* Nearest(const std::vector<StampedImage>& images, std::int64_t t_ns, double max_gap_s) {
  const StampedImage* nearest = nullptr;
  for (const StampedImage& image : images) {
    const auto gap = [t_ns](const StampedImage& other) { return std::abs(other.t_ns - t_ns); };
    if (!nearest || gap(image) < gap(*nearest)) nearest = &image;
  }
  if (!nearest || SecondsFromNs(std::abs(nearest->t_ns - t_ns)) > max_gap_s) return nullptr;
  return nearest;
}

struct Result {
  Trajectory trajectory;  // T_world_event
  std::vector<double> cpu_ms;
  int refused = 0;  // steps that OpenCV could not estimate; the pose is then kept
};

/// What differs between the methods: the camera they work in, and what they see.
struct Input {
  Camera camera;  // without distortion
  Rigid3 T_event_camera;
  std::vector<StampedImage> depths, frames;  // of equal count; frames are black for ICP
};

template <typename Odometry>
Result Run(const Input& input) {
  auto odometry = Odometry::create(Intrinsics(input.camera), 0.1F, 10.0F);
  // The defaults refuse steps above 0.15 m or 15 deg, which at 1 Hz would be most of them.
  odometry->setMaxTranslation(1.0);
  odometry->setMaxRotation(60.0);
  Result result;
  Rigid3 T_world_camera;
  cv::Ptr<cv::rgbd::OdometryFrame> previous;
  for (std::size_t i = 0; i < input.depths.size(); ++i) {
    const std::clock_t start = std::clock();
    auto frame = cv::makePtr<cv::rgbd::OdometryFrame>(input.frames[i].image, input.depths[i].image);
    if (previous) {
      cv::Mat T_previous_current;
      // compute() maps points of its first frame to its second.
      const bool found = odometry->compute(frame, previous, T_previous_current) && cv::checkRange(T_previous_current);
      if (found) T_world_camera = T_world_camera * FromCv(T_previous_current);
      if (!found) ++result.refused;
    }
    previous = frame;
    result.cpu_ms.push_back(1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
    result.trajectory.push_back({input.depths[i].t_ns, T_world_camera * input.T_event_camera.inverse()});
  }
  return result;
}

/// ICP needs no frames: it runs in the depth camera, on its raw readings.
Input InputOfDepth(const Recording& recording, double depth_rate_hz) {
  Input input{recording.rig.depth_camera.Undistorted(), recording.rig.T_event_depth, {}, {}};
  const cv::Mat2f map = UndistortionMap(recording.rig.depth_camera);
  for (const StampedImage* depth : AtRate(recording.depths, depth_rate_hz)) {
    input.depths.push_back({depth->t_ns, Undistort(depth->image, map)});
    input.frames.push_back({depth->t_ns, cv::Mat(map.size(), CV_8U, cv::Scalar(0))});
  }
  return input;
}

/// Odometries of frames run in the frame camera, with the depth registered to it.
Input InputOfFrames(const Recording& recording, double depth_rate_hz, double max_gap_s) {
  Input input{recording.rig.event_camera.Undistorted(), Rigid3(), {}, {}};
  const cv::Mat2f depth_rays = RayTable(recording.rig.depth_camera);
  const cv::Mat2f frame_map = UndistortionMap(recording.rig.event_camera);
  for (const StampedImage* depth : AtRate(recording.depths, depth_rate_hz)) {
    const StampedImage* frame = Nearest(recording.frames, depth->t_ns, max_gap_s);
    if (!frame) continue;
    input.depths.push_back(
        {depth->t_ns, RegisterDepth(depth->image, depth_rays, recording.rig.T_event_depth, input.camera)});
    input.frames.push_back({frame->t_ns, Undistort(frame->image, frame_map)});
  }
  return input;
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// Poses of `estimate` at times that `other` has, too, and those of `other` at these times.
std::pair<Trajectory, Trajectory> AtCommonTimes(const Trajectory& estimate, const Trajectory& other) {
  std::pair<Trajectory, Trajectory> common;
  for (const StampedPose& pose : estimate) {
    const auto T_world_body = PoseAt(other, pose.t_ns, NsFromSeconds(0.05));
    if (!T_world_body) continue;
    common.first.push_back(pose);
    common.second.push_back({pose.t_ns, *T_world_body});
  }
  return common;
}

/// Null where there are too few poses to judge.
nlohmann::json Judge(const Trajectory& truth, const Trajectory& estimate) {
  if (truth.empty() || estimate.size() < 3) return nullptr;
  return nlohmann::json::parse(ToJson(Evaluate(truth, estimate)));
}

/// Writes the trajectory, prints a line and returns the same figures.
nlohmann::json Report(const std::string& name, const Arguments& arguments, const Recording& recording,
                      const Result& result) {
  WriteTum(arguments.out + "/" + name + ".txt", result.trajectory);
  nlohmann::json report;
  report["images"] = result.trajectory.size();
  report["refused"] = result.refused;
  report["cpu_ms_per_image"] = Median(result.cpu_ms);
  report["cpu_s"] = 1e-3 * std::accumulate(result.cpu_ms.begin(), result.cpu_ms.end(), 0.0);
  const bool compare = !recording.compared.empty();
  const auto common = AtCommonTimes(result.trajectory, recording.compared);
  report["evaluation"] = Judge(recording.ground_truth, compare ? common.first : result.trajectory);
  report["compared"] = compare ? Judge(recording.ground_truth, common.second) : nlohmann::json();
  std::printf("%-11s %3zu images, %d steps refused, median %.1f ms CPU per image", name.c_str(),
              result.trajectory.size(), result.refused, Median(result.cpu_ms));
  const auto print = [](const char* what, const nlohmann::json& e) {
    if (e.is_null()) return;
    std::printf(", %s %.2f cm", what, 100 * e["ate_rmse_m"].get<double>());
    if (e["drift_percent"].is_null()) return;
    std::printf(" (%.2f %% of %.2f m)", e["drift_percent"].get<double>(), e["path_length_m"].get<double>());
  };
  print("ATE", report["evaluation"]);
  print("compared ATE", report["compared"]);
  std::printf("\n");
  return report;
}

void Main(const Arguments& arguments) {
  MakeOutputFolder(arguments.out);
  cv::setNumThreads(1);
  const Recording recording = ReadRecording(arguments, LoadRigConfig(arguments.configs));
  nlohmann::json peers;
  peers["icp"] =
      Report("icp", arguments, recording, Run<cv::rgbd::ICPOdometry>(InputOfDepth(recording, arguments.depth_rate_hz)));
  if (recording.frames.empty()) {
    std::printf("rgbd_icp and photometric are not run: no frame on topic %s\n", arguments.image_topic.c_str());
  } else {
    const Input input = InputOfFrames(recording, arguments.depth_rate_hz, arguments.max_gap_s);
    peers["rgbd_icp"] = Report("rgbd_icp", arguments, recording, Run<cv::rgbd::RgbdICPOdometry>(input));
    peers["photometric"] = Report("photometric", arguments, recording, Run<cv::rgbd::RgbdOdometry>(input));
  }
  std::ofstream file(arguments.out + "/peers.json");
  file << peers.dump(2) << '\n';
  if (!file.flush()) throw std::runtime_error("'" + arguments.out + "/peers.json': cannot be written");
}

}  // namespace
}  // namespace devo

int main(int argc, char** argv) {
  devo::Arguments arguments;
  devo::CommandLine line("--config RIG.yaml --bag A.bag [options]",
                         "OpenCV's RGB-D odometries on the bags of devo_offline; writes icp.txt, rgbd_icp.txt, "
                         "photometric.txt (TUM) and peers.json.");
  line.Add("config", devo::Several(&arguments.configs)->required(), "yaml of the rig; several: later ones override");
  line.Add("bag", devo::Several(&arguments.bags)->required(), "recordings, read together");
  line.Add("out", devo::Shown(&arguments.out), "folder to write to, made if missing");
  line.Add("image-topic", devo::Shown(&arguments.image_topic), "frames in the event camera's image");
  line.Add("depth-rate", devo::ShownNumberIn(&arguments.depth_rate_hz, 1e-3, 1e6),
           "use depth images at most this often, Hz");
  line.Add("max-gap", devo::ShownNumberIn(&arguments.max_gap_s, 0, 1e6),
           "largest time between a depth image and its frame, s");
  line.Add("groundtruth", devo::po::value(&arguments.ground_truth_file), "TUM file in place of the bag's topic");
  line.Add("compare", devo::po::value(&arguments.compare_file),
           "TUM file, e.g. devo_offline's, to be judged at the same times");
  if (const auto status = line.Read(argc, argv)) return *status;
  try {
    devo::Main(arguments);
  } catch (const std::exception& error) {
    std::cerr << "devo_rgbd_baseline: " << error.what() << "\n";
    return 2;
  }
  return 0;
}
