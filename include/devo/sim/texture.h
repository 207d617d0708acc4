// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace devo::sim {

/// Diffuse reflectance over a plane, periodic, with an image pyramid so that a pixel sees the mean over its
/// footprint and nothing aliases.
class Texture {
 public:
  /// `reflectance`: values 0..1; width and height powers of two, else std::invalid_argument.
  explicit Texture(const cv::Mat1f& reflectance);

  /// mean * (1 + modulation * sin(2 pi s / period)), s in texels; blurred in closed form by a Gaussian of half
  /// the footprint. For comparing events with theory.
  static Texture Grating(double mean, double modulation, double period_texels);

  /// Named procedural textures, see TextureNames(). `seed` chooses the instance; made once per process. Throws
  /// std::invalid_argument naming the texture and the known ones.
  static Texture Make(const std::string& name, std::uint64_t seed);

  /// Mean reflectance around (s, t), in texels of the finest level, over `footprint` texels (trilinear).
  float Sample(float s, float t, float footprint) const;

  /// Level k of the pyramid is 2^k times smaller than the finest. Rows of 2^shift texels.
  struct Level {
    int mask_x = 0, mask_y = 0, shift = 0;
    std::vector<std::uint16_t> texels;  // in kTexelUnit: half the memory of floats, which is what sampling waits for
  };
  /// The pyramid, empty for a grating; texels in units of kTexelUnit.
  const std::vector<Level>& levels() const { return *levels_; }
  static constexpr float kTexelUnit = 1.0F / 65535;

  int width() const { return width_; }
  int height() const { return height_; }

 private:
  Texture() = default;
  float SampleGrating(float s, float footprint) const;
  static float Bilinear(const Level& level, float s, float t);

  int width_ = 1, height_ = 1;
  std::shared_ptr<const std::vector<Level>> levels_ = std::make_shared<const std::vector<Level>>();  // shared by copies
  bool is_grating_ = false;
  float mean_ = 0, modulation_ = 0, period_ = 1;
};

// Inline: called hundreds of millions of times per simulated second.

inline float Texture::Bilinear(const Level& level, float s, float t) {
  const auto floor = [](float v) {
    const int i = static_cast<int>(v);
    return i - (v < static_cast<float>(i) ? 1 : 0);
  };
  const int x = floor(s), y = floor(t);
  const float fx = s - static_cast<float>(x), fy = t - static_cast<float>(y);
  const int x0 = x & level.mask_x, x1 = (x + 1) & level.mask_x;
  const std::uint16_t* row0 = &level.texels[static_cast<std::size_t>(y & level.mask_y) << level.shift];
  const std::uint16_t* row1 = &level.texels[static_cast<std::size_t>((y + 1) & level.mask_y) << level.shift];
  const float a = row0[x0], b = row0[x1], c = row1[x0], d = row1[x1];
  const float top = a + fx * (b - a), bottom = c + fx * (d - c);
  return kTexelUnit * (top + fy * (bottom - top));
}

inline float Texture::Sample(float s, float t, float footprint) const {
  if (is_grating_) return SampleGrating(s, footprint);
  // log2, continuous and monotonic, off by less than 0.09: it chooses between levels.
  footprint = footprint > 1.0F ? footprint : 1.0F;
  std::uint32_t bits;
  std::memcpy(&bits, &footprint, sizeof bits);
  const float lod = static_cast<float>(bits) * (1.0F / (1 << 23)) - 127.0F;
  const std::vector<Level>& levels = *levels_;
  const int last = static_cast<int>(levels.size()) - 1;
  const int k = lod < static_cast<float>(last) ? static_cast<int>(lod) : last;
  // Texel centres of level k lie at (i + 0.5) 2^k of the finest.
  const float scale = 1.0F / static_cast<float>(1 << k);
  const float fine = Bilinear(levels[k], s * scale - 0.5F, t * scale - 0.5F);
  if (lod <= 0 || k == last) return fine;
  const float coarse = Bilinear(levels[k + 1], 0.5F * s * scale - 0.5F, 0.5F * t * scale - 0.5F);
  return fine + (lod - static_cast<float>(k)) * (coarse - fine);
}

/// dead_leaves, poster, checker, wood, books, brick, carpet, fabric, plaster, tiles, metal, plain.
std::vector<std::string> TextureNames();

}  // namespace devo::sim
