// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/bag_validation.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <sensor_msgs/Imu.h>
#include <std_msgs/Header.h>
#include <Eigen/Core>

#include "devo/core/imu.h"
#include "devo/core/median.h"
#include "devo/core/time.h"
#include "devo/io/evaluation.h"
#include "devo/ros/bag_file.h"
#include "devo/ros/bag_reader.h"
#include "devo/ros/bag_runs.h"
#include "devo/ros/conversions.h"
#include "devo/ros/deserialise.h"
#include "devo/ros/message_conversion.h"

namespace devo {
namespace {

template <typename Message>
bool Is(const BagTopic& topic) {
  return topic.md5 == ros::message_traits::MD5Sum<Message>::value();
}

__attribute__((format(printf, 1, 2))) std::string Format(const char* format, ...) {
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return text;
}

/// What the stamps of one topic look like.
struct Stamps {
  std::size_t messages = 0, falling = 0, repeated = 0;
  std::int64_t first_ns = 0, last_ns = 0, longest_gap_ns = 0, gap_at_ns = 0;

  void Add(std::int64_t t_ns) { Add(t_ns, t_ns); }
  /// A message that holds the time from `begin_ns` to `end_ns`.
  void Add(std::int64_t begin_ns, std::int64_t end_ns) {
    if (messages++ == 0) {
      first_ns = begin_ns;
    } else {
      falling += begin_ns < last_ns;
      repeated += begin_ns == last_ns;
      if (begin_ns - last_ns > longest_gap_ns) {
        longest_gap_ns = begin_ns - last_ns;
        gap_at_ns = last_ns;
      }
    }
    last_ns = std::max(last_ns, end_ns);
  }
  double rate_hz() const {
    return messages > 1 && last_ns > first_ns ? static_cast<double>(messages - 1) / SecondsFromNs(last_ns - first_ns)
                                              : 0;
  }
};

class Validator {
 public:
  Validator(const std::vector<std::string>& paths, const std::optional<RigConfig>& config)
      : paths_(paths), config_(config), bags_(OpenBags(paths)) {}

  BagValidation Validate() {
    ListTopics();
    const bool guessed = !config_;
    if (guessed) GuessTopics();
    for (const auto& bag : bags_) {
      if (!bag->defect().empty()) Problem(bag->defect() + "; record again or run `rosbag reindex`");
    }
    CheckEvents();
    config_->depth_from_lidar() ? CheckPoints() : CheckDepth();
    CheckOverlap();
    CheckImu();
    CheckGroundTruth();
    CheckCalibration();
    Say("\n");
    for (const std::string& warning : warnings_) Say("WARNING: " + warning + "\n");
    for (const std::string& problem : problems_) Say("PROBLEM: " + problem + "\n");
    if (problems_.empty()) Say("The odometry can use this recording.\n");
    if (guessed) ProposeYaml();
    return {text_, problems_.size()};
  }

 private:
  void Say(const std::string& text) { text_ += text; }
  void Problem(const std::string& text) { problems_.push_back(text); }
  void Warn(const std::string& text) { warnings_.push_back(text); }

  template <typename Visit>
  void ForEachMessage(const std::string& topic, Visit&& visit) {
    for (const BagRun& run : RunsOf(bags_, topic)) {
      for (const BagMessage& message : run.messages) {
        const ByteSpan bytes = message.bag->Read(message.entry);
        if (bytes.data != nullptr && !visit(message.topic(), bytes)) return;
      }
    }
  }

  void ListTopics() {
    for (const auto& bag : bags_) {
      std::vector<std::size_t> counts(bag->topics().size());
      for (const BagEntry& entry : bag->entries()) ++counts[entry.topic];
      Say(bag->path() + "\n");
      for (std::size_t i = 0; i < counts.size(); ++i) {
        const BagTopic& topic = bag->topics()[i];
        Say(Format("  %-40s %7zu x %s\n", topic.name.c_str(), counts[i], topic.type.c_str()));
        count_of_[topic.name] += counts[i];
        topics_[topic.name] = topic;
      }
    }
  }

  /// The topic with the most messages among those that `suits`; empty when there is none.
  template <typename Suits>
  std::string Busiest(Suits&& suits) const {
    std::string best;
    for (const auto& entry : topics_) {
      if (suits(entry.second) && (best.empty() || count_of_.at(entry.first) > count_of_.at(best))) best = entry.first;
    }
    return best;
  }

  /// Without type when no bag holds the topic.
  BagTopic TypeOf(const std::string& topic) const {
    const auto found = topics_.find(topic);
    return found != topics_.end() ? found->second : BagTopic();
  }

  std::string FrameOf(const std::string& topic) {
    std::string frame;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      frame = Deserialise<std_msgs::Header>(bytes).frame_id;
      return false;
    });
    return frame;
  }

  std::string EncodingOf(const std::string& topic) {
    std::string encoding;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      encoding = Deserialise<sensor_msgs::Image>(bytes).encoding;
      return false;
    });
    return encoding;
  }

  std::string InfoBeside(const std::string& topic) const {
    const std::string info = SiblingCameraInfo(topic);
    const auto found = topics_.find(info);
    return found != topics_.end() && Is<sensor_msgs::CameraInfo>(found->second) ? info : "";
  }

  void GuessTopics() {
    config_.emplace();
    Topics& topics = config_->topics;
    topics.events = Busiest([](const BagTopic& t) { return Is<EventArray>(t) || Is<EventPacket>(t); });
    topics.depth = Busiest([this](const BagTopic& t) {
      if (!Is<sensor_msgs::Image>(t)) return false;
      const std::string encoding = EncodingOf(t.name);
      return encoding == "16UC1" || encoding == "32FC1";
    });
    if (topics.depth.empty()) {
      topics.points = Busiest([](const BagTopic& t) { return Is<sensor_msgs::PointCloud2>(t); });
    }
    topics.imu = Busiest([](const BagTopic& t) { return Is<sensor_msgs::Imu>(t); });
    topics.ground_truth = Busiest([](const BagTopic& t) {
      return t.type == "geometry_msgs/PoseStamped" || t.type == "nav_msgs/Odometry" ||
             t.type == "geometry_msgs/TransformStamped";
    });
    topics.event_camera_info = InfoBeside(topics.events);
    topics.depth_camera_info = InfoBeside(topics.depth);
  }

  void DescribeStamps(const std::string& name, const Stamps& stamps) {
    Say(Format("%s: %.1f messages per second from %.3f s to %.3f s, longest gap %.0f ms\n", name.c_str(),
               stamps.rate_hz(), SecondsFromNs(stamps.first_ns), SecondsFromNs(stamps.last_ns),
               1e3 * SecondsFromNs(stamps.longest_gap_ns)));
  }

  bool CheckTopic(const char* key, const std::string& topic, bool right_type, const char* types) {
    if (topic.empty()) {
      Problem(std::string("no topic of type ") + types + " is there (key '" + key + "')");
    } else if (topics_.count(topic) == 0) {
      Problem("topic '" + topic + "' (key '" + key + "') is in none of the bags; set it to one of those listed above");
    } else if (!right_type) {
      Problem("topic '" + topic + "' (key '" + key + "') has type " + TypeOf(topic).type + ", expected " + types);
    } else {
      return true;
    }
    return false;
  }

  void CheckEvents() {
    const std::string& topic = config_->topics.events;
    const BagTopic type = TypeOf(topic);
    if (!CheckTopic("topics.events", topic, Is<EventArray>(type) || Is<EventPacket>(type), kEventTypes)) {
      return;
    }
    EventPacketConverter packets;
    std::vector<Event> events;
    std::map<std::int64_t, std::size_t> per_tenth;
    std::size_t count = 0, on = 0, falling = 0, far_stamps = 0;
    int width = 0, height = 0;
    std::int64_t last_ns = 0;
    ForEachMessage(topic, [&](const BagTopic& t, const ByteSpan& bytes) {
      events.clear();
      try {
        if (Is<EventPacket>(t)) {
          packets.Append(Deserialise<EventPacket>(bytes), &events);
        } else {
          AppendSerializedEvents(bytes.data, bytes.size, &events);
        }
      } catch (const std::exception& e) {
        Problem("topic '" + topic + "' (key 'topics.events'): " + e.what());
        return false;
      }
      if (events.empty()) return true;
      const std::int64_t stamp_ns = FromRosTime(Deserialise<std_msgs::Header>(bytes).stamp);
      far_stamps += std::abs(stamp_ns - events.back().t_ns) > NsFromSeconds(1);
      event_stamps_.Add(events.front().t_ns, events.back().t_ns);
      for (const Event& event : events) {
        falling += event.t_ns < last_ns;
        last_ns = event.t_ns;
        on += event.polarity;
        width = std::max(width, event.x + 1);
        height = std::max(height, event.y + 1);
        ++per_tenth[event.t_ns / 100000000];
      }
      count += events.size();
      return true;
    });
    if (count == 0) {
      Problem("topic '" + topic + "' (key 'topics.events') holds no events");
      return;
    }
    event_columns_ = width;
    event_rows_ = height;
    Say("\n");
    DescribeStamps("events " + topic, event_stamps_);
    std::size_t busiest = 0;
    for (const auto& tenth : per_tenth) busiest = std::max(busiest, tenth.second);
    const double span_s = std::max(1e-9, SecondsFromNs(event_stamps_.last_ns - event_stamps_.first_ns));
    Say(Format("  %zu events, %.0f %% ON, x to %d, y to %d; %.2f Mev/s on average, %.2f in the busiest 0.1 s\n", count,
               100.0 * static_cast<double>(on) / static_cast<double>(count), width - 1, height - 1,
               1e-6 * static_cast<double>(count) / span_s, 1e-5 * static_cast<double>(busiest)));
    SayRateOverTime(per_tenth, busiest);
    if (falling > 0) Warn(Format("%zu events are earlier than the one before and will be dropped", falling));
    if (far_stamps > 0) Warn("header.stamp of the event arrays is more than 1 s from their events (it is not used)");
    if (event_stamps_.longest_gap_ns > NsFromSeconds(0.5)) {
      Warn(Format("no events for %.2f s at %.3f s: the camera stood still or messages were lost",
                  SecondsFromNs(event_stamps_.longest_gap_ns), SecondsFromNs(event_stamps_.gap_at_ns)));
    }
    if (on == 0 || on == count) Warn("all events have the same polarity");
  }

  void SayRateOverTime(const std::map<std::int64_t, std::size_t>& per_tenth, std::size_t busiest) {
    constexpr std::size_t kColumns = 60;
    const std::int64_t first = per_tenth.begin()->first;
    const std::size_t tenths = static_cast<std::size_t>(per_tenth.rbegin()->first - first) + 1;
    if (tenths > 1000000) return;  // stamps that jump; said elsewhere
    const std::size_t per_column = (tenths + kColumns - 1) / kColumns;
    std::vector<double> columns((tenths + per_column - 1) / per_column);
    for (const auto& tenth : per_tenth) {
      columns[static_cast<std::size_t>(tenth.first - first) / per_column] += static_cast<double>(tenth.second);
    }
    const std::string levels = " .:-=+*#%@";
    std::string line;
    for (const double value : columns) {
      const double share = value / static_cast<double>(per_column) / static_cast<double>(busiest);
      line += levels[static_cast<std::size_t>(std::ceil(share * static_cast<double>(levels.size() - 1)))];
    }
    Say(Format("  rate over time |%s| %.1f s per column\n", line.c_str(), 0.1 * static_cast<double>(per_column)));
  }

  void CheckDepth() {
    const std::string& topic = config_->topics.depth;
    if (!CheckTopic("topics.depth", topic, Is<sensor_msgs::Image>(TypeOf(topic)), "sensor_msgs/Image (16UC1 or 32FC1)"))
      return;
    std::map<std::string, std::size_t> encodings;
    std::size_t empty = 0;
    double valid_share = 0;
    std::vector<float> medians;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      const auto image = Deserialise<sensor_msgs::Image>(bytes);
      depth_stamps_.Add(FromRosTime(image.header.stamp) + NsFromSeconds(config_->depth_time_offset_s));
      const std::string size = std::to_string(image.width) + "x" + std::to_string(image.height);
      ++encodings[size + " " + image.encoding];
      depth_columns_ = static_cast<int>(image.width);
      depth_rows_ = static_cast<int>(image.height);
      try {
        AddValidPixels(ToDepthImage(image, config_->depth_scale), &valid_share, &medians, &empty);
      } catch (const std::runtime_error& e) {
        unusable_ = e.what();
      }
      return true;
    });
    if (depth_stamps_.messages == 0) {
      Problem("topic '" + topic + "' (key 'topics.depth') holds no readable message");
      return;
    }
    DescribeStamps("depth " + topic, depth_stamps_);
    for (const auto& encoding : encodings) Say(Format("  %zu images %s\n", encoding.second, encoding.first.c_str()));
    if (!unusable_.empty()) Problem("topic '" + topic + "': " + unusable_);
    DescribeDepth(topic, valid_share, medians, empty);
    if (depth_stamps_.falling + depth_stamps_.repeated > 0) {
      Warn(Format("%zu depth images are not later than the one before and will be dropped",
                  depth_stamps_.falling + depth_stamps_.repeated));
    }
    if (depth_stamps_.longest_gap_ns > NsFromSeconds(1.5)) {
      Warn(Format("no depth for %.2f s at %.3f s", SecondsFromNs(depth_stamps_.longest_gap_ns),
                  SecondsFromNs(depth_stamps_.gap_at_ns)));
    }
  }

  /// A LiDAR in place of a depth camera.
  void CheckPoints() {
    const std::string& topic = config_->topics.points;
    if (!CheckTopic("topics.points", topic, Is<sensor_msgs::PointCloud2>(TypeOf(topic)), "sensor_msgs/PointCloud2"))
      return;
    std::string fields;
    std::size_t points = 0, without_ring = 0;
    double longest_s = 0;
    std::vector<float> ranges;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      const auto cloud = Deserialise<sensor_msgs::PointCloud2>(bytes);
      fields.clear();
      for (const auto& field : cloud.fields) fields += " " + field.name;
      try {
        const LidarSweep sweep =
            ToLidarSweep(cloud, config_->points_turn_s, NsFromSeconds(config_->depth_time_offset_s));
        depth_stamps_.Add(sweep.end_ns);
        points += sweep.points.size();
        for (const LidarPoint& point : sweep.points) {
          without_ring += point.ring < 0;
          longest_s = std::max(longest_s, SecondsFromNs(sweep.end_ns - point.t_ns));
        }
        if (!sweep.points.empty()) ranges.push_back(sweep.points[sweep.points.size() / 2].p_lidar.norm());
      } catch (const std::runtime_error& e) {
        unusable_ = e.what();
      }
      return true;
    });
    if (!unusable_.empty()) Problem("topic '" + topic + "': " + unusable_);
    if (points == 0) {
      if (unusable_.empty()) Problem("topic '" + topic + "' (key 'topics.points') holds no points");
      return;
    }
    DescribeStamps("LiDAR " + topic, depth_stamps_);
    Say(Format("  %zu sweeps of %zu points on average, fields%s; the points of a sweep span %.0f ms\n",
               depth_stamps_.messages, points / depth_stamps_.messages, fields.c_str(), 1e3 * longest_s));
    if (longest_s == 0) {
      Warn("the points carry no times: a moving LiDAR's sweeps stay distorted; give the duration of a turn (key " +
           std::string("'points_turn_s')"));
    }
    if (without_ring > 0) Warn("the points name no ring: no depth between them, expected a field 'ring' or 'line'");
    if (depth_stamps_.longest_gap_ns > NsFromSeconds(1.5)) {
      Warn(Format("no points for %.2f s at %.3f s", SecondsFromNs(depth_stamps_.longest_gap_ns),
                  SecondsFromNs(depth_stamps_.gap_at_ns)));
    }
  }

  void AddValidPixels(const DepthImage& depth, double* valid_share, std::vector<float>* medians,
                      std::size_t* empty) const {
    const MappingOptions& options = config_->odometry.mapping;
    std::vector<float> valid;
    for (const float z_m : depth.depth_m) {
      if (ValidDepthOrZero(z_m, static_cast<float>(options.min_depth_m), static_cast<float>(options.max_depth_m)) > 0)
        valid.push_back(z_m);
    }
    *valid_share += static_cast<double>(valid.size()) / static_cast<double>(depth.depth_m.total());
    if (valid.empty()) {
      ++*empty;
      return;
    }
    medians->push_back(Median(std::move(valid)));
  }

  void DescribeDepth(const std::string& topic, double valid_share, const std::vector<float>& medians,
                     std::size_t empty) {
    if (medians.empty()) {
      if (unusable_.empty()) {
        Problem("no image of topic '" + topic +
                "' has a valid pixel between mapping.min_depth_m and mapping.max_depth_m");
      }
      return;
    }
    const auto range = std::minmax_element(medians.begin(), medians.end());
    Say(Format("  %.0f %% of the pixels valid, median depth from %.2f to %.2f m\n",
               100 * valid_share / static_cast<double>(depth_stamps_.messages), *range.first, *range.second));
    if (empty > 0) Warn(Format("%zu depth images have no valid pixel", empty));
    if (*range.second > 50 || *range.first < 0.05) {
      Warn("depths are unlikely for a room: 16UC1 is read as millimetres, 32FC1 as metres (key 'depth_scale')");
    }
  }

  void CheckOverlap() {
    if (event_stamps_.messages == 0 || depth_stamps_.messages == 0) return;
    const std::int64_t begin_ns = std::max(event_stamps_.first_ns, depth_stamps_.first_ns);
    const std::int64_t end_ns = std::min(event_stamps_.last_ns, depth_stamps_.last_ns);
    if (end_ns <= begin_ns) {
      Problem(
          Format("events and depth do not overlap in time: their clocks differ by about %.3f s; set key "
                 "'depth_time_offset_s' (events - depth)",
                 SecondsFromNs(event_stamps_.first_ns - depth_stamps_.first_ns)));
      return;
    }
    const double share =
        static_cast<double>(end_ns - begin_ns) / static_cast<double>(event_stamps_.last_ns - event_stamps_.first_ns);
    Say(Format("events and depth overlap for %.2f s, %.0f %% of the events' time\n", SecondsFromNs(end_ns - begin_ns),
               100 * share));
    if (share < 0.5) Warn("events and depth overlap for less than half of the events' time");
  }

  void CheckImu() {
    const std::string& topic = config_->topics.imu;
    if (topic.empty()) return;
    if (topics_.count(topic) == 0 || !Is<sensor_msgs::Imu>(topics_[topic])) {
      Warn("topic '" + topic + "' (key 'topics.imu') " +
           (topics_.count(topic) == 0 ? "is in none of the bags" : "has type " + topics_[topic].type) +
           ": the odometry runs without it; expected sensor_msgs/Imu");
      return;
    }
    Stamps stamps;
    double acceleration = 0, fastest_rad_s = 0;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      const auto sample = Deserialise<sensor_msgs::Imu>(bytes);
      stamps.Add(FromRosTime(sample.header.stamp) + NsFromSeconds(config_->imu_time_offset_s));
      const auto& a = sample.linear_acceleration;
      const auto& w = sample.angular_velocity;
      acceleration += Eigen::Vector3d(a.x, a.y, a.z).norm();
      fastest_rad_s = std::max(fastest_rad_s, Eigen::Vector3d(w.x, w.y, w.z).norm());
      return true;
    });
    DescribeStamps("IMU " + topic, stamps);
    acceleration /= static_cast<double>(std::max<std::size_t>(1, stamps.messages));
    Say(Format("  acceleration %.2f m/s^2 on average, turns up to %.2f rad/s\n", acceleration, fastest_rad_s));
    if (acceleration > 0.5 && acceleration < 2)
      Warn("the IMU's accelerations look like multiples of g, expected m/s^2");
    if (fastest_rad_s > 35) Warn("the IMU's turns look like degrees, expected rad/s (its driver's units)");
    if (stamps.falling > 0) Warn(Format("%zu IMU samples are earlier than the one before", stamps.falling));
    if (stamps.longest_gap_ns > kMaxImuGap_ns) {
      Warn(Format("no IMU samples for %.2f s at %.3f s", SecondsFromNs(stamps.longest_gap_ns),
                  SecondsFromNs(stamps.gap_at_ns)));
    }
    const bool apart = stamps.last_ns < event_stamps_.first_ns || stamps.first_ns > event_stamps_.last_ns;
    if (event_stamps_.messages > 0 && apart) {
      Warn("the IMU and the events do not overlap in time: their clocks differ, the IMU will not be used");
    }
  }

  void CheckGroundTruth() {
    const std::string& topic = config_->topics.ground_truth;
    if (topic.empty()) return;
    if (topics_.count(topic) == 0) {
      Warn("topic '" + topic + "' (key 'topics.ground_truth') is in none of the bags: no errors will be reported");
      return;
    }
    Stamps stamps;
    ForEachMessage(topic, [&](const BagTopic&, const ByteSpan& bytes) {
      stamps.Add(FromRosTime(Deserialise<std_msgs::Header>(bytes).stamp));
      return true;
    });
    DescribeStamps("ground truth " + topic, stamps);
    const double max_gap_s = EvaluationOptions().max_gap_s;
    if (SecondsFromNs(stamps.longest_gap_ns) > max_gap_s)
      Warn(Format("ground truth has gaps over %.1f s: poses there are not evaluated", max_gap_s));
  }

  /// Where a piece of the calibration comes from, as BagReader takes it.
  std::string SourceOf(bool configured, const std::string& otherwise) const {
    if (!configured) return otherwise;
    return config_->calibration.path.empty() ? "configuration" : config_->calibration.path;
  }

  void CheckCalibration() {
    if (!problems_.empty()) return;  // the rig cannot be read without the topics
    try {
      BagReader reader(paths_, *config_);
      const Rig rig = reader.ReadRig();
      reader.Next();  // takes the first messages of each topic as the odometry would, an IMU's in the event frame
      const Camera& camera = rig.event_camera;
      Say(Format(
          "event camera %dx%d, f %.1f %.1f, c %.1f %.1f, %zu distortion coefficients (%s)\n", camera.width(),
          camera.height(), camera.fx(), camera.fy(), camera.cx(), camera.cy(), camera.coefficients().size(),
          SourceOf(config_->event_camera.has_value(), "CameraInfo on " + config_->topics.event_camera_info).c_str()));
      if (event_columns_ > camera.width() || event_rows_ > camera.height()) {
        Problem(Format("events reach x %d, y %d, outside the event camera's %dx%d: its calibration is another camera's",
                       event_columns_ - 1, event_rows_ - 1, camera.width(), camera.height()));
      }
      if (config_->T_event_imu && !config_->topics.imu.empty()) {
        DescribePose("IMU", *config_->T_event_imu, SourceOf(true, ""));
      }
      if (rig.depth_from_lidar) {
        DescribePose("LiDAR", rig.T_event_depth, SourceOf(config_->T_event_depth.has_value(), "/tf_static"));
        return;
      }
      const Camera& depth = rig.depth_camera;
      if (!rig.depth_registered) {
        DescribePose(Format("depth camera %dx%d, f %.1f %.1f;", depth.width(), depth.height(), depth.fx(), depth.fy()),
                     rig.T_event_depth,
                     SourceOf(config_->depth_camera.has_value(), "CameraInfo on " + config_->topics.depth_camera_info) +
                         "; " + SourceOf(config_->T_event_depth.has_value(), "/tf_static"));
      }
      constexpr double kCoarsest = 8;
      const double ratio = camera.fx() / depth.fx();
      if (ratio > kCoarsest) {
        Warn(Format(
            "the depth camera's pixels are %.0f times as large as the event camera's, expected at most %.0f times: "
            "few edges will find a depth",
            ratio, kCoarsest));
      }
      if (depth_columns_ != depth.width() || depth_rows_ != depth.height()) {
        Problem(Format("depth images are %dx%d, their camera's calibration %dx%d", depth_columns_, depth_rows_,
                       depth.width(), depth.height()));
      }
    } catch (const std::exception& e) {
      Problem(e.what());
    }
  }

  void DescribePose(const std::string& sensor, const Rigid3& T_event_sensor, const std::string& source) {
    const Eigen::Vector3d& p = T_event_sensor.translation();
    Say(sensor + Format(" at (%.3f, %.3f, %.3f) m in the event camera's frame, turned by %.1f deg (%s)\n", p.x(), p.y(),
                        p.z(), RotationAngle(T_event_sensor) * 57.29578, source.c_str()));
    if (p.norm() > 1) Warn("the sensors are more than 1 m apart: are the extrinsics in metres?");
  }

  void ProposeYaml() {
    const Topics& t = config_->topics;
    Say("\nA yaml to begin with:\n\ntopics:\n");
    const bool lidar = config_->depth_from_lidar();
    Say("  events: " + t.events + "\n  event_camera_info: \"" + t.event_camera_info + "\"\n" +
        (lidar ? "  points: " + t.points
               : "  depth: " + t.depth + "\n  depth_camera_info: \"" + t.depth_camera_info + "\"") +
        "\n  imu: \"" + t.imu + "\"\n  ground_truth: \"" + t.ground_truth + "\"\n");
    if (t.event_camera_info.empty())
      Say("event_camera: {}   # width, height, fx, fy, cx, cy, distortion_model, distortion_coefficients\n");
    if (!lidar && t.depth_camera_info.empty()) Say("depth_camera: {}   # the same\n");
    ProposePoses();
  }

  /// What neither the frames' names nor tf says.
  void ProposePoses() {
    const Topics& t = config_->topics;
    const bool lidar = config_->depth_from_lidar(), tf = topics_.count("/tf_static") > 0;
    const std::string events = FrameOf(t.events), imu = FrameOf(t.imu);
    if (!lidar && !events.empty() && events == FrameOf(t.depth)) {
      Say("registered: true   # events and depth name the same frame\n");
    } else if (!tf) {
      Say(lidar ? "T_event_depth: {}  # 16 numbers: the LiDAR's pose\n"
                : "T_event_depth: {}  # 16 numbers, or `registered: true`\n");
    }
    if (!tf && !imu.empty() && imu != events) {  // no frame: the event camera's
      Say("T_event_imu: {}  # 16 numbers: the IMU's pose; without it, set `imu: \"\"`\n");
    }
  }

  std::vector<std::string> paths_;
  std::optional<RigConfig> config_;
  std::vector<std::unique_ptr<BagFile>> bags_;
  std::map<std::string, BagTopic> topics_;
  std::map<std::string, std::size_t> count_of_;
  Stamps event_stamps_, depth_stamps_;
  int event_columns_ = 0, event_rows_ = 0, depth_columns_ = 0, depth_rows_ = 0;
  std::string unusable_;
  std::string text_;
  std::vector<std::string> problems_, warnings_;
};

}  // namespace

BagValidation ValidateBags(const std::vector<std::string>& paths, const std::optional<RigConfig>& config) {
  return Validator(paths, config).Validate();
}

}  // namespace devo
