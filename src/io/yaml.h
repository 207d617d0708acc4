// SPDX-License-Identifier: BSD-3-Clause
//
// What the readers of yaml files share. Internal to io: public headers do not show yaml-cpp.
#pragma once

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Where a value stands, for messages: "rig.yaml: T_event_depth".
struct YamlPlace {
  std::string file;
  std::string key;

  YamlPlace Under(const std::string& name) const { return {file, key.empty() ? name : key + "." + name}; }
  [[noreturn]] void Fail(const std::string& problem) const {
    throw std::invalid_argument(file + ": " + (key.empty() ? "" : "key '" + key + "': ") + problem);
  }
};

/// The parsed file. Throws std::invalid_argument naming the file: missing, or yaml's own complaint with the line.
YAML::Node LoadYamlFile(const std::string& path);
YAML::Node ParseYaml(const std::string& text, const std::string& name);

/// `base` is a directory, "" for the current one; absolute paths stay.
std::string ResolvePath(const std::string& base, const std::string& path);
std::string DirectoryOf(const std::string& path);

template <typename T>
T YamlScalar(const YAML::Node& node, const YamlPlace& place, const char* expected) {
  if (!node.IsDefined() || node.IsNull()) place.Fail(std::string("missing, expected ") + expected);
  try {
    return node.as<T>();
  } catch (const YAML::Exception&) {
    place.Fail(std::string("expected ") + expected + (node.IsScalar() ? ", got '" + node.Scalar() + "'" : ""));
  }
}

/// Numbers of a sequence, of {rows, cols, data} or of a sequence of rows, flattened row-major.
std::vector<double> YamlNumbers(const YAML::Node& node, const YamlPlace& place);

/// Throws naming the first key of the map `node` that is not among `known`, and those.
void RejectUnknownKeys(const YAML::Node& node, const YamlPlace& place, const std::set<std::string>& known);

Rigid3 YamlTransform(const YAML::Node& node, const YamlPlace& place);
Camera YamlCamera(const YAML::Node& node, const YamlPlace& place, const std::string& directory);

}  // namespace devo
