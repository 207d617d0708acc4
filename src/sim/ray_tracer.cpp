// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/ray_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace devo::sim {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNear = 1e-4F;

// Helpers that return vectors are always inlined: no call passes one.
#pragma GCC diagnostic ignored "-Wpsabi"
// Eight rays at a time; the compiler maps these to what the processor has. Results do not depend on it.
using F8 = float __attribute__((vector_size(32)));
using I8 = std::int32_t __attribute__((vector_size(32)));
constexpr int kLanes = 8;
static_assert(RayGrid::kTile % kLanes == 0, "a tile's row is a whole number of vectors");

// Picks the widest instructions at run time; no fused multiply-add, so that every machine computes the same bytes.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define DEVO_SIM_DISPATCH __attribute__((target_clones("avx2", "default")))
#else
#define DEVO_SIM_DISPATCH
#endif

void Copy(const Eigen::Vector3d& from, float to[3]) {
  for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(from[i]);
}

float Dot(const float a[3], float x, float y, float z) { return a[0] * x + a[1] * y + a[2] * z; }

/// Planes through the camera and the sides of a rectangle around `centre`, positive inside.
void SetEdges(const std::array<Eigen::Vector3d, 4>& corners, const Eigen::Vector3d& centre, SurfaceInView* s) {
  for (int i = 0; i < 4; ++i) {
    Eigen::Vector3d e = corners[i].cross(corners[(i + 1) % 4]);
    if (e.dot(centre) < 0) e = -e;
    Copy(e, s->edges[i]);
  }
}

/// One candidate against one row of a tile, 16 rays; keeps the nearest hit per ray.
struct RowHits {
  float* distance;
  float* a;
  float* b;
  float* slant;
  std::int32_t* surface;
};

DEVO_SIM_DISPATCH
void IntersectPlaneRow(const SurfaceInView& s, int index, const float* x_in, const float* y_in, RowHits hits) {
  const bool disc = s.kind == SurfaceKind::kDisc;
  for (int k = 0; k < RayGrid::kTile; k += kLanes) {
    F8 x, y, best, best_a, best_b, best_slant;
    I8 best_surface;
    std::memcpy(&x, x_in + k, sizeof x);
    std::memcpy(&y, y_in + k, sizeof y);
    std::memcpy(&best, hits.distance + k, sizeof best);
    std::memcpy(&best_a, hits.a + k, sizeof best_a);
    std::memcpy(&best_b, hits.b + k, sizeof best_b);
    std::memcpy(&best_slant, hits.slant + k, sizeof best_slant);
    std::memcpy(&best_surface, hits.surface + k, sizeof best_surface);
    const F8 inverse = 1.0F / (s.n[0] * x + s.n[1] * y + s.n[2]);
    const F8 t = s.h * inverse;
    const F8 a = s.u0 + t * (s.u[0] * x + s.u[1] * y + s.u[2]);
    const F8 b = s.v0 + t * (s.v[0] * x + s.v[1] * y + s.v[2]);
    I8 hit = (t > kNear) & (t < best);
    hit &= disc ? I8(a * a + b * b <= s.size_u * s.size_u)
                : I8((a >= 0.0F) & (b >= 0.0F) & (a <= s.size_u) & (b <= s.size_v));
    best = hit ? t : best;
    best_a = hit ? a : best_a;
    best_b = hit ? b : best_b;
    best_slant = hit ? (inverse < 0.0F ? -inverse : inverse) : best_slant;
    best_surface = hit ? (I8{} + index) : best_surface;
    std::memcpy(hits.distance + k, &best, sizeof best);
    std::memcpy(hits.a + k, &best_a, sizeof best_a);
    std::memcpy(hits.b + k, &best_b, sizeof best_b);
    std::memcpy(hits.slant + k, &best_slant, sizeof best_slant);
    std::memcpy(hits.surface + k, &best_surface, sizeof best_surface);
  }
}

/// Keeps the nearer of `hit` and the plane of `s` along the ray.
void IntersectPlane(const SurfaceInView& s, int index, float x, float y, float z, Hit* hit) {
  const float inverse = 1.0F / Dot(s.n, x, y, z);
  const float t = s.h * inverse;
  if (!(t > kNear && t < hit->distance)) return;
  const float a = s.u0 + t * Dot(s.u, x, y, z), b = s.v0 + t * Dot(s.v, x, y, z);
  const bool inside = s.kind == SurfaceKind::kDisc ? a * a + b * b <= s.size_u * s.size_u
                                                   : a >= 0 && b >= 0 && a <= s.size_u && b <= s.size_v;
  if (inside) *hit = {index, t, a, b, std::abs(inverse)};
}

void IntersectCylinder(const SurfaceInView& s, int index, float x, float y, float z, Hit* hit) {
  // Across the axis the ray meets a circle around (-u0, -v0): A t^2 - 2 B t + C = 0. The discriminant B^2 - A C is
  // written without the difference of large numbers that it is for a far pillar.
  const float along = Dot(s.n, x, y, z), du = Dot(s.u, x, y, z), dv = Dot(s.v, x, y, z);
  const float A = du * du + dv * dv, B = -(du * s.u0 + dv * s.v0), cross = du * s.v0 - dv * s.u0;
  const float root = A * s.size_u * s.size_u - cross * cross;
  if (!(root > 0) || A < 1e-9F) return;
  const float sqrt_root = std::sqrt(root);
  const float t = (B - sqrt_root) / A;
  if (!(t > kNear && t < hit->distance)) return;
  const float height = t * along - s.c_axis;
  if (height < 0 || height > s.size_v) return;
  float angle = std::atan2(s.v0 + t * dv, s.u0 + t * du);
  if (angle < 0) angle += 6.2831853F;
  *hit = {index, t, angle * s.size_u, height, s.size_u / sqrt_root};
}

void Intersect(const SurfaceInView& s, int index, float x, float y, float z, Hit* hit) {
  if (!s.visible) return;
  if (s.kind == SurfaceKind::kCylinder) {
    IntersectCylinder(s, index, x, y, z, hit);
  } else {
    IntersectPlane(s, index, x, y, z, hit);
  }
}

float LightAt(const Surface& s, float a, float b) {
  const float c = std::max(0.0F, (a - s.shading.light_a0) * s.shading.light_columns_per_m);
  const float r = std::max(0.0F, (b - s.shading.light_b0) * s.shading.light_rows_per_m);
  const int c0 = std::min(static_cast<int>(c), s.light_columns - 2);
  const int r0 = std::min(static_cast<int>(r), s.light_rows - 2);
  const float fc = std::min(1.0F, c - static_cast<float>(c0)), fr = std::min(1.0F, r - static_cast<float>(r0));
  const float* p = &s.light_lux[static_cast<std::size_t>(r0) * s.light_columns + c0];
  const float* q = p + s.light_columns;
  const float top = p[0] + fc * (p[1] - p[0]), bottom = q[0] + fc * (q[1] - q[0]);
  return top + fr * (bottom - top);
}

float TextureAt(const Surface& s, float a, float b, float footprint_m) {
  const Surface::Shading& shading = s.shading;
  return shading.texture->Sample(a * shading.texels_per_m + shading.offset_s,
                                 b * shading.texels_per_m + shading.offset_t, footprint_m * shading.texels_per_m);
}

/// Length of a pixel's footprint per distance and pixel angle. The footprint is 1 wide and `longer` = 1 / cosine long.
/// The geometric mean blurs neither too much across nor lets too much alias along; below a cosine of a quarter the
/// length counts. The root is Newton's, once, from a guess of the bits: what is needed is that it is smooth.
template <typename F, typename I>
inline __attribute__((always_inline)) F FootprintLength(F longer) {
  I bits;
  std::memcpy(&bits, &longer, sizeof bits);
  bits = (bits >> 1) + 0x1fbb4f2e;
  F root;
  std::memcpy(&root, &bits, sizeof root);
  root = 0.5F * (root + longer / root);
  const F straight = longer < 25.0F ? 0.5F * longer : longer * 0.0F + 12.5F;
  return longer < 4.0F ? root : straight;
}

/// Eight neighbouring pixels of one surface, whose texture has two levels or more, at once; the same as Luminance.
struct ShadeLanes {
  const float *distance, *a, *b, *slant, *norm;
  float* luminance;
};

inline __attribute__((always_inline)) F8 LoadLanes(const float* p) {
  F8 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

/// Whole part, rounded down, and what is left.
inline __attribute__((always_inline)) I8 Floor(F8 v, F8* rest) {
  I8 i = __builtin_convertvector(v, I8);
  i += v < __builtin_convertvector(i, F8);  // true is -1
  *rest = v - __builtin_convertvector(i, F8);
  return i;
}

/// Bilinear sample of each lane's own level, in texel units.
inline __attribute__((always_inline)) F8 BilinearLanes(const std::vector<Texture::Level>& levels, I8 level, F8 s,
                                                       F8 t) {
  F8 fx, fy;
  const I8 x = Floor(s, &fx), y = Floor(t, &fy);
  const I8 mask_x = (I8{} + levels[0].mask_x) >> level, mask_y = (I8{} + levels[0].mask_y) >> level;
  const I8 shift = levels[0].shift - level;
  const I8 x0 = x & mask_x, x1 = (x + 1) & mask_x, row0 = (y & mask_y) << shift, row1 = ((y + 1) & mask_y) << shift;
  I8 a, b, c, d;
  for (int k = 0; k < kLanes; ++k) {
    const std::uint16_t* texels = levels[level[k]].texels.data();
    a[k] = texels[row0[k] + x0[k]];
    b[k] = texels[row0[k] + x1[k]];
    c[k] = texels[row1[k] + x0[k]];
    d[k] = texels[row1[k] + x1[k]];
  }
  const F8 fa = __builtin_convertvector(a, F8), fb = __builtin_convertvector(b, F8);
  const F8 fc = __builtin_convertvector(c, F8), fd = __builtin_convertvector(d, F8);
  const F8 top = fa + fx * (fb - fa), bottom = fc + fx * (fd - fc);
  return top + fy * (bottom - top);
}

DEVO_SIM_DISPATCH
void ShadeEight(const Surface& surface, float pixel_angle, const ShadeLanes& lanes) {
  const Surface::Shading& shading = surface.shading;
  const std::vector<Texture::Level>& levels = shading.texture->levels();
  const F8 a = LoadLanes(lanes.a), b = LoadLanes(lanes.b);
  const F8 s = a * shading.texels_per_m + shading.offset_s, t = b * shading.texels_per_m + shading.offset_t;
  F8 footprint = LoadLanes(lanes.distance) * (pixel_angle * shading.texels_per_m) *
                 FootprintLength<F8, I8>(LoadLanes(lanes.slant) * LoadLanes(lanes.norm));
  footprint = footprint > 1.0F ? footprint : footprint * 0.0F + 1.0F;
  I8 bits;
  std::memcpy(&bits, &footprint, sizeof bits);
  F8 lod = __builtin_convertvector(bits, F8) * (1.0F / (1 << 23)) - 127.0F;
  const float last = static_cast<float>(levels.size()) - 1.001F;
  lod = lod < last ? lod : lod * 0.0F + last;
  F8 between;
  const I8 level = Floor(lod, &between);
  const I8 scale_bits = (127 - level) << 23;
  F8 scale;
  std::memcpy(&scale, &scale_bits, sizeof scale);
  const F8 fine = BilinearLanes(levels, level, s * scale - 0.5F, t * scale - 0.5F);
  const F8 coarse = BilinearLanes(levels, level + 1, 0.5F * s * scale - 0.5F, 0.5F * t * scale - 0.5F);

  const F8 zero = {};
  F8 column = (a - shading.light_a0) * shading.light_columns_per_m,
     row = (b - shading.light_b0) * shading.light_rows_per_m;
  column = column > zero ? column : zero;
  row = row > zero ? row : zero;
  I8 c0 = __builtin_convertvector(column, I8), r0 = __builtin_convertvector(row, I8);
  c0 = c0 < surface.light_columns - 2 ? c0 : (I8{} + surface.light_columns - 2);
  r0 = r0 < surface.light_rows - 2 ? r0 : (I8{} + surface.light_rows - 2);
  F8 fc = column - __builtin_convertvector(c0, F8), fr = row - __builtin_convertvector(r0, F8);
  fc = fc < 1.0F ? fc : zero + 1.0F;
  fr = fr < 1.0F ? fr : zero + 1.0F;
  F8 p00, p01, p10, p11;
  for (int k = 0; k < kLanes; ++k) {
    const float* p = &surface.light_lux[static_cast<std::size_t>(r0[k]) * surface.light_columns + c0[k]];
    p00[k] = p[0];
    p01[k] = p[1];
    p10[k] = p[surface.light_columns];
    p11[k] = p[surface.light_columns + 1];
  }
  const F8 top = p00 + fc * (p01 - p00), bottom = p10 + fc * (p11 - p10);
  const F8 light = top + fr * (bottom - top);
  const F8 luminance = (shading.reflectance * Texture::kTexelUnit) * (fine + between * (coarse - fine)) * light;
  std::memcpy(lanes.luminance, &luminance, sizeof luminance);
}

}  // namespace

View::View(const Scene& scene, const Rigid3& T_world_camera, double t_s) {
  const Rigid3 T_camera_world = T_world_camera.inverse();
  const Eigen::Matrix3d R = T_camera_world.rotation().toRotationMatrix();
  surfaces_.resize(scene.surfaces().size());
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    const Surface& from = scene.surfaces()[i];
    SurfaceInView& s = surfaces_[i];
    const Eigen::Vector3d origin = from.sway ? Eigen::Vector3d(from.origin + from.sway->OffsetAt(t_s)) : from.origin;
    const Eigen::Vector3d c = T_camera_world * origin, u = R * from.u, v = R * from.v, n = R * from.n;
    s.kind = from.kind;
    Copy(n, s.n);
    Copy(u, s.u);
    Copy(v, s.v);
    s.h = static_cast<float>(n.dot(c));
    s.u0 = static_cast<float>(-u.dot(c));
    s.v0 = static_cast<float>(-v.dot(c));
    s.size_u = static_cast<float>(from.size_u);
    s.size_v = static_cast<float>(from.size_v);
    s.visible = true;
    if (from.kind == SurfaceKind::kCylinder) {
      s.c_axis = static_cast<float>(n.dot(c));
      const Eigen::Vector3d middle = c + 0.5 * from.size_v * n;
      const double radius = std::hypot(from.size_u, 0.5 * from.size_v), distance = middle.norm();
      Copy(middle / std::max(distance, 1e-9), s.cone);
      s.cone_sin = static_cast<float>(std::min(1.0, radius / std::max(distance, 1e-9)));
      s.cone_cos = std::sqrt(1 - s.cone_sin * s.cone_sin);
      continue;
    }
    s.visible = s.h != 0 && (!from.one_sided || s.h < 0);
    const bool disc = from.kind == SurfaceKind::kDisc;
    const Eigen::Vector3d corner = disc ? Eigen::Vector3d(c - from.size_u * (u + v)) : c;
    const Eigen::Vector3d side_u = (disc ? 2 : 1) * from.size_u * u,
                          side_v = disc ? 2 * from.size_u * v : from.size_v * v;
    SetEdges({corner, corner + side_u, corner + side_u + side_v, corner + side_v}, corner + 0.5 * (side_u + side_v),
             &s);
  }
}

Hit View::Trace(float x, float y, float z, const std::vector<std::uint16_t>* candidates) const {
  Hit hit;
  if (candidates != nullptr) {
    for (const int i : *candidates) Intersect(surfaces_[i], i, x, y, z, &hit);
  } else {
    for (int i = 0; i < static_cast<int>(surfaces_.size()); ++i) Intersect(surfaces_[i], i, x, y, z, &hit);
  }
  return hit;
}

float Luminance(const Scene& scene, const Hit& hit, float direction_norm, float pixel_angle) {
  if (hit.surface < 0) return 0;
  const Surface& s = scene.surfaces()[hit.surface];
  const float footprint = hit.distance * pixel_angle * FootprintLength<float, std::int32_t>(hit.slant * direction_norm);
  return s.shading.reflectance * TextureAt(s, hit.a, hit.b, footprint) * LightAt(s, hit.a, hit.b);
}

float InfraredReflectance(const Scene& scene, const Hit& hit, float footprint_m) {
  if (hit.surface < 0) return 0;
  const Surface& s = scene.surfaces()[hit.surface];
  // Dyes and prints hardly show at 860 nm: half the weight is the material's, half the texture's.
  const float texture = TextureAt(s, hit.a, hit.b, footprint_m);
  return s.shading.infrared * std::min(1.0F, 0.5F + 0.7F * texture);
}

RayGrid::RayGrid(const Camera& camera)
    : width_(camera.width()), height_(camera.height()), stride_((width_ + kTile - 1) / kTile * kTile),
      tile_columns_(stride_ / kTile), tile_rows_((height_ + kTile - 1) / kTile),
      pixel_angle_(static_cast<float>(2 / (camera.fx() + camera.fy()))) {
  const std::size_t size = static_cast<std::size_t>(stride_) * height_;
  x_.assign(size, 0);
  y_.assign(size, 0);
  norm_.assign(size, 1);
  valid_.assign(size, 0);
  for (int r = 0; r < height_; ++r) {
    for (int c = 0; c < width_; ++c) {
      const auto ray = camera.Unproject({c, r});
      const std::size_t i = static_cast<std::size_t>(r) * stride_ + c;
      if (!ray) continue;
      x_[i] = static_cast<float>(ray->x());
      y_[i] = static_cast<float>(ray->y());
      norm_[i] = static_cast<float>(ray->norm());
      valid_[i] = 1;
    }
  }
  tiles_.resize(static_cast<std::size_t>(tile_columns_) * tile_rows_);
  for (int tr = 0; tr < tile_rows_; ++tr) {
    for (int tc = 0; tc < tile_columns_; ++tc) {
      float lo_x = kInfinity, hi_x = -kInfinity, lo_y = kInfinity, hi_y = -kInfinity;
      for (int r = tr * kTile; r < std::min(height_, (tr + 1) * kTile); ++r) {
        for (int c = tc * kTile; c < std::min(width_, (tc + 1) * kTile); ++c) {
          lo_x = std::min(lo_x, x(r)[c]);
          hi_x = std::max(hi_x, x(r)[c]);
          lo_y = std::min(lo_y, y(r)[c]);
          hi_y = std::max(hi_y, y(r)[c]);
        }
      }
      // Towards the border of a strongly distorting lens a pixel spans more than 1 / f.
      const float margin = kMargin_px * pixel_angle_ * std::max(1.0F, (hi_x - lo_x) / (kTile * pixel_angle_));
      lo_x -= margin;
      lo_y -= margin;
      hi_x += margin;
      hi_y += margin;
      Tile& tile = tiles_[static_cast<std::size_t>(tr) * tile_columns_ + tc];
      const float corners[4][2] = {{lo_x, lo_y}, {hi_x, lo_y}, {hi_x, hi_y}, {lo_x, hi_y}};
      std::memcpy(tile.corners, corners, sizeof corners);
      const Eigen::Vector3f centre = Eigen::Vector3f(0.5F * (lo_x + hi_x), 0.5F * (lo_y + hi_y), 1).normalized();
      for (int i = 0; i < 3; ++i) tile.centre[i] = centre[i];
      tile.cone_cos = 1;
      for (const auto& corner : corners) {
        tile.cone_cos = std::min(tile.cone_cos, centre.dot(Eigen::Vector3f(corner[0], corner[1], 1).normalized()));
      }
      tile.cone_sin = std::sqrt(std::max(0.0F, 1 - tile.cone_cos * tile.cone_cos));
    }
  }
}

void RayGrid::SubPixelRay(int row, int column, float dx, float dy, float* x_out, float* y_out) const {
  const int c = std::min(column, width_ - 2), r = std::min(row, height_ - 2);
  const float* x0 = x(r);
  const float* y0 = y(r);
  *x_out = x(row)[column] + dx * (x0[c + 1] - x0[c]) + dy * (x(r + 1)[c] - x0[c]);
  *y_out = y(row)[column] + dx * (y0[c + 1] - y0[c]) + dy * (y(r + 1)[c] - y0[c]);
}

void FindCandidates(const View& view, const RayGrid::Tile& tile, std::vector<std::uint16_t>* candidates) {
  candidates->clear();
  const auto& surfaces = view.surfaces();
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    const SurfaceInView& s = surfaces[i];
    if (!s.visible) continue;
    bool may_hit = true;
    if (s.kind == SurfaceKind::kCylinder) {
      // Angle between the cones' axes at most the sum of their half angles.
      const float cosine = Dot(tile.centre, s.cone[0], s.cone[1], s.cone[2]);
      may_hit = s.cone_sin >= 1 || cosine >= s.cone_cos * tile.cone_cos - s.cone_sin * tile.cone_sin;
    } else {
      for (const auto& edge : s.edges) {
        bool outside = true;
        for (const auto& c : tile.corners) outside = outside && Dot(edge, c[0], c[1], 1) < 0;
        if (outside) may_hit = false;
      }
    }
    if (may_hit) candidates->push_back(static_cast<std::uint16_t>(i));
  }
}

void BandRenderer::TraceRow(const View& view, int row, int slot) {
  const int stride = rays_.stride();
  const std::size_t base = static_cast<std::size_t>(slot) * stride;
  std::fill_n(&distance_[base], stride, kInfinity);
  std::fill_n(&surface_[base], stride, -1);
  for (int tc = 0; tc < rays_.tile_columns(); ++tc) {
    const std::size_t at = base + static_cast<std::size_t>(tc) * RayGrid::kTile;
    const float* x = rays_.x(row) + tc * RayGrid::kTile;
    const float* y = rays_.y(row) + tc * RayGrid::kTile;
    for (const int i : candidates_[tc]) {
      const SurfaceInView& s = view.surfaces()[i];
      if (s.kind != SurfaceKind::kCylinder) {
        IntersectPlaneRow(s, i, x, y, {&distance_[at], &a_[at], &b_[at], &slant_[at], &surface_[at]});
        continue;
      }
      for (int k = 0; k < RayGrid::kTile; ++k) {
        Hit hit{surface_[at + k], distance_[at + k], a_[at + k], b_[at + k], slant_[at + k]};
        IntersectCylinder(s, i, x[k], y[k], 1, &hit);
        surface_[at + k] = hit.surface;
        distance_[at + k] = hit.distance;
        a_[at + k] = hit.a;
        b_[at + k] = hit.b;
        slant_[at + k] = hit.slant;
      }
    }
  }
}

float BandRenderer::Antialiased(const View& view, int row, int column,
                                const std::vector<std::uint16_t>& candidates) const {
  // Eight rooks: each row and column of an 8x8 grid is hit once, so that an edge that moves across the pixel changes
  // it in even steps.
  static constexpr float kOffsets[8][2] = {{-.4375F, .0625F}, {-.3125F, -.3125F}, {-.1875F, .4375F}, {-.0625F, -.0625F},
                                           {.0625F, .3125F},  {.1875F, -.4375F},  {.3125F, .1875F},  {.4375F, -.1875F}};
  const float norm = rays_.norm(row)[column];
  float sum = 0;
  for (const auto& o : kOffsets) {
    float x, y;
    rays_.SubPixelRay(row, column, o[0], o[1], &x, &y);
    sum += Luminance(scene_, view.Trace(x, y, 1, &candidates), norm, rays_.pixel_angle());
  }
  return 0.125F * sum;
}

float BandRenderer::LuminanceOf(const View& view, int row, int column) const {
  const auto& candidates = candidates_[column / RayGrid::kTile];
  const int slot = row - tile_row_ * RayGrid::kTile;
  if (antialias_[static_cast<std::size_t>(slot) * rays_.stride() + column] != 0) {
    return Antialiased(view, row, column, candidates);
  }
  const Hit hit = view.Trace(rays_.x(row)[column], rays_.y(row)[column], 1, &candidates);
  return Luminance(scene_, hit, rays_.norm(row)[column], rays_.pixel_angle());
}

void BandRenderer::Prepare(const View& view, int tile_row) {
  constexpr int kTile = RayGrid::kTile;
  const int stride = rays_.stride();
  tile_row_ = tile_row;
  const std::size_t size = static_cast<std::size_t>(kTile + 2) * stride;
  if (distance_.size() != size) {
    for (auto* v : {&distance_, &a_, &b_, &slant_}) v->assign(size, 0);
    surface_.assign(size, -1);
    antialias_.assign(static_cast<std::size_t>(kTile) * stride, 0);
    candidates_.resize(rays_.tile_columns());
  }
  for (int tc = 0; tc < rays_.tile_columns(); ++tc) FindCandidates(view, rays_.tile(tile_row, tc), &candidates_[tc]);
}

void BandRenderer::Trace(const View& view, int tile_row) {
  Prepare(view, tile_row);
  const int first = tile_row * RayGrid::kTile, rows = std::min(RayGrid::kTile, rays_.height() - first);
  for (int r = 0; r < rows; ++r) TraceRow(view, first + r, r + 1);
}

void BandRenderer::Render(const View& view, int tile_row, float* luminance, float* nearest_m) {
  constexpr int kTile = RayGrid::kTile;
  const int stride = rays_.stride(), first = tile_row * kTile;
  const int rows = std::min(kTile, rays_.height() - first);
  Prepare(view, tile_row);
  // One row above and below, to see where surfaces meet. Slot 0 is the row above.
  for (int slot = 0; slot < rows + 2; ++slot) {
    TraceRow(view, std::clamp(first + slot - 1, 0, rays_.height() - 1), slot);
  }
  std::fill_n(nearest_m, rays_.tile_columns(), kInfinity);
  for (int r = 0; r < rows; ++r) {
    const std::int32_t* above = &surface_[static_cast<std::size_t>(r) * stride];
    const std::int32_t* here = above + stride;
    const std::int32_t* below = here + stride;
    std::uint8_t* mark = &antialias_[static_cast<std::size_t>(r) * stride];
    for (int c = 0; c < rays_.width(); ++c) {
      const int left = c > 0 ? c - 1 : c, right = c + 1 < rays_.width() ? c + 1 : c;
      mark[c] = here[c] != above[c] || here[c] != below[c] || here[c] != here[left] || here[c] != here[right];
    }
    ShadeRow(r + 1, first + r, luminance + static_cast<std::size_t>(r) * stride, nearest_m);
    for (int c = 0; c < rays_.width(); ++c) {
      if (mark[c] != 0) {
        luminance[static_cast<std::size_t>(r) * stride + c] = Antialiased(view, first + r, c, candidates_[c / kTile]);
      }
    }
  }
}

void BandRenderer::ShadeRow(int slot, int row, float* luminance, float* nearest_m) const {
  const std::size_t base = static_cast<std::size_t>(slot) * rays_.stride();
  const float* norm = rays_.norm(row);
  for (int c = 0; c < rays_.width(); c += kLanes) {
    float& nearest = nearest_m[c / RayGrid::kTile];
    const std::int32_t* surface = &surface_[base + c];
    bool same = surface[0] >= 0 && scene_.surfaces()[surface[0]].shading.texture->levels().size() >= 2;
    for (int k = 0; k < kLanes; ++k) {
      nearest = std::min(nearest, distance_[base + c + k]);
      same = same && surface[k] == surface[0];
    }
    if (same) {
      ShadeEight(scene_.surfaces()[surface[0]], rays_.pixel_angle(),
                 {&distance_[base + c], &a_[base + c], &b_[base + c], &slant_[base + c], norm + c, luminance + c});
      continue;
    }
    for (int k = 0; k < kLanes; ++k) {
      const std::size_t i = base + c + k;
      const Hit hit{surface_[i], distance_[i], a_[i], b_[i], slant_[i]};
      luminance[c + k] = Luminance(scene_, hit, norm[c + k], rays_.pixel_angle());
    }
  }
}

}  // namespace devo::sim
