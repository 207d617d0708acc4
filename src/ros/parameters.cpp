// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/parameters.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace devo {
namespace {

std::string Shown(const ros::NodeHandle& private_nh, const std::string& key) {
  return "parameter " + private_nh.resolveName(key);
}

[[noreturn]] void ThrowWrongType(const ros::NodeHandle& private_nh, const std::string& key, const char* expected) {
  throw std::invalid_argument(Shown(private_nh, key) + " is not " + expected);
}

template <typename T>
void RequireInRange(const ros::NodeHandle& private_nh, const std::string& key, T value, T min, T max) {
  if (value >= min && value <= max) return;
  std::ostringstream text;
  text << Shown(private_nh, key) << " is " << value << "; expected " << min << " to " << max;
  throw std::invalid_argument(text.str());
}

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) {
    if (!part.empty()) parts.push_back(part);
  }
  return parts;
}

std::vector<double> ReadNumbers(const ros::NodeHandle& private_nh, const std::string& key) {
  std::vector<double> numbers;
  if (private_nh.getParam(key, numbers)) return numbers;
  std::string text;
  if (!private_nh.getParam(key, text)) ThrowWrongType(private_nh, key, "a list of numbers");
  std::istringstream stream(text);
  for (double number = 0; stream >> number;) numbers.push_back(number);
  if (!stream.eof()) ThrowWrongType(private_nh, key, "a list of numbers");
  return numbers;
}

}  // namespace

std::string ReadString(const ros::NodeHandle& private_nh, const std::string& key, const std::string& fallback) {
  std::string value = fallback;
  if (private_nh.hasParam(key) && !private_nh.getParam(key, value)) ThrowWrongType(private_nh, key, "a string");
  return value;
}

bool ReadBool(const ros::NodeHandle& private_nh, const std::string& key, bool fallback) {
  bool value = fallback;
  if (private_nh.hasParam(key) && !private_nh.getParam(key, value)) ThrowWrongType(private_nh, key, "true or false");
  return value;
}

double ReadDouble(const ros::NodeHandle& private_nh, const std::string& key, double fallback, double min, double max) {
  double value = fallback;
  if (private_nh.hasParam(key) && !private_nh.getParam(key, value)) ThrowWrongType(private_nh, key, "a number");
  RequireInRange(private_nh, key, value, min, max);
  return value;
}

int ReadInt(const ros::NodeHandle& private_nh, const std::string& key, int fallback, int min, int max) {
  int value = fallback;
  if (private_nh.hasParam(key) && !private_nh.getParam(key, value)) ThrowWrongType(private_nh, key, "a whole number");
  RequireInRange(private_nh, key, value, min, max);
  return value;
}

std::string ReadPath(const ros::NodeHandle& private_nh, const std::string& key, const std::string& fallback) {
  std::string path = ReadString(private_nh, key, fallback);
  if (path.empty()) throw std::invalid_argument(Shown(private_nh, key) + " is empty; expected the path of a file");
  if (path.front() == '/') return path;
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  return (ros_home ? std::string(ros_home) : std::string(home ? home : "/tmp") + "/.ros") + "/" + path;
}

Rigid3 ReadPose(const ros::NodeHandle& private_nh, const std::string& key, const Rigid3& fallback) {
  if (!private_nh.hasParam(key)) return fallback;
  const std::vector<double> v = ReadNumbers(private_nh, key);
  const bool finite = std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
  if (v.size() == 7 && finite) {
    const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
    if (std::abs(q.norm() - 1) < 0.01) return {q, {v[0], v[1], v[2]}};
  }
  throw std::invalid_argument(Shown(private_nh, key) +
                              " is no pose; expected seven numbers, x y z qx qy qz qw, with a quaternion of length 1");
}

void RefuseUnknown(const ros::NodeHandle& private_nh, const std::vector<std::string>& known) {
  std::vector<std::string> all;
  private_nh.getParamNames(all);
  const std::string prefix = private_nh.getNamespace() + "/";
  for (const std::string& name : all) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string key = name.substr(prefix.size(), name.find('/', prefix.size()) - prefix.size());
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    std::string list;
    for (const std::string& k : known) list += (list.empty() ? "" : ", ") + k;
    throw std::invalid_argument("unknown parameter " + name + "; expected one of " + list);
  }
}

void RefuseSharedTopics(const Topics& topics) {
  const std::vector<std::pair<std::string, std::string>> by_key = {
      {"events", topics.events},
      {topics.points.empty() ? "depth" : "points", topics.points.empty() ? topics.depth : topics.points},
      {"imu", topics.imu},
      {"ground_truth", topics.ground_truth}};
  for (std::size_t a = 0; a < by_key.size(); ++a) {
    for (std::size_t b = a + 1; b < by_key.size(); ++b) {
      if (by_key[a].second.empty() || by_key[a].second != by_key[b].second) continue;
      throw std::invalid_argument("keys 'topics." + by_key[a].first + "' and 'topics." + by_key[b].first +
                                  "' both name " + by_key[a].second + ", expected a topic for each");
    }
  }
}

RigConfig ReadRigConfig(const ros::NodeHandle& private_nh) {
  const std::vector<std::string> paths = Split(ReadString(private_nh, "config", ""), ',');
  if (paths.empty()) {
    throw std::invalid_argument(Shown(private_nh, "config") + " is missing; expected the path of the rig's yaml");
  }
  try {
    RigConfig config = LoadRigConfig(paths, Split(ReadString(private_nh, "set", ""), ' '));
    RefuseSharedTopics(config.topics);
    return config;
  } catch (const std::exception& error) {
    throw std::invalid_argument(Shown(private_nh, "config") + ": " + error.what());
  }
}

std::string InputTopic(const ros::NodeHandle& nh, const std::string& name, const std::string& configured) {
  std::string remapped = nh.resolveName(name);
  if (remapped != nh.resolveName(name, false)) return remapped;
  return configured.empty() ? "" : nh.resolveName(configured);
}

}  // namespace devo
