// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/ray_tracer.h"

#include <cmath>

#include <gtest/gtest.h>

#include "devo/sim/random.h"
#include "devo/sim/sensors.h"
#include "sim/sim_test_scenes.h"

namespace devo::sim {
namespace {

cv::Mat1f Uniform(float v) { return cv::Mat1f(2, 2, v); }

/// A scene's nearest hit in double precision, straight from the definition of its surfaces.
double DistanceByDefinition(const Scene& scene, const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
  double nearest = 1e300;
  for (const Surface& s : scene.surfaces()) {
    if (s.kind == SurfaceKind::kCylinder) {
      const Eigen::Vector3d p = o - s.origin, d_across = d - d.dot(s.n) * s.n, p_across = p - p.dot(s.n) * s.n;
      const double A = d_across.squaredNorm(), B = d_across.dot(p_across),
                   C = p_across.squaredNorm() - s.size_u * s.size_u;
      if (B * B - A * C <= 0) continue;
      const double t = (-B - std::sqrt(B * B - A * C)) / A, height = (p + t * d).dot(s.n);
      if (t > 0 && height >= 0 && height <= s.size_v) nearest = std::min(nearest, t);
      continue;
    }
    const double facing = d.dot(s.n);
    if (s.one_sided && facing > 0) continue;
    const double t = (s.origin - o).dot(s.n) / facing;
    const Eigen::Vector3d p = o + t * d - s.origin;
    const double a = p.dot(s.u), b = p.dot(s.v);
    const bool inside = s.kind == SurfaceKind::kDisc ? a * a + b * b <= s.size_u * s.size_u
                                                     : a >= 0 && b >= 0 && a <= s.size_u && b <= s.size_v;
    if (t > 0 && inside) nearest = std::min(nearest, t);
  }
  return nearest;
}

class NamedScene : public testing::TestWithParam<std::string> {};

TEST_P(NamedScene, HasTheDepthOfItsDefinitionToATenthOfAMillimetreAtEveryPixel) {
  const Scene scene = MakeScene(GetParam());
  const Camera camera(160, 120, 130, 131, 79, 60, "plumb_bob", {-0.12, 0.1, 0.001, -0.001});
  const RayGrid rays(camera);
  BandRenderer renderer(scene, rays);
  Rng rng(4);
  int wrong = 0, pixels = 0;
  for (int view_index = 0; view_index < 4; ++view_index) {
    const Eigen::Vector3d p = 0.5 * (scene.motion.position_min + scene.motion.position_max);
    const Rigid3 T(ExpSO3({rng.Uniform(-3, 3), rng.Uniform(-3, 3), rng.Uniform(-3, 3)}), p);
    const View view(scene, T);
    for (int band = 0; band < rays.tile_rows(); ++band) {
      renderer.Trace(view, band);
      for (int row = band * 16; row < std::min(120, band * 16 + 16); ++row) {
        for (int column = 0; column < 160; ++column) {
          const auto ray = camera.Unproject({column, row});
          ASSERT_TRUE(ray);
          const double expected = DistanceByDefinition(scene, T.translation(), T.rotation() * *ray);
          // A ray that grazes a silhouette may fall on either side of it in single precision.
          ++pixels;
          if (!(std::abs(renderer.HitAt(row, column).distance - expected) < 1e-4)) ++wrong;
        }
      }
    }
  }
  EXPECT_LE(wrong, pixels / 5000);
}

INSTANTIATE_TEST_SUITE_P(All, NamedScene, testing::ValuesIn(SceneNames()),
                         [](const testing::TestParamInfo<std::string>& info) { return info.param; });

TEST(BandRenderer, ChangesAPixelInSmallStepsWhenASilhouetteMovesAcrossIt) {
  Scene scene = WallScene(2, Texture(Uniform(0.2F)));
  Material white{scene.AddTexture(Texture(Uniform(0.8F))), 1, 1, 0.85};
  Eigen::Matrix3d R;
  R << -1, 0, 0, 0, 1, 0, 0, 0, -1;
  scene.AddRectangle({Eigen::Quaterniond(R), {0, -1, 1}}, 1, 2, white);  // covers x < 0 at 1 m
  scene.BakeLight(100);
  const RayGrid rays(Camera(33, 17, 100, 100, 16, 8, "none", {}));
  BandRenderer renderer(scene, rays);
  std::vector<float> light(16 * static_cast<std::size_t>(rays.stride())), nearest(rays.tile_columns());
  float last = -1;
  for (double shift_px = -0.8; shift_px <= 0.8; shift_px += 0.02) {
    renderer.Render(View(scene, Rigid3::Translation({-0.01 * shift_px, 0, 0})), 0, light.data(), nearest.data());
    const float value = light[8 * static_cast<std::size_t>(rays.stride()) + 16];
    if (last >= 0) {
      EXPECT_GE(value, last - 1e-3F);
      EXPECT_LE(value - last, 60.0F / 8 * 1.2F);
    }
    last = value;
  }
  EXPECT_FLOAT_EQ(nearest[0], 1.0F);
}

TEST(BandRenderer, ShadesEightPixelsAtOnceAsItShadesOne) {
  Scene scene = MakeScene("table");
  scene.BakeLight(100);
  const RayGrid rays(Camera(160, 48, 130, 130, 79, 24, "plumb_bob", {-0.12, 0.1, 0.001, -0.001}));
  BandRenderer renderer(scene, rays);
  const Eigen::Vector3d p = 0.5 * (scene.motion.position_min + scene.motion.position_max);
  const View view(scene, Rigid3(ExpSO3({-1.9, 0.1, 0.2}), p));
  std::vector<float> light(16 * static_cast<std::size_t>(rays.stride())), nearest(rays.tile_columns());
  for (int band = 0; band < 3; ++band) {
    renderer.Render(view, band, light.data(), nearest.data());
    for (int row = 0; row < 16; ++row) {
      for (int column = 0; column < 160; ++column) {
        const float one = renderer.LuminanceOf(view, 16 * band + row, column);
        ASSERT_GT(one, 0);
        EXPECT_NEAR(light[static_cast<std::size_t>(row) * rays.stride() + column] / one, 1, 1e-3);
      }
    }
  }
}

TEST(Texture, DoesNotAliasBecauseAWideFootprintSeesTheMean) {
  cv::Mat1f stripes(256, 256);
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) stripes(y, x) = x % 2 != 0 ? 0.9F : 0.1F;
  }
  const Texture texture(stripes);
  for (float s = 0; s < 4; s += 0.13F) EXPECT_NEAR(texture.Sample(s, 3, 8), 0.5, 0.002);
  EXPECT_NEAR(texture.Sample(1.5F, 3.5F, 1), 0.9, 1e-4);
}

TEST(Texture, NamesTheKnownOnesWhenAskedForAnUnknownOne) {
  try {
    Texture::Make("velvet", 1);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find("velvet"), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("dead_leaves"), std::string::npos);
  }
}

TEST(Scene, IsLitWithTheMeanIlluminanceThatWasAskedFor) {
  Scene scene = MakeScene("table");
  scene.BakeLight(40);
  double flux = 0, area = 0;
  for (const Surface& s : scene.surfaces()) {
    if (s.kind != SurfaceKind::kRectangle) continue;
    double mean = 0;
    for (const float lux : s.light_lux) mean += lux / static_cast<double>(s.light_lux.size());
    flux += mean * s.size_u * s.size_v;
    area += s.size_u * s.size_v;
  }
  EXPECT_NEAR(flux / area, 40, 1);
}

}  // namespace
}  // namespace devo::sim
