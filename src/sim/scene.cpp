// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/scene.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "devo/sim/random.h"
#include "devo/sim/ray_tracer.h"

namespace devo::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kLightCell_m = 0.08;  // grid of baked light; shadows are softer than this
constexpr int kShadowRays = 8;

void ExpectPositive(double value, const char* what) {
  if (!(value > 0)) throw std::invalid_argument(std::string(what) + " = " + std::to_string(value) + "; expected > 0 m");
}

Surface Rectangle(const Eigen::Vector3d& origin, const Eigen::Vector3d& u, const Eigen::Vector3d& v, double size_u,
                  double size_v, const Material& material, bool one_sided) {
  Surface s;
  s.origin = origin;
  s.u = u;
  s.v = v;
  s.n = u.cross(v);
  s.size_u = size_u;
  s.size_v = size_v;
  s.material = material;
  s.one_sided = one_sided;
  return s;
}

/// Extents of the surface coordinates (a, b).
void Extent(const Surface& s, double* a0, double* a1, double* b0, double* b1) {
  *a0 = *b0 = 0;
  *a1 = s.size_u;
  *b1 = s.size_v;
  if (s.kind == SurfaceKind::kDisc) {
    *a0 = *b0 = -s.size_u;
    *b1 = s.size_u;
  } else if (s.kind == SurfaceKind::kCylinder) {
    *a1 = 2 * kPi * s.size_u;
  }
}

double Area(const Surface& s) {
  if (s.kind == SurfaceKind::kDisc) return kPi * s.size_u * s.size_u;
  return s.size_v * s.size_u * (s.kind == SurfaceKind::kCylinder ? 2 * kPi : 1);
}

}  // namespace

Eigen::Vector3d Sway::OffsetAt(double t_s) const {
  if (t_s <= begins_s) return Eigen::Vector3d::Zero();
  return by * (0.5 - 0.5 * std::cos(2 * kPi * (t_s - begins_s) / period_s));
}

double Sway::SpeedAt(double t_s) const {
  if (t_s <= begins_s) return 0;
  return by.norm() * kPi / period_s * std::abs(std::sin(2 * kPi * (t_s - begins_s) / period_s));
}

Eigen::Vector3d PointOn(const Surface& s, double a, double b) {
  if (s.kind != SurfaceKind::kCylinder) return s.origin + a * s.u + b * s.v;
  return s.origin + s.size_u * NormalAt(s, a) + b * s.n;
}

Eigen::Vector3d NormalAt(const Surface& s, double a) {
  if (s.kind != SurfaceKind::kCylinder) return s.n;
  const double angle = a / s.size_u;
  return std::cos(angle) * s.u + std::sin(angle) * s.v;
}

int Scene::AddTexture(Texture texture) {
  textures_.push_back(std::move(texture));
  return static_cast<int>(textures_.size()) - 1;
}

void Scene::Add(Surface surface) {
  if (surface.material.texture < 0 || surface.material.texture >= static_cast<int>(textures_.size())) {
    throw std::invalid_argument("surface refers to texture " + std::to_string(surface.material.texture) +
                                ", but the scene has " + std::to_string(textures_.size()));
  }
  ExpectPositive(surface.material.texture_size_m, "texture size");
  Rng rng(surfaces_.size(), 0x0ff5e7);
  surface.texture_offset_s = rng.Uniform() * surface.material.texture_size_m;
  surface.texture_offset_t = rng.Uniform() * surface.material.texture_size_m;
  surfaces_.push_back(std::move(surface));
}

void Scene::AddRectangle(const Rigid3& T, double size_u, double size_v, const Material& material, bool one_sided) {
  ExpectPositive(size_u, "rectangle's width");
  ExpectPositive(size_v, "rectangle's height");
  const Eigen::Matrix3d R = T.rotation().toRotationMatrix();
  Add(Rectangle(T.translation(), R.col(0), R.col(1), size_u, size_v, material, one_sided));
}

void Scene::AddBox(const Rigid3& T, const Eigen::Vector3d& size, const Material& material,
                   const std::optional<Sway>& sway) {
  for (int i = 0; i < 3; ++i) ExpectPositive(size[i], "box's size");
  const Eigen::Matrix3d R = T.rotation().toRotationMatrix();
  const Eigen::Vector3d x = R.col(0), y = R.col(1), z = R.col(2), &c = T.translation();
  const Eigen::Vector3d hx = 0.5 * size.x() * x, hy = 0.5 * size.y() * y, top = size.z() * z;
  const auto add = [&](const Eigen::Vector3d& corner, const Eigen::Vector3d& u, const Eigen::Vector3d& v, double size_u,
                       double size_v) {
    Surface face = Rectangle(corner, u, v, size_u, size_v, material, true);
    face.sway = sway;
    Add(std::move(face));
  };
  add(c - hx - hy + top, x, y, size.x(), size.y());  // top
  add(c - hx + hy, x, -y, size.x(), size.y());       // bottom
  add(c - hx - hy, x, z, size.x(), size.z());        // -y
  add(c + hx + hy, -x, z, size.x(), size.z());       // +y
  add(c + hx - hy, y, z, size.y(), size.z());        // +x
  add(c - hx + hy, -y, z, size.y(), size.z());       // -x
}

void Scene::AddCylinder(const Rigid3& T, double radius, double height, const Material& material,
                        const std::optional<Sway>& sway) {
  ExpectPositive(radius, "cylinder's radius");
  ExpectPositive(height, "cylinder's height");
  const Eigen::Matrix3d R = T.rotation().toRotationMatrix();
  Surface mantle;
  mantle.kind = SurfaceKind::kCylinder;
  mantle.origin = T.translation();
  mantle.u = R.col(0);
  mantle.v = R.col(1);
  mantle.n = R.col(2);
  mantle.size_u = radius;
  mantle.size_v = height;
  mantle.one_sided = true;
  mantle.material = material;
  mantle.sway = sway;
  Surface cap = mantle;
  cap.kind = SurfaceKind::kDisc;
  Add(std::move(mantle));
  Surface bottom = cap;
  bottom.v = -cap.v;
  bottom.n = -cap.n;
  Add(std::move(bottom));
  cap.origin += height * cap.n;
  Add(std::move(cap));
}

void Scene::AddRoom(const Eigen::Vector3d& min, const Eigen::Vector3d& max, const Material& floor,
                    const Material& ceiling, const Material& wall) {
  const Eigen::Vector3d size = max - min;
  for (int i = 0; i < 3; ++i) ExpectPositive(size[i], "room's size");
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  Add(Rectangle(min, x, y, size.x(), size.y(), floor, true));
  Add(Rectangle({min.x(), max.y(), max.z()}, x, -y, size.x(), size.y(), ceiling, true));
  Add(Rectangle({max.x(), min.y(), min.z()}, -x, z, size.x(), size.z(), wall, true));  // faces +y
  Add(Rectangle({min.x(), max.y(), min.z()}, x, z, size.x(), size.z(), wall, true));   // faces -y
  Add(Rectangle({min.x(), min.y(), min.z()}, y, z, size.y(), size.z(), wall, true));   // faces +x
  Add(Rectangle({max.x(), max.y(), min.z()}, -y, z, size.y(), size.z(), wall, true));  // faces -x
}

bool Scene::Occluded(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  // Direct double-precision tests in the world frame; baking happens once.
  const Eigen::Vector3d d = to - from;
  constexpr double kNear = 1e-4, kFar = 1 - 1e-4;
  for (const auto& s : surfaces_) {
    const Eigen::Vector3d o = from - s.origin;
    if (s.kind == SurfaceKind::kCylinder) {
      const Eigen::Vector2d dp(d.dot(s.u), d.dot(s.v)), op(o.dot(s.u), o.dot(s.v));
      const double A = dp.squaredNorm(), B = dp.dot(op), C = op.squaredNorm() - s.size_u * s.size_u;
      const double root = B * B - A * C;
      if (root <= 0 || A < 1e-12) continue;
      const double t = (-B - std::sqrt(root)) / A, height = o.dot(s.n) + t * d.dot(s.n);
      if (t > kNear && t < kFar && height > 0 && height < s.size_v) return true;
      continue;
    }
    const double nd = d.dot(s.n);
    if (std::abs(nd) < 1e-12 || (s.one_sided && nd > 0)) continue;
    const double t = -o.dot(s.n) / nd;
    if (t <= kNear || t >= kFar) continue;
    const double a = o.dot(s.u) + t * d.dot(s.u), b = o.dot(s.v) + t * d.dot(s.v);
    const bool inside = s.kind == SurfaceKind::kDisc ? a * a + b * b < s.size_u * s.size_u
                                                     : a > 0 && b > 0 && a < s.size_u && b < s.size_v;
    if (inside) return true;
  }
  return false;
}

double Scene::IlluminanceAt(const Eigen::Vector3d& p, const Eigen::Vector3d& n) const {
  double lux = ambient_lux * (0.75 + 0.25 * n.z());  // a room's diffuse light comes rather from above
  Rng rng(0, 0x11947);  // the same points of the lamps for every cell: penumbras stay smooth
  for (const auto& lamp : lamps) {
    double sum = 0;
    for (int k = 0; k < kShadowRays; ++k) {
      const Eigen::Vector3d jitter(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
      const Eigen::Vector3d l = lamp.position + 0.6 * lamp.radius_m * jitter, d = l - p;
      const double r2 = d.squaredNorm(), cosine = d.dot(n) / std::sqrt(r2);
      if (cosine <= 0) continue;
      double gain = 1;
      if (lamp.cone_deg < 180) {
        const double angle = std::acos(std::clamp(-d.normalized().dot(lamp.direction.normalized()), -1.0, 1.0));
        const double edge = (angle * 180 / kPi - lamp.cone_deg / 2) / (0.15 * lamp.cone_deg);
        gain = 1 / (1 + std::exp(4 * edge));
      }
      if (gain > 1e-4 && !Occluded(p, l)) sum += gain * cosine / std::max(r2, 0.01);
    }
    lux += lamp.intensity_cd * sum / kShadowRays;
  }
  return lux;
}

void Scene::BakeLight(double mean_lux) {
  ExpectPositive(mean_lux, "mean illuminance (lux)");
  double area = 0, flux = 0;
  for (auto& s : surfaces_) {
    double a0, a1, b0, b1;
    Extent(s, &a0, &a1, &b0, &b1);
    s.light_columns = std::clamp(static_cast<int>((a1 - a0) / kLightCell_m) + 2, 3, 64);
    s.light_rows = std::clamp(static_cast<int>((b1 - b0) / kLightCell_m) + 2, 3, 64);
    s.light_lux.resize(static_cast<std::size_t>(s.light_columns) * s.light_rows);
    double sum = 0;
    for (int r = 0; r < s.light_rows; ++r) {
      for (int c = 0; c < s.light_columns; ++c) {
        const double a = a0 + (a1 - a0) * c / (s.light_columns - 1), b = b0 + (b1 - b0) * r / (s.light_rows - 1);
        // Slightly inside and in front, so that a surface's own border and neighbours do not shade it.
        const double a_in = std::clamp(a, a0 + 0.01 * (a1 - a0), a1 - 0.01 * (a1 - a0));
        const double b_in = std::clamp(b, b0 + 0.01 * (b1 - b0), b1 - 0.01 * (b1 - b0));
        const Eigen::Vector3d n = NormalAt(s, a_in);
        const std::size_t k = static_cast<std::size_t>(r) * s.light_columns + c;
        s.light_lux[k] = static_cast<float>(IlluminanceAt(PointOn(s, a_in, b_in) + 1e-3 * n, n));
        sum += s.light_lux[k];
      }
    }
    area += Area(s);
    flux += Area(s) * sum / static_cast<double>(s.light_lux.size());
  }
  if (!(flux > 0)) throw std::invalid_argument("scene '" + name + "' is dark: it needs ambient_lux or a lamp");
  const double gain = mean_lux * area / flux;
  ambient_lux *= gain;
  for (auto& lamp : lamps) lamp.intensity_cd *= gain;
  for (auto& s : surfaces_) {
    for (auto& lux : s.light_lux) lux *= static_cast<float>(gain);
    PrepareShading(&s);
  }
}

void Scene::PrepareShading(Surface* surface) const {
  const Material& material = surface->material;
  Surface::Shading& shading = surface->shading;
  double a0, a1, b0, b1;
  Extent(*surface, &a0, &a1, &b0, &b1);
  shading.texture = &textures_[material.texture];
  shading.texels_per_m = static_cast<float>(shading.texture->width() / material.texture_size_m);
  shading.offset_s = static_cast<float>(surface->texture_offset_s) * shading.texels_per_m;
  shading.offset_t = static_cast<float>(surface->texture_offset_t) * shading.texels_per_m;
  shading.reflectance = static_cast<float>(material.reflectance);
  shading.infrared = static_cast<float>(material.infrared);
  shading.light_a0 = static_cast<float>(a0);
  shading.light_b0 = static_cast<float>(b0);
  shading.light_columns_per_m = static_cast<float>((surface->light_columns - 1) / (a1 - a0));
  shading.light_rows_per_m = static_cast<float>((surface->light_rows - 1) / (b1 - b0));
}

}  // namespace devo::sim
