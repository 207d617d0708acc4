// SPDX-License-Identifier: BSD-3-Clause
#include "yaml.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include "devo/io/rig_config.h"

namespace devo {
namespace {

std::string OneLine(std::string text) {
  for (char& c : text) {
    if (c == '\n') c = ' ';
  }
  return text;
}

// The layout of camera_calibration_parsers (REP-104 in yaml), as image_proc and the data sets write it.
Camera CameraInfoLayout(const YAML::Node& node, const YamlPlace& place) {
  RejectUnknownKeys(node, place,
                    {"image_width", "image_height", "camera_name", "frame_id", "camera_matrix", "camera_model",
                     "distortion_model", "distortion_coefficients", "rectification_matrix", "projection_matrix"});
  const auto K = YamlNumbers(node["camera_matrix"], place.Under("camera_matrix"));
  if (K.size() != 9) place.Under("camera_matrix").Fail("expected 9 numbers, got " + std::to_string(K.size()));
  const char* model_key = node["distortion_model"] ? "distortion_model" : "camera_model";
  const YAML::Node D = node["distortion_coefficients"];
  return {YamlScalar<int>(node["image_width"], place.Under("image_width"), "a whole number of pixels"),
          YamlScalar<int>(node["image_height"], place.Under("image_height"), "a whole number of pixels"),
          K[0],
          K[4],
          K[2],
          K[5],
          YamlScalar<std::string>(node[model_key], place.Under(model_key), "the name of a distortion model"),
          D ? YamlNumbers(D, place.Under("distortion_coefficients")) : std::vector<double>()};
}

Camera ShortLayout(const YAML::Node& node, const YamlPlace& place) {
  RejectUnknownKeys(
      node, place,
      {"width", "height", "fx", "fy", "cx", "cy", "distortion_model", "distortion_coefficients", "frame_id"});
  const auto number = [&](const char* key) { return YamlScalar<double>(node[key], place.Under(key), "a number (px)"); };
  const YAML::Node model = node["distortion_model"], D = node["distortion_coefficients"];
  return {YamlScalar<int>(node["width"], place.Under("width"), "a whole number of pixels"),
          YamlScalar<int>(node["height"], place.Under("height"), "a whole number of pixels"),
          number("fx"),
          number("fy"),
          number("cx"),
          number("cy"),
          model ? YamlScalar<std::string>(model, place.Under("distortion_model"), "a name") : "none",
          D ? YamlNumbers(D, place.Under("distortion_coefficients")) : std::vector<double>()};
}

}  // namespace

void RejectUnknownKeys(const YAML::Node& node, const YamlPlace& place, const std::set<std::string>& known) {
  for (const auto& entry : node) {
    const auto key = entry.first.as<std::string>();
    if (known.count(key) > 0) continue;
    std::string names;
    for (const std::string& name : known) names += (names.empty() ? "" : ", ") + name;
    place.Under(key).Fail("unknown key, expected one of: " + names);
  }
}

YAML::Node ParseYaml(const std::string& text, const std::string& name) {
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& e) {
    throw std::invalid_argument(name + ": not valid yaml: " + OneLine(e.what()));
  }
}

YAML::Node LoadYamlFile(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  if (!file || !(text << file.rdbuf())) {
    throw std::invalid_argument("'" + path + "': cannot be read, expected a yaml file");
  }
  return ParseYaml(text.str(), path);
}

std::string DirectoryOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::string ResolvePath(const std::string& base, const std::string& path) {
  return base.empty() || path.empty() || path.front() == '/' ? path : base + "/" + path;
}

std::vector<double> YamlNumbers(const YAML::Node& node, const YamlPlace& place) {
  if (!node.IsDefined() || node.IsNull()) place.Fail("missing, expected a list of numbers");
  if (node.IsMap() && node["data"]) return YamlNumbers(node["data"], place.Under("data"));
  if (!node.IsSequence()) place.Fail("expected a list of numbers");
  std::vector<double> numbers;
  for (const YAML::Node& item : node) {
    if (item.IsSequence()) {
      for (const double value : YamlNumbers(item, place)) numbers.push_back(value);
    } else {
      numbers.push_back(YamlScalar<double>(item, place, "numbers"));
    }
  }
  return numbers;
}

Rigid3 YamlTransform(const YAML::Node& node, const YamlPlace& place) {
  if (node.IsMap() && (node["translation"] || node["quaternion"])) {
    RejectUnknownKeys(node, place, {"translation", "quaternion"});
    const auto t = YamlNumbers(node["translation"], place.Under("translation"));
    const auto q = YamlNumbers(node["quaternion"], place.Under("quaternion"));
    if (t.size() != 3) place.Under("translation").Fail("expected [x, y, z] in metres");
    if (q.size() != 4) place.Under("quaternion").Fail("expected [x, y, z, w]");
    const Eigen::Quaterniond rotation(q[3], q[0], q[1], q[2]);
    if (!(std::abs(rotation.norm() - 1) < 1e-2))
      place.Under("quaternion").Fail("expected a unit quaternion [x, y, z, w]");
    Rigid3 T(rotation, {t[0], t[1], t[2]});
    if (!T.IsFinite()) place.Fail("expected finite numbers");
    return T;
  }
  const auto numbers = YamlNumbers(node, place);
  if (numbers.size() != 16) {
    place.Fail("expected a 4x4 matrix (16 numbers, row-major) or {translation, quaternion}, got " +
               std::to_string(numbers.size()) + " numbers");
  }
  try {
    return Rigid3::FromMatrix(Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data()));
  } catch (const std::invalid_argument& e) {
    place.Fail(e.what());
  }
}

Camera YamlCamera(const YAML::Node& node, const YamlPlace& place, const std::string& directory) {
  if (!node.IsMap()) place.Fail("expected a camera: {width, height, fx, fy, cx, cy, ...}, camera_info or {file: PATH}");
  if (node["file"]) {
    RejectUnknownKeys(node, place, {"file"});
    return ReadCameraFile(ResolvePath(directory, YamlScalar<std::string>(node["file"], place.Under("file"), "a path")));
  }
  try {
    return node["camera_matrix"] || node["image_width"] ? CameraInfoLayout(node, place) : ShortLayout(node, place);
  } catch (const std::invalid_argument& e) {
    const std::string message = e.what();
    if (message.rfind(place.file + ":", 0) == 0) throw;  // it names its place already
    place.Fail(message);
  }
}

}  // namespace devo
