// SPDX-License-Identifier: BSD-3-Clause
//
// A scene is a list of surfaces with closed-form ray intersection, and lamps whose light is baked into a coarse grid
// per surface. World frame: z up, metres.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "devo/core/rigid3.h"
#include "devo/sim/texture.h"

namespace devo::sim {

enum class SurfaceKind { kRectangle, kDisc, kCylinder };

/// How a surface looks.
struct Material {
  int texture = 0;            ///< index into Scene::textures()
  double texture_size_m = 1;  ///< side over which the texture repeats
  double reflectance = 1;     ///< multiplies the texture in visible light
  double infrared = 0.85;     ///< reflectance that a depth camera sees, before the texture's (weaker) share
};

/// A way to and fro: from its place at `begins_s` of the recording it moves by `by` (world frame, m) and back within
/// every `period_s`, slowly at both ends.
struct Sway {
  Eigen::Vector3d by = Eigen::Vector3d::Zero();
  double period_s = 4;
  double begins_s = 0;

  Eigen::Vector3d OffsetAt(double t_s) const;
  /// m/s
  double SpeedAt(double t_s) const;
};

/// One piece of surface. Rectangle: from `origin` along u and v; disc: around `origin` in the plane of u and v;
/// cylinder: mantle around the axis n from `origin` on, angle zero at u. (u, v, n) is right-handed, orthonormal.
struct Surface {
  SurfaceKind kind = SurfaceKind::kRectangle;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d u = Eigen::Vector3d::UnitX(), v = Eigen::Vector3d::UnitY(), n = Eigen::Vector3d::UnitZ();
  double size_u = 1;       ///< rectangle: extent along u; disc and cylinder: radius
  double size_v = 1;       ///< rectangle: extent along v; cylinder: height
  bool one_sided = false;  ///< seen only from the side that n points to (faces of a closed body)
  Material material;
  double texture_offset_s = 0, texture_offset_t = 0;  ///< metres; so that equal materials do not look alike
  std::optional<Sway> sway;                           ///< of what moves; its light is that of its place at rest

  int light_columns = 0, light_rows = 0;  ///< grid of illuminance over (a, b) of the surface, filled by BakeLight
  std::vector<float> light_lux;

  /// What shading needs of the above, in the form in which it is fastest; filled by BakeLight.
  struct Shading {
    const Texture* texture = nullptr;
    float texels_per_m = 1, offset_s = 0, offset_t = 0, reflectance = 1, infrared = 1;
    float light_a0 = 0, light_b0 = 0, light_columns_per_m = 0, light_rows_per_m = 0;
  } shading;
};

/// A spherical lamp, or with cone_deg < 180 a spot that shines along `direction`.
struct Lamp {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double intensity_cd = 100;
  double radius_m = 0.1;  ///< softens shadows
  Eigen::Vector3d direction = -Eigen::Vector3d::UnitZ();
  double cone_deg = 180;
};

/// Where a camera may move and what it looks at, for random motion.
struct MotionVolume {
  Eigen::Vector3d position_min, position_max;  ///< camera centre
  Eigen::Vector3d target_min, target_max;      ///< point on the optical axis
};

class Scene {
 public:
  Scene() = default;
  Scene(Scene&&) = default;  // not copied: surfaces point to the scene's textures
  Scene& operator=(Scene&&) = default;

  std::string name;
  MotionVolume motion;
  double ambient_lux = 50;
  std::vector<Lamp> lamps;

  /// Index of a new texture.
  int AddTexture(Texture texture);
  /// All lengths in metres, throws std::invalid_argument when one is not positive.
  void AddRectangle(const Rigid3& T_world_corner, double size_u, double size_v, const Material& material,
                    bool one_sided = false);
  /// Closed box; the frame's origin is the centre of its bottom face.
  void AddBox(const Rigid3& T_world_box, const Eigen::Vector3d& size, const Material& material,
              const std::optional<Sway>& sway = std::nullopt);
  /// Upright (along the frame's z) closed cylinder, the origin is the centre of its bottom.
  void AddCylinder(const Rigid3& T_world_cylinder, double radius, double height, const Material& material,
                   const std::optional<Sway>& sway = std::nullopt);
  /// The inside of a box: floor, ceiling and four walls (in this order of materials: floor, ceiling, walls).
  void AddRoom(const Eigen::Vector3d& min, const Eigen::Vector3d& max, const Material& floor, const Material& ceiling,
               const Material& wall);

  const std::vector<Surface>& surfaces() const { return surfaces_; }
  const std::vector<Texture>& textures() const { return textures_; }

  /// Scales ambient light and lamps so that the mean illuminance over all surfaces (by area) is `mean_lux`, and fills
  /// every surface's grid: ambient plus lamps with Lambert's cosine, inverse square and soft shadows.
  void BakeLight(double mean_lux);

 private:
  void Add(Surface surface);
  double IlluminanceAt(const Eigen::Vector3d& p, const Eigen::Vector3d& n) const;
  void PrepareShading(Surface* surface) const;
  bool Occluded(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;

  std::vector<Surface> surfaces_;
  std::vector<Texture> textures_;
};

/// Point and outward normal at surface coordinates (a, b) in metres: along u and v; along the circumference and the
/// axis for cylinders.
Eigen::Vector3d PointOn(const Surface& s, double a, double b);
Eigen::Vector3d NormalAt(const Surface& s, double a);

/// cali, table, sofa, hall. Throws std::invalid_argument naming the scene and the known ones.
Scene MakeScene(const std::string& name);
std::vector<std::string> SceneNames();

/// A scene from yaml (docs/simulation.md gives the keys). Throws std::invalid_argument naming the file, key and
/// what was expected.
Scene LoadScene(const std::string& path);

}  // namespace devo::sim
