// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "devo/core/camera.h"
#include "devo/core/rigid3.h"
#include "devo/sim/scene.h"

namespace devo::sim {

/// Where a ray meets the scene. A ray is the camera-frame direction (x, y, z) as given, not normalised: with z = 1 the
/// `distance` is the depth along the optical axis, with a unit vector it is the range.
struct Hit {
  int surface = -1;  ///< -1: nothing hit
  float distance = std::numeric_limits<float>::infinity();
  float a = 0, b = 0;  ///< surface coordinates, metres (see PointOn)
  float slant = 1;     ///< 1 / |normal . direction|
};

/// A surface in the camera's frame: intersections need a few multiplications per ray only.
struct SurfaceInView {
  SurfaceKind kind;
  float n[3], u[3], v[3];
  float h;       ///< distance of the plane along n (negative: seen from the front)
  float u0, v0;  ///< camera centre in surface coordinates
  float size_u, size_v;
  float c_axis;                       ///< cylinder: its origin along its axis
  bool visible;                       ///< false for a back face
  float edges[4][3];                  ///< rectangle and disc: inward planes through the camera and the sides
  float cone[3], cone_cos, cone_sin;  ///< cylinder: bounding cone
};

/// The scene as seen from one pose, at one time of the recording.
class View {
 public:
  View(const Scene& scene, const Rigid3& T_world_camera, double t_s = 0);
  const std::vector<SurfaceInView>& surfaces() const { return surfaces_; }

  /// Nearest surface along the ray. `candidates`: indices to look at; null: all.
  Hit Trace(float x, float y, float z, const std::vector<std::uint16_t>* candidates = nullptr) const;

 private:
  std::vector<SurfaceInView> surfaces_;
};

/// The illuminance (lux, reflected: reflectance times incident illuminance) that leaves the scene at a hit towards a
/// camera whose pixel spans `pixel_angle` (1 / focal length).
float Luminance(const Scene& scene, const Hit& hit, float direction_norm, float pixel_angle);
/// Infrared reflectance at a hit, 0..1.
float InfraredReflectance(const Scene& scene, const Hit& hit, float footprint_m);

/// The rays of a camera's pixels and of its tiles.
class RayGrid {
 public:
  static constexpr int kTile = 16;
  explicit RayGrid(const Camera& camera);

  int width() const { return width_; }
  int height() const { return height_; }
  int tile_columns() const { return tile_columns_; }
  int tile_rows() const { return tile_rows_; }
  float pixel_angle() const { return pixel_angle_; }
  /// Rows are padded to a multiple of kTile pixels.
  int stride() const { return stride_; }
  const float* x(int row) const { return &x_[static_cast<std::size_t>(row) * stride_]; }
  const float* y(int row) const { return &y_[static_cast<std::size_t>(row) * stride_]; }
  const float* norm(int row) const { return &norm_[static_cast<std::size_t>(row) * stride_]; }
  /// False where no ray reaches the pixel (distortion folds back); such pixels look along the optical axis.
  bool valid(int row, int column) const { return valid_[static_cast<std::size_t>(row) * stride_ + column] != 0; }
  /// The ray of a point (dx, dy) px off a pixel's centre.
  void SubPixelRay(int row, int column, float dx, float dy, float* x, float* y) const;

  struct Tile {
    float corners[4][2];  ///< bounds of the rays of the tile and kMargin px around it
    float centre[3], cone_cos, cone_sin;
  };
  static constexpr float kMargin_px = 2.5F;
  const Tile& tile(int tile_row, int tile_column) const { return tiles_[tile_row * tile_columns_ + tile_column]; }

 private:
  int width_, height_, stride_, tile_columns_, tile_rows_;
  float pixel_angle_;
  std::vector<float> x_, y_, norm_;
  std::vector<std::uint8_t> valid_;
  std::vector<Tile> tiles_;
};

/// Surfaces that a tile may see. Valid for every view that differs by less than RayGrid::kMargin_px - 1 px of flow.
void FindCandidates(const View& view, const RayGrid::Tile& tile, std::vector<std::uint16_t>* candidates);

/// Renders rows of one tile row: luminance of every pixel, antialiased where surfaces meet.
/// `scratch` is reused between calls of one thread.
class BandRenderer {
 public:
  BandRenderer(const Scene& scene, const RayGrid& rays) : scene_(scene), rays_(rays) {}

  /// Writes kTile (or fewer, at the bottom) rows of `stride()` values into `luminance`, the nearest distance of each
  /// tile into `nearest_m` (tile_columns values), and leaves candidates and antialiasing marks for LuminanceOf.
  void Render(const View& view, int tile_row, float* luminance, float* nearest_m);

  /// Only the hits of a tile row's pixels, for sensors that measure distance; read them with HitAt.
  void Trace(const View& view, int tile_row);
  Hit HitAt(int row, int column) const {
    const std::size_t i = static_cast<std::size_t>(row - tile_row_ * RayGrid::kTile + 1) * rays_.stride() + column;
    return {surface_[i], distance_[i], a_[i], b_[i], slant_[i]};
  }

  /// Luminance of one pixel of the band rendered last, from a slightly different view.
  float LuminanceOf(const View& view, int row, int column) const;

 private:
  void Prepare(const View& view, int tile_row);
  void TraceRow(const View& view, int row, int slot);
  void ShadeRow(int slot, int row, float* luminance, float* nearest_m) const;
  float Antialiased(const View& view, int row, int column, const std::vector<std::uint16_t>& candidates) const;

  const Scene& scene_;
  const RayGrid& rays_;
  int tile_row_ = 0;
  std::vector<std::vector<std::uint16_t>> candidates_;  // per tile of this row
  std::vector<float> distance_, a_, b_, slant_;         // (kTile + 2) rows
  std::vector<std::int32_t> surface_;
  std::vector<std::uint8_t> antialias_;  // kTile rows
};

}  // namespace devo::sim
