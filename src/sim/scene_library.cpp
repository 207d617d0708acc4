// SPDX-License-Identifier: BSD-3-Clause
//
// The scenes that the paper's experiments are named after. Lengths in metres, z up, the floor at z = 0.
#include <cmath>
#include <stdexcept>

#include "devo/sim/random.h"
#include "devo/sim/scene.h"

namespace devo::sim {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180;

Rigid3 At(double x, double y, double z, double yaw_deg = 0) { return {ExpSO3({0, 0, yaw_deg * kDeg}), {x, y, z}}; }

/// An upright rectangle of the given width and height whose lower edge is centred at (x, y, z), seen from the side that
/// `yaw_deg` points to (0: +x), leaning back by `lean_deg`.
Rigid3 Upright(double x, double y, double z, double yaw_deg, double width, double lean_deg = 0) {
  Eigen::Matrix3d R;
  R.col(0) = Eigen::Vector3d::UnitY();
  R.col(1) = Eigen::Vector3d::UnitZ();
  R.col(2) = Eigen::Vector3d::UnitX();
  const Eigen::Quaterniond q =
      ExpSO3({0, 0, yaw_deg * kDeg}) * Eigen::Quaterniond(R) * ExpSO3({-lean_deg * kDeg, 0, 0});
  return {q, Eigen::Vector3d(x, y, z) - q * Eigen::Vector3d(0.5 * width, 0, 0)};
}

/// Textures of a scene by name, each made once per (name, seed).
class Palette {
 public:
  explicit Palette(Scene* scene) : scene_(scene) {}
  Material operator()(const std::string& texture, double size_m, double reflectance = 1, double infrared = 0.85,
                      std::uint64_t seed = 1) {
    return {scene_->AddTexture(Texture::Make(texture, seed)), size_m, reflectance, infrared};
  }

 private:
  Scene* scene_;
};

/// Boards of self-similar texture at several distances: structure at every scale, wherever the camera stands.
Scene Cali() {
  Scene s;
  s.name = "cali";
  Palette make(&s);
  const Material boards[3] = {make("dead_leaves", 1.2, 1, 0.85, 11), make("poster", 1.0, 1, 0.85, 12),
                              make("checker", 0.8)};
  s.AddRoom({-2.2, -2.5, 0}, {2.6, 2.5, 2.7}, make("tiles", 2.4, 0.7), make("plaster", 4),
            make("plaster", 3, 0.85, 0.9, 7));
  s.AddRectangle(Upright(1.60, 0.0, 0.55, 180, 1.6, 4), 1.6, 1.2, boards[0]);
  s.AddRectangle(Upright(1.25, 1.30, 0.45, 215, 1.0, 8), 1.0, 1.1, boards[1]);
  s.AddRectangle(Upright(1.15, -1.30, 0.50, 140, 1.0, 6), 1.0, 1.1, boards[2]);
  s.AddRectangle(Upright(2.58, 0.3, 1.70, 180, 2.6), 2.6, 0.9, boards[1]);
  s.AddRectangle(Upright(0.2, 2.48, 0.6, 270, 2.4), 2.4, 1.5, boards[0]);
  s.AddRectangle(Upright(0.2, -2.48, 0.6, 90, 2.4), 2.4, 1.5, boards[1]);
  s.AddBox(At(0.95, 0.35, 0, 25), {0.4, 0.5, 0.5}, boards[1]);
  s.AddBox(At(0.9, -0.55, 0, -15), {0.35, 0.35, 0.75}, boards[0]);
  s.AddCylinder(At(1.2, 0.75, 0), 0.13, 0.95, boards[0]);
  s.ambient_lux = 120;
  s.lamps = {{{-0.6, -0.8, 2.6}, 260, 0.25}, {{0.4, 1.4, 2.6}, 180, 0.25}};
  s.motion = {{-1.0, -0.7, 0.8}, {-0.1, 0.7, 1.5}, {1.3, -0.4, 0.8}, {1.6, 0.4, 1.3}};
  return s;
}

/// A desk with things on it at 0.5 to 2 m, in an office.
Scene Table() {
  Scene s;
  s.name = "table";
  Palette make(&s);
  const Material wood = make("wood", 0.9, 1.1), books = make("books", 0.45), poster = make("poster", 0.7, 1, 0.85, 3);
  const Material print = make("dead_leaves", 0.35, 1, 0.8, 4), metal = make("metal", 0.2, 0.9, 0.4),
                 dark = make("fabric", 0.6, 0.25, 0.25);
  s.AddRoom({-2.4, -2.4, 0}, {2.2, 2.4, 2.6}, make("carpet", 2.0, 0.9, 0.7), make("plaster", 4),
            make("plaster", 2.6, 0.9, 0.9, 5));
  s.AddBox(At(0.4, 0, 0.70), {0.9, 1.6, 0.04}, wood);
  for (const double x : {0.02, 0.78}) {
    for (const double y : {-0.73, 0.73}) s.AddBox(At(x, y, 0), {0.05, 0.05, 0.70}, metal);
  }
  const double z = 0.74;
  s.AddBox(At(0.66, 0.12, z, 3), {0.16, 0.22, 0.02}, dark);  // monitor: foot, neck, body, screen
  s.AddBox(At(0.70, 0.12, z, 3), {0.03, 0.06, 0.16}, dark);
  s.AddBox(At(0.68, 0.12, z + 0.11, 3), {0.035, 0.54, 0.33}, dark);
  s.AddRectangle(Upright(0.659, 0.119, z + 0.125, 183, 0.51), 0.51, 0.30, poster);
  s.AddBox(At(0.40, 0.10, z, 4), {0.14, 0.40, 0.022}, make("checker", 0.16, 0.5));  // keyboard
  s.AddBox(At(0.30, -0.42, z, 22), {0.17, 0.24, 0.035}, print);                     // books, lying and standing
  s.AddBox(At(0.31, -0.41, z + 0.035, 48), {0.15, 0.21, 0.028}, books);
  s.AddBox(At(0.66, -0.52, z, -8), {0.16, 0.36, 0.23}, books);
  s.AddBox(At(0.30, 0.55, z, -30), {0.20, 0.14, 0.12}, poster);
  s.AddCylinder(At(0.22, 0.32, z), 0.041, 0.10, make("poster", 0.26, 1, 0.85, 9));  // mug, can, pen cup
  s.AddCylinder(At(0.52, -0.18, z), 0.033, 0.12, metal);
  s.AddCylinder(At(0.60, 0.62, z), 0.05, 0.20, print);
  s.AddBox(At(0.05, -0.15, z, 12), {0.21, 0.30, 0.003}, make("books", 0.3, 1, 0.85, 21));
  s.AddBox(At(1.95, -0.6, 0), {0.4, 1.6, 1.9}, books);  // shelf and chair behind
  s.AddBox(At(1.35, 0.75, 0.43, 20), {0.45, 0.45, 0.06}, dark);
  s.AddBox(At(1.56, 0.83, 0.49, 20), {0.05, 0.42, 0.5}, make("fabric", 0.5, 0.8, 0.6, 4));
  s.AddCylinder(At(1.35, 0.75, 0), 0.03, 0.43, metal);
  s.AddRectangle(Upright(2.19, 1.1, 1.1, 180, 0.9), 0.9, 1.2, poster);
  s.AddRectangle(Upright(0.9, 2.39, 1.0, 270, 1.6), 1.6, 1.0, make("dead_leaves", 1.5, 1, 0.85, 8));
  s.AddRectangle(Upright(0.9, -2.39, 1.0, 90, 1.2), 1.2, 1.0, make("brick", 1.0));
  s.ambient_lux = 110;
  s.lamps = {{{0.2, 0.5, 2.5}, 300, 0.2}, {{-0.6, -1.2, 2.4}, 130, 0.2}};
  s.motion = {{-0.85, -0.6, 1.05}, {-0.35, 0.6, 1.45}, {0.35, -0.3, 0.72}, {0.7, 0.3, 0.95}};
  return s;
}

/// A living room: large soft surfaces, few edges.
Scene Sofa() {
  Scene s;
  s.name = "sofa";
  Palette make(&s);
  const Material sofa = make("fabric", 1.4, 1.0, 0.7), cushion = make("carpet", 0.7, 1.1, 0.75, 6),
                 wood = make("wood", 1.0);
  s.AddRoom({-2.6, -3, 0}, {2.4, 3, 2.6}, make("wood", 2.2, 0.9, 0.8, 3), make("plaster", 4),
            make("plaster", 3.5, 0.85, 0.9, 2));
  s.AddBox(At(1.7, 0, 0), {0.9, 2.2, 0.42}, sofa);
  s.AddBox(At(2.1, 0, 0.42), {0.25, 2.2, 0.45}, sofa);
  s.AddBox(At(1.7, 1.2, 0), {0.9, 0.22, 0.62}, sofa);
  s.AddBox(At(1.7, -1.2, 0), {0.9, 0.22, 0.62}, sofa);
  s.AddBox(At(1.72, 0.72, 0.42, 12), {0.14, 0.44, 0.42}, cushion);
  s.AddBox(At(1.68, -0.70, 0.42, -18), {0.14, 0.44, 0.42}, cushion);
  s.AddRectangle(At(-0.6, -1.5, 0.004, 0), 2.2, 3.0, make("carpet", 1.6));
  s.AddBox(At(0.55, 0.1, 0.36, 8), {0.55, 0.95, 0.04}, wood);
  for (const double y : {-0.3, 0.5}) s.AddBox(At(0.55, y, 0, 8), {0.4, 0.05, 0.36}, wood);
  s.AddBox(At(0.50, 0.25, 0.40, 35), {0.2, 0.28, 0.03}, make("books", 0.4));
  s.AddCylinder(At(0.62, -0.2, 0.40), 0.06, 0.22, make("poster", 0.4));
  s.AddCylinder(At(2.0, 1.75, 0), 0.16, 0.02, make("metal", 0.3, 0.8, 0.4));  // floor lamp
  s.AddCylinder(At(2.0, 1.75, 0.02), 0.02, 1.45, make("metal", 0.5, 0.8, 0.4));
  s.AddCylinder(At(2.0, 1.75, 1.45), 0.2, 0.3, make("plain", 1, 1.5));
  s.AddRectangle(Upright(2.39, 0.0, 1.25, 180, 1.3), 1.3, 0.8, make("dead_leaves", 1.6, 0.9, 0.85, 5));
  s.AddRectangle(Upright(0.6, 2.99, 0.9, 270, 1.5), 1.5, 1.3, make("tiles", 1.2, 1.2));
  s.AddBox(At(1.6, -2.7, 0), {1.2, 0.4, 1.9}, make("books", 0.7, 1, 0.8, 14));
  s.ambient_lux = 110;
  s.lamps = {{{2.0, 1.75, 2.0}, 180, 0.2}, {{0, -0.5, 2.5}, 220, 0.3}};
  s.motion = {{-1.4, -0.8, 0.95}, {-0.5, 0.8, 1.6}, {1.3, -0.6, 0.35}, {1.9, 0.6, 0.9}};
  return s;
}

/// A hall of 36 x 16 x 7 m with pillars and crates: too far for a time-of-flight camera, made for LiDAR.
Scene Hall() {
  Scene s;
  s.name = "hall";
  Palette make(&s);
  const Material brick = make("brick", 3.0), crate = make("wood", 1.5), poster = make("poster", 3.0),
                 sign = make("dead_leaves", 4.0);
  s.AddRoom({-6, -8, 0}, {30, 8, 7}, make("tiles", 8.0, 0.8), make("plaster", 10, 1, 0.8), brick);
  for (int i = 0; i < 6; ++i) {
    for (const double y : {-4.0, 4.0})
      s.AddCylinder(At(-2.0 + 5.5 * i, y, 0), 0.35, 7, make("plaster", 2.5, 0.9, 0.9, 30 + i));
  }
  Rng rng(77);
  for (int i = 0; i < 18; ++i) {
    const double x = rng.Uniform(5, 28), y = (rng.Uniform() < 0.5 ? -1 : 1) * rng.Uniform(1.6, 7.2),
                 size = rng.Uniform(0.6, 1.8);
    s.AddBox(At(x, y, 0, rng.Uniform(0, 90)), {size, rng.Uniform(0.6, 1.8), rng.Uniform(0.6, 2.4)},
             i % 3 == 0 ? poster : crate);
  }
  s.AddRectangle(Upright(29.9, 0, 1.5, 180, 8), 8, 4, sign);
  s.AddRectangle(Upright(10, 7.95, 1.5, 270, 9), 9, 3.5, poster);
  s.AddRectangle(Upright(12, -7.95, 1.5, 90, 9), 9, 3.5, sign);
  s.ambient_lux = 120;
  for (int i = 0; i < 5; ++i) s.lamps.push_back({{-3.0 + 7 * i, 0, 6.8}, 900, 0.5});
  s.motion = {{-1.5, -1.5, 1.0}, {3.0, 1.5, 2.2}, {12, -3, 1.0}, {18, 3, 2.5}};
  return s;
}

}  // namespace

std::vector<std::string> SceneNames() { return {"cali", "table", "sofa", "hall"}; }

Scene MakeScene(const std::string& name) {
  if (name == "cali") return Cali();
  if (name == "table") return Table();
  if (name == "sofa") return Sofa();
  if (name == "hall") return Hall();
  throw std::invalid_argument("scene '" + name +
                              "' is not known; expected one of cali, table, sofa, hall or a yaml file");
}

}  // namespace devo::sim
