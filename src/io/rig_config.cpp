// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/rig_config.h"

#include <algorithm>
#include <map>
#include <sstream>
#include <stdexcept>

#include "devo/io/dataset_calibration.h"
#include "yaml.h"

namespace devo {
namespace {

/// The groups that are read as one value each, with what they are, for the documentation.
const std::map<std::string, std::string>& ValueGroups() {
  static const std::map<std::string, std::string> groups = {
      {"event_camera", "intrinsics; else CameraInfo of topics.event_camera_info; else an error"},
      {"depth_camera",
       "intrinsics; else CameraInfo of topics.depth_camera_info; else an error; not needed when registered or with a "
       "LiDAR"},
      {"T_event_depth",
       "pose of the depth camera, or of the LiDAR, in the event camera's frame; else tf_static; else an error; not "
       "needed when "
       "registered"},
      {"T_event_imu",
       "pose of the IMU in the event camera's frame; else tf_static from the IMU's frame to the event camera's, or to "
       "the depth's and then T_event_depth; else its samples are left out"},
      {"T_body_event",
       "event camera's pose in the frame of the body whose pose ground truth is, where that is another"}};
  return groups;
}

std::size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

std::string NearestKnownKey(const std::string& key) {
  std::vector<std::string> known;
  const auto collect = [&](const char* name, const auto&...) { known.emplace_back(name); };
  const RigConfig defaults;
  VisitRig(defaults, collect);
  VisitOptions(defaults.odometry, collect);
  for (const auto& group : ValueGroups()) known.push_back(group.first);
  return *std::min_element(known.begin(), known.end(), [&](const std::string& a, const std::string& b) {
    return EditDistance(key, a) < EditDistance(key, b);
  });
}

/// Takes its value from `settings` and removes it there, once per visited key.
struct Assign {
  std::map<std::string, YAML::Node>* settings;
  std::string file;

  template <typename T, typename... Rest>
  void operator()(const char* key, T& value, const Rest&... rest) const {
    const auto found = settings->find(key);
    if (found == settings->end()) return;
    Set(found->second, {file, key}, &value, rest...);
    settings->erase(found);
  }

 private:
  template <typename T>
  static void Set(const YAML::Node& node, const YamlPlace& place, T* value, T min, T max, const char*) {
    const T read = YamlScalar<T>(node, place, std::is_integral<T>::value ? "a whole number" : "a number");
    std::ostringstream range;
    range << "is " << read << ", expected a number from " << min << " to " << max;
    if (!(read >= min && read <= max)) place.Fail(range.str());  // negated: NaN fails, too
    *value = read;
  }
  static void Set(const YAML::Node& node, const YamlPlace& place, bool* value, const char*) {
    *value = YamlScalar<bool>(node, place, "true or false");
  }
  static void Set(const YAML::Node& node, const YamlPlace& place, std::string* value, const char*) {
    *value = YamlScalar<std::string>(node, place, "a text");
  }
  static void Set(const YAML::Node& node, const YamlPlace& place, std::string* value, const char* choices,
                  const char*) {
    const auto read = YamlScalar<std::string>(node, place, "a name");
    const std::vector<std::string> names = SplitChoices(choices);
    if (std::find(names.begin(), names.end(), read) == names.end()) {
      std::string expected;
      for (const std::string& name : names) expected += (expected.empty() ? "'" : " or '") + name + "'";
      place.Fail("is '" + read + "', expected " + expected);
    }
    *value = read;
  }
};

void Flatten(const YAML::Node& node, const YamlPlace& place, std::map<std::string, YAML::Node>* leaves) {
  for (const auto& entry : node) {
    const YamlPlace here = place.Under(entry.first.as<std::string>());
    if (entry.second.IsMap() && ValueGroups().count(here.key) == 0) {
      Flatten(entry.second, here, leaves);
    } else if (!leaves->emplace(here.key, entry.second).second) {
      here.Fail("given twice");
    }
  }
}

/// Removes and returns the value of a group; undefined when it is not there or empty.
YAML::Node TakeGroup(const std::string& key, std::map<std::string, YAML::Node>* settings) {
  const auto found = settings->find(key);
  if (found == settings->end()) return YAML::Node(YAML::NodeType::Undefined);
  const YAML::Node node = found->second;
  settings->erase(found);
  const bool empty = node.IsNull() || ((node.IsMap() || node.IsSequence()) && node.size() == 0);
  return empty ? YAML::Node(YAML::NodeType::Undefined) : node;
}

void ApplyNode(const YAML::Node& root, const std::string& name, const std::string& directory, RigConfig* config) {
  if (!root.IsDefined() || root.IsNull()) return;
  if (!root.IsMap()) YamlPlace{name, ""}.Fail("expected a map of keys");
  std::map<std::string, YAML::Node> settings;
  Flatten(root, {name, ""}, &settings);
  for (auto* camera : {&config->event_camera, &config->depth_camera}) {
    const std::string key = camera == &config->event_camera ? "event_camera" : "depth_camera";
    const YAML::Node node = TakeGroup(key, &settings);
    if (node.IsDefined()) *camera = YamlCamera(node, {name, key}, directory);
  }
  const std::pair<const char*, std::optional<Rigid3>*> transforms[] = {{"T_event_depth", &config->T_event_depth},
                                                                       {"T_event_imu", &config->T_event_imu},
                                                                       {"T_body_event", &config->T_body_event}};
  for (const auto& [key, transform] : transforms) {
    const YAML::Node node = TakeGroup(key, &settings);
    if (node.IsDefined()) *transform = YamlTransform(node, {name, key});
  }
  const bool names_files = settings.count("calibration.path") > 0;
  const Assign assign{&settings, name};
  VisitRig(*config, assign);
  VisitOptions(config->odometry, assign);
  if (names_files) config->calibration.path = ResolvePath(directory, config->calibration.path);
  if (settings.empty()) return;
  const std::string& key = settings.begin()->first;
  throw std::invalid_argument(name + ": unknown key '" + key + "'; nearest known key: '" + NearestKnownKey(key) + "'");
}

void ApplyOverride(const std::string& text, RigConfig* config) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw std::invalid_argument("--set " + text + ": expected key=value");
  }
  const std::string name = "--set " + text;
  const std::string key = text.substr(0, equals);
  YAML::Node node = ParseYaml(text.substr(equals + 1), name);
  if (node.IsNull()) node = YAML::Node("");
  // From the last part of the key outwards: a.b=1 is {a: {b: 1}}.
  for (std::size_t end = key.size();;) {
    const std::size_t dot = key.rfind('.', end - 1);
    const std::size_t begin = dot == std::string::npos ? 0 : dot + 1;
    YAML::Node outer;
    outer[key.substr(begin, end - begin)] = node;
    node = outer;
    if (dot == std::string::npos || dot == 0) break;
    end = dot;
  }
  ApplyNode(node, name, "", config);
}

void FillFromCalibrationFiles(RigConfig* config) {
  if (config->calibration.format.empty()) return;
  if (config->calibration.path.empty()) {
    throw std::invalid_argument("key 'calibration.path' is missing: calibration.format is '" +
                                config->calibration.format + "', expected where its files are");
  }
  const DatasetCalibration read = config->calibration.format == "vector"
                                      ? ReadVectorCalibration(config->calibration.path)
                                      : ReadMvsecCalibration(config->calibration.path);
  if (!config->event_camera) config->event_camera = read.event_camera;
  if (!config->depth_camera) config->depth_camera = read.depth_camera;
  if (!config->T_event_depth) {
    config->T_event_depth = config->depth_from_lidar() ? read.T_event_lidar : read.T_event_depth;
  }
  if (!config->T_event_imu) {
    config->T_event_imu = config->depth_from_lidar() ? read.T_event_imu_of_lidar_rig : read.T_event_imu;
  }
  if (!config->T_body_event) config->T_body_event = read.T_body_event;
}

template <typename T>
std::string Text(const T& value) {
  std::ostringstream text;
  text << std::boolalpha << value;
  return text.str();
}

/// One row of the table per visited key.
struct Row {
  std::ostringstream* out;

  template <typename T, typename... Rest>
  void operator()(const char* key, const T& value, const Rest&... rest) const {
    const std::string shown = Text(value);
    *out << "| `" << key << "` | " << (shown.empty() ? "" : "`" + shown + "`") << " | ";
    Finish(value, rest...);
  }

 private:
  template <typename T>
  void Finish(const T&, const T& min, const T& max, const char* meaning) const {
    *out << min << " to " << max << " | " << meaning << " |\n";
  }
  void Finish(bool, const char* meaning) const { *out << "true, false | " << meaning << " |\n"; }
  void Finish(const std::string&, const char* meaning) const { *out << " | " << meaning << " |\n"; }
  void Finish(const std::string&, const char* choices, const char* meaning) const {
    std::string names;
    for (const std::string& name : SplitChoices(choices)) {
      if (!name.empty()) names += (names.empty() ? "" : ", ") + name;
    }
    *out << names << " | " << meaning << " |\n";
  }
};

constexpr char kTableHead[] = "| key | default | range | meaning |\n|---|---|---|---|\n";

}  // namespace

void ApplyYaml(const std::string& text, const std::string& name, const std::string& directory, RigConfig* config) {
  ApplyNode(ParseYaml(text, name), name, directory, config);
}

RigConfig LoadRigConfig(const std::vector<std::string>& yaml_paths, const std::vector<std::string>& overrides) {
  RigConfig config;
  for (const std::string& path : yaml_paths) ApplyNode(LoadYamlFile(path), path, DirectoryOf(path), &config);
  for (const std::string& text : overrides) ApplyOverride(text, &config);
  Validate(config.odometry);  // what only all keys together show
  FillFromCalibrationFiles(&config);
  return config;
}

Camera ReadCameraFile(const std::string& path) { return YamlCamera(LoadYamlFile(path), {path, ""}, DirectoryOf(path)); }

std::string Describe(const RigConfig& config) {
  std::ostringstream out;
  const auto line = [&](const char* key, const auto& value, const auto&...) {
    out << key << ": " << Text(value) << '\n';
  };
  VisitRig(config, line);
  VisitOptions(config.odometry, line);
  return out.str();
}

std::string ParametersMarkdown() {
  std::ostringstream out;
  out << "# Parameters\n\nMade by `devo_offline --print-parameters` from the code; do not edit.\n\n"
      << "Keys of a rig's yaml. A dot is a level: `surface.rate_hz: 100` is `surface: {rate_hz: 100}`. Unknown keys "
         "and\n"
      << "values out of range are errors. Several files may be given, later ones override earlier ones, and\n"
      << "`--set key=value` overrides all files.\n\n## Rig\n\n"
      << kTableHead;
  const RigConfig defaults;
  VisitRig(defaults, Row{&out});
  for (const auto& group : ValueGroups()) out << "| `" << group.first << "` |  |  | " << group.second << " |\n";
  out << "\nCameras are `{width, height, fx, fy, cx, cy, distortion_model, distortion_coefficients}`, the layout of "
         "ROS\n"
      << "camera_info files, or `{file: PATH}` of one, relative to the yaml. Transformations are 16 numbers row-major "
         "or\n"
      << "`{translation: [x, y, z], quaternion: [x, y, z, w]}`; `T_a_b` maps points of frame b to frame a, metres.\n\n"
      << "## Odometry\n\n"
      << kTableHead;
  VisitOptions(defaults.odometry, Row{&out});
  return out.str();
}

}  // namespace devo
