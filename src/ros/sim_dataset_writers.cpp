// SPDX-License-Identifier: BSD-3-Clause
//
// Bags and calibration files as the MVSEC and VECtor data sets have them, for their left event camera.
#include <cmath>
#include <iomanip>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <rosbag/bag.h>

#include "devo/EventArray.h"
#include "devo/io/output_folder.h"
#include "devo/ros/message_conversion.h"
#include "devo/sim/rig_file.h"
#include "sim_bag_helpers.h"

namespace devo {

/// An EventArray under the name that another package gives to the same message (same md5).
template <typename Name>
struct RenamedEventArray {
  EventArray message;
};
struct DvsName {
  static constexpr const char* kPackage = "dvs_msgs";
};
struct PropheseeName {
  static constexpr const char* kPackage = "prophesee_event_msgs";
};

}  // namespace devo

namespace ros {
namespace message_traits {

template <typename Name>
struct MD5Sum<devo::RenamedEventArray<Name>> {
  static const char* value() { return MD5Sum<devo::EventArray>::value(); }
  static const char* value(const devo::RenamedEventArray<Name>&) { return value(); }
};
template <typename Name>
struct DataType<devo::RenamedEventArray<Name>> {
  static const char* value() {
    static const std::string name = std::string(Name::kPackage) + "/EventArray";
    return name.c_str();
  }
  static const char* value(const devo::RenamedEventArray<Name>&) { return value(); }
};
template <typename Name>
struct Definition<devo::RenamedEventArray<Name>> {
  static const char* value() {
    static const std::string text = "std_msgs/Header header\nuint32 height\nuint32 width\n" +
                                    std::string(Name::kPackage) +
                                    "/Event[] events\n"
                                    "================================================================================\n"
                                    "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
                                    "================================================================================\n"
                                    "MSG: " +
                                    Name::kPackage + "/Event\nuint16 x\nuint16 y\ntime ts\nbool polarity\n";
    return text.c_str();
  }
  static const char* value(const devo::RenamedEventArray<Name>&) { return value(); }
};
template <typename Name>
struct HasHeader<devo::RenamedEventArray<Name>> : FalseType {};

}  // namespace message_traits
namespace serialization {

template <typename Name>
struct Serializer<devo::RenamedEventArray<Name>> {
  template <typename Stream>
  static void write(Stream& stream, const devo::RenamedEventArray<Name>& m) {
    stream.next(m.message);
  }
  static std::uint32_t serializedLength(const devo::RenamedEventArray<Name>& m) {
    return serializationLength(m.message);
  }
};

}  // namespace serialization
}  // namespace ros

namespace devo {
namespace {

template <typename Name>
void WriteEvents(const sim::Chunk& chunk, const Camera& camera, const std::string& topic, const std::string& frame_id,
                 SimBag* bag) {
  if (chunk.events.empty()) return;
  const RenamedEventArray<Name> renamed{ToEventArrayMsg(chunk.events, camera.width(), camera.height(), frame_id)};
  bag->Write(topic, SimStamp(chunk.events.back().t_ns), renamed);
}

std::string BaseName(const std::string& path) { return path.substr(path.find_last_of('/') + 1); }

/// Of the files beside it, with its slash; empty: the current one.
std::string FolderOf(const std::string& path) { return path.substr(0, path.size() - BaseName(path).size()); }

/// A 4x4 matrix as yaml: nested rows (Kalibr) or flat.
std::string MatrixYaml(const Rigid3& T, bool nested, const std::string& indent) {
  const Eigen::Matrix4d m = T.matrix();
  std::ostringstream out;
  out << std::setprecision(16);
  for (int r = 0; r < 4; ++r) {
    out << (nested ? indent + "- [" : r == 0 ? "[" : indent);
    for (int c = 0; c < 4; ++c) out << m(r, c) << (c < 3 ? ", " : nested ? "]\n" : r < 3 ? ",\n" : "]\n");
  }
  return out.str();
}

std::string Numbers(const std::vector<double>& values) {
  std::ostringstream out;
  out << std::setprecision(12) << '[';
  for (std::size_t i = 0; i < values.size(); ++i) out << (i > 0 ? ", " : "") << values[i];
  out << ']';
  return out.str();
}

/// MVSEC: everything of the DAVISes in two bags; camchain and rectification maps beside them, as the zip has them.
class MvsecWriter : public SimBagWriter {
 public:
  MvsecWriter(const std::string& stem, const sim::Sequence& sequence, const sim::Sequence* right)
      : sequence_(sequence), camera_(sequence.rig().event_camera) {
    if (!sequence.rig().depth_registered || (right != nullptr && !right->rig().depth_registered)) {
      throw std::invalid_argument(
          "the mvsec dialect has depth in the event camera's image; expected depth `registered`");
    }
    if (right != nullptr) T_right_left_ = right->options().T_motion_event.inverse() * sequence.options().T_motion_event;
    data_.Open(stem + "_data.bag", rosbag::compression::LZ4);
    gt_.Open(stem + "_gt.bag", rosbag::compression::LZ4);
    std::string scene = BaseName(stem);
    while (scene.size() > 1 && std::isdigit(static_cast<unsigned char>(scene.back())) != 0) scene.pop_back();
    files_ = {stem + "_data.bag", stem + "_gt.bag", FolderOf(stem) + "camchain-imucam-" + scene + ".yaml"};
    WriteSimText(files_[2], Camchain());
    WriteMaps(FolderOf(stem) + scene + "_left_");
    if (T_right_left_) WriteMaps(FolderOf(stem) + scene + "_right_");
  }

  void Write(const sim::Chunk& chunk) override {
    WriteCamera(chunk, "/davis/left", "davis_left");
    for (const auto& scan : chunk.scans) {
      const auto message =
          ToPointCloudMsg(scan, "velodyne", PointLayout::kVelodyneOld, 1 / sequence_.lidar_model().rate_hz);
      data_.Write("/velodyne_point_cloud", message.header.stamp, message);
    }
    for (const auto& pose : chunk.poses) {
      const auto message = ToPoseMsg(pose.t_ns, pose.T_world_event, "map");
      gt_.Write("/davis/left/pose", SimStamp(pose.t_ns), message);
      if (++poses_ % 10 == 0) gt_.Write("/davis/left/odometry", SimStamp(pose.t_ns), message);
    }
  }

  void WriteRight(const sim::Chunk& chunk) override { WriteCamera(chunk, "/davis/right", "davis_right"); }

  void Close() override {
    data_.Close();
    gt_.Close();
  }

 private:
  void WriteCamera(const sim::Chunk& chunk, const std::string& name, const std::string& frame_id) {
    WriteEvents<DvsName>(chunk, camera_, name + "/events", frame_id, &data_);
    for (const auto& frame : chunk.frames) {
      data_.Write(name + "/image_raw", SimStamp(frame.t_ns), ToFrameMsg(frame, frame_id));
      data_.Write(name + "/camera_info", SimStamp(frame.t_ns), ToCameraInfoMsg(camera_, frame.t_ns, frame_id));
    }
    for (const auto& sample : chunk.imu) data_.Write(name + "/imu", SimStamp(sample.t_ns), ToImuMsg(sample, frame_id));
    for (const auto& depth : chunk.depth) {
      const DepthImage rectified{depth.t_ns, Rectified(depth.depth_m)};
      gt_.Write(name + "/depth_image_raw", SimStamp(depth.t_ns), ToDepthMsg(depth, "32FC1", frame_id));
      gt_.Write(name + "/depth_image_rect", SimStamp(depth.t_ns), ToDepthMsg(rectified, "32FC1", frame_id));
      gt_.Write(name + "/camera_info", SimStamp(depth.t_ns), ToCameraInfoMsg(camera_, depth.t_ns, frame_id));
    }
  }

  std::string Camchain() const {
    std::ostringstream out;
    out << std::setprecision(16);
    if (sequence_.options().lidar) {
      out << "T_cam0_lidar:\n" << MatrixYaml(sequence_.lidar_model().T_event_lidar, true, "");
    }
    out << "cam0:\n" << CameraInChain("left", sequence_.options().T_event_imu, 0);
    if (T_right_left_) {
      out << "cam1:\n  T_cn_cnm1:\n" << MatrixYaml(*T_right_left_, true, "  ");
      out << CameraInChain("right", *T_right_left_ * sequence_.options().T_event_imu,
                           camera_.fx() * T_right_left_->translation().x());
    }
    return out.str();
  }

  /// `shift`: the fourth number of the projection matrix, fx times the baseline.
  std::string CameraInChain(const std::string& side, const Rigid3& T_cam_imu, double shift) const {
    std::ostringstream out;
    out << "  T_cam_imu:\n" << MatrixYaml(T_cam_imu, true, "  ");
    // Kalibr calls ROS's plumb_bob with four coefficients radtan.
    std::vector<double> coefficients = camera_.coefficients();
    const bool plumb_bob = camera_.distortion() == DistortionModel::kPlumbBob;
    if (plumb_bob) coefficients.resize(4);
    out << "  cam_overlaps: "
        << (!T_right_left_   ? "[]"
            : side == "left" ? "[1]"
                             : "[0]")
        << "\n  camera_model: pinhole\n  distortion_coeffs: " << Numbers(coefficients)
        << "\n  distortion_model: " << (plumb_bob ? "radtan" : sim::DistortionName(camera_))
        << "\n  intrinsics: " << Numbers({camera_.fx(), camera_.fy(), camera_.cx(), camera_.cy()})
        << "\n  projection_matrix:\n  - " << Numbers({camera_.fx(), 0, camera_.cx(), shift}) << "\n  - "
        << Numbers({0, camera_.fy(), camera_.cy(), 0})
        << "\n  - [0, 0, 1, 0]\n  rectification_matrix:\n  - [1, 0, 0]\n  - [0, 1, 0]\n  - [0, 0, 1]\n  resolution: ["
        << camera_.width() << ", " << camera_.height() << "]\n  rostopic: /davis/" << side << "/image_raw\n";
    return out.str();
  }

  /// Rectified coordinates of every raw pixel, one image row per line.
  void WriteMaps(const std::string& prefix) {
    std::ostringstream x_text, y_text;
    for (int y = 0; y < camera_.height(); ++y) {
      for (int x = 0; x < camera_.width(); ++x) {
        const auto ray = camera_.Unproject({x, y});
        const char* end = x + 1 < camera_.width() ? " " : "\n";
        x_text << (ray ? camera_.fx() * ray->x() + camera_.cx() : -1) << end;
        y_text << (ray ? camera_.fy() * ray->y() + camera_.cy() : -1) << end;
      }
    }
    WriteSimText(prefix + "x_map.txt", x_text.str());
    WriteSimText(prefix + "y_map.txt", y_text.str());
    files_.push_back(prefix + "x_map.txt");
    files_.push_back(prefix + "y_map.txt");
  }

  cv::Mat1f Rectified(const cv::Mat1f& raw) const {
    cv::Mat1f rectified(raw.rows, raw.cols, 0.0F);
    for (int y = 0; y < raw.rows; ++y) {
      for (int x = 0; x < raw.cols; ++x) {
        const auto u = camera_.Project({(x - camera_.cx()) / camera_.fx(), (y - camera_.cy()) / camera_.fy(), 1});
        if (u && camera_.Contains(*u)) {
          rectified(y, x) = raw(static_cast<int>(std::lround(u->y())), static_cast<int>(std::lround(u->x())));
        }
      }
    }
    return rectified;
  }

  const sim::Sequence& sequence_;
  const Camera camera_;  // of both: they are of one kind
  std::optional<Rigid3> T_right_left_;
  SimBag data_, gt_;
  int poses_ = 0;
};

/// VECtor: one bz2 bag per topic; calibration in yaml/ beside them, as the data set's site has it.
class VectorWriter : public SimBagWriter {
 public:
  VectorWriter(const std::string& stem, const sim::Sequence& sequence) : sequence_(sequence), stem_(stem) {
    if (sequence.options().frames && !sequence.options().regular_camera) {
      throw std::invalid_argument(
          "the vector dialect has frames of a regular camera of its own; expected regular_camera, or no frames");
    }
    if (sequence.rig().depth_registered) {
      throw std::invalid_argument(
          "the vector dialect has depth from a Kinect of its own; expected depth `kinect` or `exact`");
    }
    Open("left_event");
    Open("gt");
    if (sequence.options().depth != sim::SequenceOptions::Depth::kNone) Open("kinect_depth");
    if (sequence.options().frames) Open("left_camera");
    if (sequence.options().imu) Open("imu");
    if (sequence.options().lidar) Open("lidar");
    const std::string directory = FolderOf(stem) + "yaml/";
    MakeOutputFolder(directory);
    WriteCalibration(directory);
  }

  void Write(const sim::Chunk& chunk) override {
    WriteEvents<PropheseeName>(chunk, sequence_.rig().event_camera, "/prophesee/left/events", "left_event_camera",
                               &bags_.at("left_event"));
    for (const auto& depth : chunk.depth) {
      bags_.at("kinect_depth")
          .Write("/kinect/depth_image", SimStamp(depth.t_ns), ToDepthMsg(depth, "16UC1", "rgbd_depth_camera"));
    }
    for (const auto& frame : chunk.frames) {
      bags_.at("left_camera")
          .Write("/camera/left/image_mono", SimStamp(frame.t_ns), ToFrameMsg(frame, "left_regular_camera"));
    }
    for (const auto& sample : chunk.imu) {
      bags_.at("imu").Write("/imu/data", SimStamp(sample.t_ns), ToImuMsg(sample, "imu"));
    }
    for (const auto& scan : chunk.scans) {
      bags_.at("lidar").Write("/ouster/point_cloud", SimStamp(scan.t_ns),
                              ToPointCloudMsg(scan, "lidar", PointLayout::kOuster));
    }
    for (const auto& pose : chunk.poses) {
      bags_.at("gt").Write("/gt/pose", SimStamp(pose.t_ns),
                           ToPoseMsg(pose.t_ns, pose.T_world_event * T_body_event_.inverse(), "world"));
    }
  }

  void Close() override {
    for (auto& bag : bags_) bag.second.Close();
  }

 private:
  void Open(const std::string& what) {
    const std::string path = stem_ + ".synced." + what + ".bag";
    bags_[what].Open(path, rosbag::compression::BZ2);
    files_.push_back(path);
  }

  void Add(const std::string& path, const std::string& text) {
    WriteSimText(path, text);
    files_.push_back(path);
  }

  static std::string CameraYaml(const Camera& c, const std::string& name) {
    std::ostringstream out;
    // VECtor labels the Kinect's eight coefficients plumb_bob, too.
    out << std::setprecision(12) << "image_width: " << c.width() << "\nimage_height: " << c.height()
        << "\ncamera_name: " << name << "\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: "
        << Numbers({c.fx(), 0, c.cx(), 0, c.fy(), c.cy(), 0, 0, 1})
        << "\ncamera_model: " << (c.distortion() == DistortionModel::kEquidistant ? "equidistant" : "plumb_bob")
        << "\ndistortion_coefficients:\n  rows: 1\n  cols: " << c.coefficients().size()
        << "\n  data: " << Numbers(c.coefficients())
        << "\nrectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
        << "projection_matrix:\n  rows: 3\n  cols: 4\n  data: "
        << Numbers({c.fx(), 0, c.cx(), 0, 0, c.fy(), c.cy(), 0, 0, 0, 1, 0}) << '\n';
    return out.str();
  }

  void WriteCalibration(const std::string& directory) {
    const Rig& rig = sequence_.rig();
    const std::string indent(17, ' ');
    Add(directory + "left_event_camera_intrinsic_results.yaml", CameraYaml(rig.event_camera, "left_event_camera"));
    Add(directory + "left_regular_camera_intrinsic_results.yaml",
        CameraYaml(sequence_.regular_camera_model().camera, "left_regular_camera"));
    Add(directory + "rgbd_depth_camera_factory_intrinsic_results.yaml",
        CameraYaml(rig.depth_camera, "rgbd_depth_camera"));
    // Any colour camera will do as a link of the chain; this one stands as the Kinect's does.
    const Rigid3 T_color_depth(ExpSO3({-0.096, 0, 0}), {-0.0313, -0.0017, -0.0123});
    const Rigid3 T_event_cam0 = sequence_.regular_camera_model().T_event_camera, T_cam0_event = T_event_cam0.inverse();
    const Rigid3 T_cam0_color = T_cam0_event * rig.T_event_depth * T_color_depth.inverse();
    const Rigid3 T_body_cam0 = T_body_event_ * T_event_cam0;
    Add(directory + "rgbd_camera_calibrated_extrinsic_results.yaml",
        "camera_number: 2\ncam0:\n  camera_name: rgbd_color_camera\ncam1:\n  camera_name: rgbd_depth_camera\n  "
        "T_cam0_cam1: " +
            MatrixYaml(T_color_depth, false, indent));
    Add(directory + "small_scale_joint_camera_extrinsic_results.yaml",
        "camera_number: 5\ncam0:\n  camera_name: left_regular_camera\ncam2:\n  camera_name: left_event_camera\n  "
        "T_cam0_cam2: " +
            MatrixYaml(T_cam0_event, false, indent) +
            "cam4:\n  camera_name: rgbd_color_camera\n  T_cam0_cam4: " + MatrixYaml(T_cam0_color, false, indent));
    if (sequence_.options().lidar) {
      Add(directory + "camera_lidar_extrinsic_results.yaml",
          "camera_number: 2\ncam1:\n  camera_name: left_regular_camera\n  T_cam_lidar: " +
              MatrixYaml(T_cam0_event * sequence_.lidar_model().T_event_lidar, false, indent));
    }
    if (sequence_.options().imu) {
      Add(directory + "small_scale_camera_imu_extrinsic_results1.yaml",
          "camera_number: 1\ncam0:\n  T_cam_imu:\n" +
              MatrixYaml(T_cam0_event * sequence_.options().T_event_imu, true, "  ") +
              "  rostopic: /camera/left/image_mono\n");
    }
    Add(directory + "camera_mocap_extrinsic_results1.yaml",
        "camera_number: 1\ncam0:\n  camera_name: left_regular_camera\n  T_body_cam: " +
            MatrixYaml(T_body_cam0, false, indent) +
            "  T_cam_body: " + MatrixYaml(T_body_cam0.inverse(), false, indent));
  }

  const sim::Sequence& sequence_;
  std::string stem_;
  std::map<std::string, SimBag> bags_;
  /// Markers of the motion capture sit on a frame of their own above the cameras.
  const Rigid3 T_body_event_ = Rigid3(ExpSO3({0.1, 2.6, -0.2}), {0.063, -0.028, 0.070});
};

}  // namespace

std::unique_ptr<SimBagWriter> MakeMvsecWriter(const std::string& stem, const sim::Sequence& sequence,
                                              const sim::Sequence* right) {
  return std::make_unique<MvsecWriter>(stem, sequence, right);
}

std::unique_ptr<SimBagWriter> MakeVectorWriter(const std::string& stem, const sim::Sequence& sequence) {
  return std::make_unique<VectorWriter>(stem, sequence);
}

}  // namespace devo
