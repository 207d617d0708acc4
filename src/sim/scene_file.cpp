// SPDX-License-Identifier: BSD-3-Clause
#include <initializer_list>
#include <map>
#include <optional>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

#include "devo/sim/scene.h"

namespace devo::sim {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180;

/// A yaml node that knows its place in the file, for messages.
class Entry {
 public:
  Entry(const YAML::Node& node, std::string where) : node_(node), where_(std::move(where)) {}

  [[noreturn]] void Fail(const std::string& what) const { throw std::invalid_argument(where_ + ": " + what); }

  /// Every key must be one of these.
  void ExpectKeys(std::initializer_list<const char*> known) const {
    if (!node_.IsMap()) Fail("expected a map");
    for (const auto& item : node_) {
      const auto key = item.first.as<std::string>();
      bool found = false;
      std::string list;
      for (const char* k : known) {
        found = found || key == k;
        list += (list.empty() ? "" : ", ") + std::string(k);
      }
      if (!found) Fail("key '" + key + "' is not known; expected one of " + list);
    }
  }

  bool Has(const std::string& key) const { return static_cast<bool>(node_[key]); }
  Entry At(const std::string& key) const { return {node_[key], where_ + ": " + key}; }
  std::vector<Entry> List(const std::string& key) const {
    std::vector<Entry> entries;
    if (!Has(key)) return entries;
    if (!node_[key].IsSequence()) Fail("'" + key + "' should be a list");
    for (std::size_t i = 0; i < node_[key].size(); ++i) {
      entries.emplace_back(node_[key][i], where_ + ": " + key + "[" + std::to_string(i) + "]");
    }
    return entries;
  }

  template <typename T>
  T Get(const std::string& key) const {
    if (!Has(key)) Fail("key '" + key + "' is missing");
    try {
      return node_[key].as<T>();
    } catch (const YAML::Exception&) {
      Fail("key '" + key + "' has a value of the wrong kind");
    }
  }
  template <typename T>
  T Get(const std::string& key, const T& otherwise) const {
    return Has(key) ? Get<T>(key) : otherwise;
  }
  Eigen::Vector3d Vector(const std::string& key) const {
    const auto v = Get<std::vector<double>>(key);
    if (v.size() != 3) Fail("key '" + key + "' should be three numbers [x, y, z]");
    return {v[0], v[1], v[2]};
  }
  Eigen::Vector3d Vector(const std::string& key, const Eigen::Vector3d& otherwise) const {
    return Has(key) ? Vector(key) : otherwise;
  }

 private:
  YAML::Node node_;
  std::string where_;
};

class SceneReader {
 public:
  SceneReader(const std::string& path, const YAML::Node& root) : root_(root, "scene file '" + path + "'") {}

  Scene Read() {
    root_.ExpectKeys(
        {"name", "ambient_lux", "materials", "room", "planes", "quads", "boxes", "cylinders", "lamps", "motion"});
    scene_.name = root_.Get<std::string>("name", "user");
    scene_.ambient_lux = root_.Get("ambient_lux", 50.0);
    for (const auto& m : root_.List("materials")) ReadMaterial(m);
    if (root_.Has("room")) {
      const Entry room = root_.At("room");
      room.ExpectKeys({"min", "max", "floor", "ceiling", "wall"});
      scene_.AddRoom(room.Vector("min"), room.Vector("max"), Named(room, "floor"), Named(room, "ceiling"),
                     Named(room, "wall"));
    }
    for (const char* kind : {"planes", "quads"}) {
      for (const auto& q : root_.List(kind)) ReadQuad(q);
    }
    for (const auto& b : root_.List("boxes")) {
      b.ExpectKeys({"position", "yaw_deg", "size", "material", "sway"});
      scene_.AddBox(Upright(b), b.Vector("size"), Named(b, "material"), SwayOf(b));
    }
    for (const auto& c : root_.List("cylinders")) {
      c.ExpectKeys({"position", "yaw_deg", "radius", "height", "material", "sway"});
      scene_.AddCylinder(Upright(c), c.Get<double>("radius"), c.Get<double>("height"), Named(c, "material"), SwayOf(c));
    }
    for (const auto& l : root_.List("lamps")) ReadLamp(l);
    ReadMotion(root_.At("motion"));
    if (scene_.surfaces().empty())
      root_.Fail("no surface; expected at least one of room, planes, quads, boxes, cylinders");
    return std::move(scene_);
  }

 private:
  void ReadMaterial(const Entry& m) {
    m.ExpectKeys({"name", "texture", "size_m", "reflectance", "infrared", "seed"});
    Material material;
    try {
      material.texture =
          scene_.AddTexture(Texture::Make(m.Get<std::string>("texture"), m.Get<std::uint64_t>("seed", 1)));
    } catch (const std::invalid_argument& e) {
      m.Fail(e.what());
    }
    material.texture_size_m = m.Get("size_m", 1.0);
    material.reflectance = m.Get("reflectance", 1.0);
    material.infrared = m.Get("infrared", 0.85);
    if (!(material.texture_size_m > 0)) m.Fail("size_m should be > 0");
    materials_[m.Get<std::string>("name")] = material;
  }

  Material Named(const Entry& e, const std::string& key) const {
    const auto name = e.Get<std::string>(key);
    const auto found = materials_.find(name);
    if (found == materials_.end()) e.Fail("material '" + name + "' is not among `materials`");
    return found->second;
  }

  static Rigid3 Upright(const Entry& e) { return {ExpSO3({0, 0, e.Get("yaw_deg", 0.0) * kDeg}), e.Vector("position")}; }

  static std::optional<Sway> SwayOf(const Entry& thing) {
    if (!thing.Has("sway")) return std::nullopt;
    const Entry e = thing.At("sway");
    e.ExpectKeys({"by", "period_s", "begins_s"});
    Sway sway;
    sway.by = e.Vector("by");
    sway.period_s = e.Get("period_s", sway.period_s);
    sway.begins_s = e.Get("begins_s", sway.begins_s);
    if (!(sway.period_s > 0)) e.Fail("period_s should be > 0");
    return sway;
  }

  /// A rectangle from a corner and two perpendicular sides.
  void ReadQuad(const Entry& q) {
    q.ExpectKeys({"corner", "side_u", "side_v", "material"});
    const Eigen::Vector3d u = q.Vector("side_u"), v = q.Vector("side_v");
    if (!(u.norm() > 0 && v.norm() > 0) || std::abs(u.normalized().dot(v.normalized())) > 1e-6) {
      q.Fail("side_u and side_v should be perpendicular and longer than 0");
    }
    Eigen::Matrix3d R;
    R << u.normalized(), v.normalized(), u.normalized().cross(v.normalized());
    scene_.AddRectangle({Eigen::Quaterniond(R), q.Vector("corner")}, u.norm(), v.norm(), Named(q, "material"));
  }

  void ReadLamp(const Entry& l) {
    l.ExpectKeys({"position", "intensity_cd", "radius_m", "direction", "cone_deg"});
    Lamp lamp;
    lamp.position = l.Vector("position");
    lamp.intensity_cd = l.Get("intensity_cd", 100.0);
    lamp.radius_m = l.Get("radius_m", 0.1);
    lamp.direction = l.Vector("direction", -Eigen::Vector3d::UnitZ());
    lamp.cone_deg = l.Get("cone_deg", 180.0);
    scene_.lamps.push_back(lamp);
  }

  void ReadMotion(const Entry& m) {
    if (!root_.Has("motion")) root_.Fail("key 'motion' is missing");
    m.ExpectKeys({"position_min", "position_max", "target_min", "target_max"});
    scene_.motion = {m.Vector("position_min"), m.Vector("position_max"), m.Vector("target_min"),
                     m.Vector("target_max")};
    if ((scene_.motion.position_max - scene_.motion.position_min).minCoeff() < 0 ||
        (scene_.motion.target_max - scene_.motion.target_min).minCoeff() < 0) {
      m.Fail("a minimum is above its maximum");
    }
  }

  Entry root_;
  Scene scene_;
  std::map<std::string, Material> materials_;
};

}  // namespace

Scene LoadScene(const std::string& path) {
  YAML::Node root;
  try {
    root = YAML::LoadFile(path);
  } catch (const YAML::Exception& e) {
    throw std::invalid_argument("scene file '" + path + "': " + e.what());
  }
  if (!root.IsMap()) throw std::invalid_argument("scene file '" + path + "': expected a map of keys");
  return SceneReader(path, root).Read();
}

}  // namespace devo::sim
