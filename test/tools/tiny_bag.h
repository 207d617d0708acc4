// SPDX-License-Identifier: BSD-3-Clause
//
// Bags of a second with known motion, made in the test: a wall of dark discs one metre away, seen by a camera that
// moves sideways from rest to rest. Events are the closed-form crossings of the discs' soft rims.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>

#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"

namespace devo {

struct TinyScene {
  int width = 240, height = 180;
  double f_px = 200, wall_m = 1;
  double way_x_m = 0.24, way_y_m = 0.16;  // of the camera, along the wall
  double duration_s = 1.0;
  std::int64_t begin_ns = 100000000000;

  /// Share of the way that is gone: rises from 0 at rest to 1 at rest.
  double Share(double t_s) const {
    const double s = std::min(1.0, std::max(0.0, t_s / duration_s));
    return s * s * (3 - 2 * s);
  }
  double TimeOfShare(double share) const {
    double low = 0, high = duration_s;
    for (int i = 0; i < 40; ++i) (Share((low + high) / 2) < share ? low : high) = (low + high) / 2;
    return low;
  }
  Rigid3 PoseAt(double t_s) const { return Rigid3::Translation({way_x_m * Share(t_s), way_y_m * Share(t_s), 0}); }
};

/// Events of each pixel that a disc's rim passes: OFF where a dark disc comes, ON where it goes. The rim's brightness
/// crosses the sensor's threshold several times.
inline std::vector<Event> EventsOf(const TinyScene& scene) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> anywhere_x(-20, 300), anywhere_y(-20, 240), radius(7, 20);
  // The whole way of the image, px.
  const Eigen::Vector2d way(-scene.f_px / scene.wall_m * scene.way_x_m, -scene.f_px / scene.wall_m * scene.way_y_m);
  std::vector<Event> events;
  const auto add = [&](double share, int x, int y, bool on) {
    if (!(share > 0 && share < 1)) return;
    Event event;
    event.t_ns = scene.begin_ns + std::llround(1e6 * scene.TimeOfShare(share)) * 1000;
    event.x = static_cast<std::uint16_t>(x);
    event.y = static_cast<std::uint16_t>(y);
    event.polarity = on ? 1 : 0;
    events.push_back(event);
  };
  for (int disc = 0; disc < 40; ++disc) {
    const Eigen::Vector2d centre(anywhere_x(random), anywhere_y(random));
    const double rim = radius(random);
    for (const double level : {-0.75, -0.25, 0.25, 0.75}) {
      const double r = rim + level;
      for (int y = 0; y < scene.height; ++y) {
        for (int x = 0; x < scene.width; ++x) {
          // |pixel - centre - share * way| = r
          const Eigen::Vector2d d = Eigen::Vector2d(x, y) - centre;
          const double a = way.squaredNorm(), b = d.dot(way), c = d.squaredNorm() - r * r;
          if (b * b - a * c <= 0) continue;
          const double root = std::sqrt(b * b - a * c);
          add((b - root) / a, x, y, false);
          add((b + root) / a, x, y, true);
        }
      }
    }
  }
  std::stable_sort(events.begin(), events.end(), IsEarlier);
  return events;
}

inline sensor_msgs::Image DepthOf(const TinyScene& scene, std::int64_t t_ns, std::uint16_t millimetres) {
  sensor_msgs::Image image;
  image.header.stamp = ToRosTime(t_ns);
  image.header.frame_id = "depth_optical";
  image.width = static_cast<std::uint32_t>(scene.width);
  image.height = static_cast<std::uint32_t>(scene.height);
  image.encoding = sensor_msgs::image_encodings::TYPE_16UC1;
  image.step = 2 * image.width;
  for (std::uint32_t i = 0; i < image.width * image.height; ++i) {
    image.data.push_back(static_cast<std::uint8_t>(millimetres & 0xFF));
    image.data.push_back(static_cast<std::uint8_t>(millimetres >> 8));
  }
  return image;
}

inline sensor_msgs::CameraInfo InfoOf(const TinyScene& scene, const std::string& frame) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = frame;
  info.header.stamp = ToRosTime(scene.begin_ns);
  info.width = static_cast<std::uint32_t>(scene.width);
  info.height = static_cast<std::uint32_t>(scene.height);
  info.distortion_model = "plumb_bob";
  info.K = {scene.f_px, 0, 0.5 * (scene.width - 1), 0, scene.f_px, 0.5 * (scene.height - 1), 0, 0, 1};
  return info;
}

/// Messages of a whole recording, by topic; tests break them before they write them.
struct TinyRecording {
  TinyScene scene;
  std::vector<EventArray> events;                               // /events, 10 ms each
  std::vector<sensor_msgs::Image> depth;                        // /depth, 20 Hz
  std::vector<sensor_msgs::CameraInfo> event_info, depth_info;  // /event_info, /depth_info
  std::vector<geometry_msgs::PoseStamped> truth;                // /truth, 100 Hz
  std::vector<tf2_msgs::TFMessage> transforms;                  // /tf_static
  std::vector<sensor_msgs::Imu> imu;                            // /imu, without unless a test adds samples

  explicit TinyRecording(const TinyScene& scene_in = {}) : scene(scene_in) {
    const std::vector<Event> all = EventsOf(scene);
    auto begin = all.begin();
    for (int i = 1; i <= 100 * scene.duration_s; ++i) {
      const std::int64_t t_ns = scene.begin_ns + i * 10000000LL;
      const auto end = std::find_if(begin, all.end(), [&](const Event& e) { return e.t_ns >= t_ns; });
      if (begin != end) {
        events.push_back(ToEventArrayMsg(EventSpan(&*begin, static_cast<std::size_t>(end - begin)), scene.width,
                                         scene.height, "event_optical"));
      }
      begin = end;
      geometry_msgs::PoseStamped pose;
      pose.header.stamp = ToRosTime(t_ns);
      pose.pose = ToPoseMsg(scene.PoseAt(0.01 * i));
      truth.push_back(pose);
      if (i % 5 == 1) depth.push_back(DepthOf(scene, t_ns, static_cast<std::uint16_t>(1000 * scene.wall_m)));
    }
    event_info.push_back(InfoOf(scene, "event_optical"));
    depth_info.push_back(InfoOf(scene, "depth_optical"));
    tf2_msgs::TFMessage transform;
    transform.transforms.resize(1);
    transform.transforms[0].header.frame_id = "event_optical";
    transform.transforms[0].child_frame_id = "depth_optical";
    transform.transforms[0].transform.rotation.w = 1;
    transforms.push_back(transform);
  }

  /// At rest, 100 Hz; of no frame, which is the event camera's.
  void AddImu() {
    for (int i = 1; i <= 100 * scene.duration_s; ++i) {
      sensor_msgs::Imu sample;
      sample.header.stamp = ToRosTime(scene.begin_ns + i * 10000000LL);
      sample.linear_acceleration.y = -9.8;
      imu.push_back(sample);
    }
  }

  void Write(const std::string& path, rosbag::compression::CompressionType compression = rosbag::compression::LZ4,
             std::uint32_t chunk_bytes = 64 << 10) const {
    rosbag::Bag bag(path, rosbag::bagmode::Write);
    bag.setCompression(compression);
    bag.setChunkThreshold(chunk_bytes);
    const ros::Time begin = ToRosTime(scene.begin_ns);
    for (const auto& m : transforms) bag.write("/tf_static", begin, m);
    for (const auto& m : event_info) bag.write("/event_info", begin, m);
    for (const auto& m : depth_info) bag.write("/depth_info", begin, m);
    for (const auto& m : imu) bag.write("/imu", Recorded(m.header.stamp), m);
    // In the order of recording, as a recorder would.
    std::size_t d = 0, p = 0;
    for (const auto& m : events) {
      for (; d < depth.size() && depth[d].header.stamp <= m.header.stamp; ++d)
        bag.write("/depth", Recorded(depth[d].header.stamp), depth[d]);
      for (; p < truth.size() && truth[p].header.stamp <= m.header.stamp; ++p)
        bag.write("/truth", Recorded(truth[p].header.stamp), truth[p]);
      bag.write("/events", Recorded(m.header.stamp), m);
    }
    for (; d < depth.size(); ++d) bag.write("/depth", Recorded(depth[d].header.stamp), depth[d]);
    for (; p < truth.size(); ++p) bag.write("/truth", Recorded(truth[p].header.stamp), truth[p]);
  }

 private:
  static ros::Time Recorded(const ros::Time& stamp) { return std::max(stamp, ros::TIME_MIN); }
};

struct ProgramResult {
  int status = -1;
  std::string out, err;
};

/// Runs one of the package's programs with `arguments` as a shell would.
inline ProgramResult RunProgram(const std::string& name, const std::string& arguments) {
  const std::string out = ::testing::TempDir() + "devo_program.out", err = ::testing::TempDir() + "devo_program.err";
  const int status =
      std::system((std::string(DEVO_BIN_DIR) + "/" + name + " " + arguments + " >" + out + " 2>" + err).c_str());
  const auto contents = [](const std::string& path) {
    std::stringstream text;
    text << std::ifstream(path).rdbuf();
    std::remove(path.c_str());
    return text.str();
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, contents(out), contents(err)};
}

}  // namespace devo
