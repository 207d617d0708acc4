// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/texture.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <stdexcept>

#include <opencv2/imgproc.hpp>

#include "devo/sim/random.h"

namespace devo::sim {
namespace {

constexpr int kSize = 1024;       // texels per side
constexpr int kOversampling = 2;  // drawn larger, then averaged: edges inside a texel keep their position

/// Draws the same shape at all offsets by one period, so that the texture repeats without a seam.
template <typename Draw>
void Periodic(const cv::Point2d& centre, double radius, int size, Draw&& draw) {
  for (int oy = -1; oy <= 1; ++oy) {
    for (int ox = -1; ox <= 1; ++ox) {
      const cv::Point2d c(centre.x + ox * size, centre.y + oy * size);
      if (c.x + radius > 0 && c.y + radius > 0 && c.x - radius < size && c.y - radius < size) draw(c);
    }
  }
}

/// Smooth periodic noise, zero mean, unit deviation, features of about `cell` texels.
cv::Mat1f Noise(Rng& rng, int size, int cell) {
  const int n = std::max(2, size / cell);
  cv::Mat1f coarse(n, n);
  for (auto& v : coarse) v = static_cast<float>(rng.Gaussian());
  cv::Mat1f wrapped, fine;
  cv::copyMakeBorder(coarse, wrapped, 2, 2, 2, 2, cv::BORDER_WRAP);
  const double scale = static_cast<double>(size) / n;
  cv::resize(wrapped, fine, {}, scale, scale, cv::INTER_CUBIC);
  const int border = static_cast<int>(2 * scale);
  cv::Mat1f out = fine(cv::Rect(border, border, size, size)).clone();
  cv::Scalar mean, deviation;
  cv::meanStdDev(out, mean, deviation);
  out = (out - mean[0]) / std::max(1e-6, deviation[0]);
  return out;
}

/// Discs and rectangles that occlude each other, sizes distributed as 1/r^3: the statistics of natural images at
/// every scale (Lee, Mumford, Huang 2001). `weak` is the share of shapes that differ little from their ground.
cv::Mat1f DeadLeaves(Rng& rng, int size, double min_radius, double max_radius, double weak, double lo, double hi) {
  cv::Mat1f image(size, size, static_cast<float>(0.5 * (lo + hi)));
  const int shapes = static_cast<int>(2.2 * size * size / (3.14 * min_radius * min_radius * 10));
  for (int i = 0; i < shapes; ++i) {
    const double q = rng.Uniform();
    const double r = 1 / std::sqrt(q / (min_radius * min_radius) + (1 - q) / (max_radius * max_radius));
    const cv::Point2d c(rng.Uniform(0, size), rng.Uniform(0, size));
    const double angle = rng.Uniform(0, 180), aspect = rng.Uniform(0.4, 1.0);
    const bool round = rng.Uniform() < 0.4;
    const double under = image(static_cast<int>(c.y) % size, static_cast<int>(c.x) % size);
    double value = rng.Uniform(lo, hi);
    if (rng.Uniform() < weak) value = std::clamp(under * rng.Uniform(0.8, 1.25), lo, hi);
    Periodic(c, 1.5 * r, size, [&](const cv::Point2d& p) {
      if (round) {
        cv::ellipse(image, cv::RotatedRect(p, cv::Size2d(2 * r, 2 * r * aspect), angle), cv::Scalar(value), cv::FILLED);
      } else {
        cv::Point2f corners[4];
        cv::RotatedRect(p, cv::Size2d(2 * r, 2 * r * aspect), angle).points(corners);
        std::vector<cv::Point> polygon(corners, corners + 4);
        cv::fillConvexPoly(image, polygon, cv::Scalar(value));
      }
    });
  }
  return image;
}

cv::Mat1f Poster(Rng& rng, int size) { return DeadLeaves(rng, size, size / 32.0, size / 4.0, 0.6, 0.16, 0.7); }
cv::Mat1f Leaves(Rng& rng, int size) { return DeadLeaves(rng, size, size / 55.0, size / 4.0, 0.6, 0.16, 0.7); }

cv::Mat1f Checker(Rng& rng, int size) {
  cv::Mat1f image(size, size);
  const int cell = size / 8;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) image(y, x) = ((x / cell + y / cell) % 2 != 0) ? 0.6F : 0.16F;
  }
  image += 0.006 * Noise(rng, size, size / 64);
  return image;
}

cv::Mat1f Wood(Rng& rng, int size) {
  const cv::Mat1f bend = Noise(rng, size, size / 3), grain = Noise(rng, size, size / 256);
  cv::Mat1f image(size, size);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const double rings = std::sin(6.2832 * (9.0 * y / size + 0.35 * bend(y, x)));
      image(y, x) = static_cast<float>(0.42 + 0.012 * rings * std::abs(rings) + 0.004 * grain(y, (x / 16) * 16 % size));
    }
  }
  for (int i = 0; i < 5; ++i) {
    const cv::Point2d c(rng.Uniform(0, size), rng.Uniform(0, size));
    const double r = rng.Uniform(0.006, 0.02) * size, v = rng.Uniform(0.15, 0.3);
    Periodic(c, r, size, [&](const cv::Point2d& p) {
      cv::ellipse(image, cv::RotatedRect(p, cv::Size2d(4 * r, 1.4 * r), 0), cv::Scalar(v), cv::FILLED);
    });
  }
  return image;
}

/// Spines of books, or lines of print: stripes of random width with marks on them.
cv::Mat1f Books(Rng& rng, int size) {
  cv::Mat1f image(size, size);
  for (int x = 0; x < size;) {
    int width = static_cast<int>(rng.Uniform(0.05, 0.13) * size);
    if (x + width > size - size / 50) width = size - x;
    const double value = rng.Uniform(0.22, 0.48),
                 ink = value * (value > 0.35 ? rng.Uniform(0.5, 0.9) : rng.Uniform(1.1, 1.8));
    image(cv::Rect(x, 0, width, size)) = static_cast<float>(value);
    image(cv::Rect(x, 0, std::max(2, width / 14), size)) = static_cast<float>(0.6 * value);
    const int y0 = static_cast<int>(rng.Uniform(0.08, 0.4) * size), letters = static_cast<int>(rng.Uniform(3, 10));
    for (int k = 0; k < letters; ++k) {
      const int letter = std::max(4, width / 3), y = y0 + k * letter * 5 / 4;
      if (y + letter >= size) break;
      image(cv::Rect(x + width / 3, y, letter, std::max(2, letter / 3))) = static_cast<float>(ink);
      if (rng.Uniform() < 0.6)
        image(cv::Rect(x + width / 3, y, std::max(2, letter / 3), letter)) = static_cast<float>(ink);
    }
    x += width;
  }
  return image;
}

cv::Mat1f Grid(Rng& rng, int size, int columns, int rows, double shift, double joint_value, double value,
               double spread) {
  cv::Mat1f image(size, size, static_cast<float>(joint_value));
  const int joint = std::max(2, size / 160);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const double v = value * (1 + spread * rng.Gaussian());
      const int x0 = static_cast<int>((c + (r % 2) * shift) * size / columns), y0 = r * size / rows;
      const int w = size / columns - joint, h = size / rows - joint;
      for (int o = -size; o <= 0; o += size) {
        const cv::Rect cell = cv::Rect(x0 + o, y0, w, h) & cv::Rect(0, 0, size, size);
        if (cell.area() > 0) image(cell) = static_cast<float>(v);
      }
    }
  }
  return image;
}

cv::Mat1f Brick(Rng& rng, int size) {
  cv::Mat1f image = Grid(rng, size, 8, 16, 0.5, 0.4, 0.28, 0.08);
  image += 0.008 * Noise(rng, size, size / 128);
  return image;
}

cv::Mat1f Tiles(Rng& rng, int size) {
  cv::Mat1f image = Grid(rng, size, 4, 4, 0, 0.2, 0.6, 0.08);
  image += 0.02 * Noise(rng, size, size / 16) + 0.006 * Noise(rng, size, size / 128);
  return image;
}

cv::Mat1f Carpet(Rng& rng, int size) {
  cv::Mat1f image = 0.3 + 0.006 * Noise(rng, size, size / 160) + 0.012 * Noise(rng, size, size / 16);
  for (int i = 0; i < 12; ++i) {
    const cv::Point2d c(rng.Uniform(0, size), rng.Uniform(0, size));
    const double r = rng.Uniform(0.04, 0.14) * size, v = rng.Uniform(0.12, 0.6);
    const int thickness = static_cast<int>(rng.Uniform(0.006, 0.02) * size);
    Periodic(c, r, size, [&](const cv::Point2d& p) {
      cv::ellipse(image, cv::RotatedRect(p, cv::Size2d(2 * r, 2 * r), 0), cv::Scalar(v), thickness);
    });
  }
  return image;
}

cv::Mat1f Fabric(Rng& rng, int size) {
  cv::Mat1f image = 0.34 + 0.004 * Noise(rng, size, size / 200) + 0.02 * Noise(rng, size, size / 6);
  for (int k = 0; k < 4; ++k) {  // seams
    const int p = static_cast<int>((k + 0.3) * size / 4);
    cv::line(image, {p, 0}, {p, size}, cv::Scalar(0.24), std::max(2, size / 250));
  }
  return image;
}

cv::Mat1f Plaster(Rng& rng, int size) {
  cv::Mat1f image = 0.68 + 0.006 * Noise(rng, size, size / 128) + 0.03 * Noise(rng, size, size / 8);
  for (int i = 0; i < 10; ++i) {  // stains and scratches
    const cv::Point2d a(rng.Uniform(0, size), rng.Uniform(0, size));
    const cv::Point2d b = a + cv::Point2d(rng.Uniform(-0.1, 0.1) * size, rng.Uniform(-0.1, 0.1) * size);
    cv::line(image, a, b, cv::Scalar(rng.Uniform(0.45, 0.62)), std::max(2, size / 300));
  }
  return image;
}

cv::Mat1f Metal(Rng& rng, int size) {
  cv::Mat1f image = 0.35 + 0.02 * Noise(rng, size, size / 64);
  for (int k = 0; k < 6; ++k) {
    const int p = static_cast<int>((k + 0.5) * size / 6);
    cv::line(image, {0, p}, {size, p}, cv::Scalar(k % 2 != 0 ? 0.12 : 0.7), std::max(2, size / 60));
  }
  return image;
}

cv::Mat1f Plain(Rng& rng, int size) { return 0.5 + 0.01 * Noise(rng, size, size / 4); }

using Generator = std::function<cv::Mat1f(Rng&, int)>;
const std::map<std::string, Generator>& Generators() {
  static const std::map<std::string, Generator> generators = {
      {"dead_leaves", Leaves}, {"poster", Poster}, {"checker", Checker}, {"wood", Wood},
      {"books", Books},        {"brick", Brick},   {"carpet", Carpet},   {"fabric", Fabric},
      {"plaster", Plaster},    {"tiles", Tiles},   {"metal", Metal},     {"plain", Plain}};
  return generators;
}

}  // namespace

std::vector<std::string> TextureNames() {
  std::vector<std::string> names;
  for (const auto& g : Generators()) names.push_back(g.first);
  return names;
}

Texture Texture::Make(const std::string& name, std::uint64_t seed) {
  const auto found = Generators().find(name);
  if (found == Generators().end()) {
    std::string known;
    for (const auto& n : TextureNames()) known += (known.empty() ? "" : ", ") + n;
    throw std::invalid_argument("texture '" + name + "' is not known; expected one of " + known);
  }
  static std::mutex mutex;
  static std::map<std::pair<std::string, std::uint64_t>, Texture> made;
  const std::lock_guard<std::mutex> lock(mutex);
  const auto known = made.find({name, seed});
  if (known != made.end()) return known->second;
  Rng rng(seed, 0x7e57);
  cv::Mat1f large = found->second(rng, kSize * kOversampling), image;
  cv::resize(large, image, {kSize, kSize}, 0, 0, cv::INTER_AREA);
  return made.emplace(std::make_pair(name, seed), Texture(cv::Mat1f(cv::min(cv::max(image, 0.02), 0.95))))
      .first->second;
}

Texture Texture::Grating(double mean, double modulation, double period_texels) {
  Texture t;
  t.is_grating_ = true;
  t.mean_ = static_cast<float>(mean);
  t.modulation_ = static_cast<float>(modulation);
  t.period_ = static_cast<float>(period_texels);
  return t;
}

Texture::Texture(const cv::Mat1f& reflectance) : width_(reflectance.cols), height_(reflectance.rows) {
  const auto power_of_two = [](int n) { return n > 0 && (n & (n - 1)) == 0; };
  if (!power_of_two(width_) || !power_of_two(height_)) {
    throw std::invalid_argument("texture of " + std::to_string(width_) + "x" + std::to_string(height_) +
                                " texels; expected powers of two");
  }
  std::vector<Level> levels;
  for (cv::Mat1f image = reflectance;;) {
    Level level;
    level.mask_x = image.cols - 1;
    level.mask_y = image.rows - 1;
    while ((1 << level.shift) < image.cols) ++level.shift;
    level.texels.reserve(image.total());
    for (const float v : image) level.texels.push_back(static_cast<std::uint16_t>(std::lround(v / kTexelUnit)));
    levels.push_back(std::move(level));
    if (image.cols < 4 || image.rows < 4) break;
    cv::Mat1f half;
    cv::resize(image, half, {image.cols / 2, image.rows / 2}, 0, 0, cv::INTER_AREA);
    image = half;
  }
  levels_ = std::make_shared<const std::vector<Level>>(std::move(levels));
}

float Texture::SampleGrating(float s, float footprint) const {
  const float blur = 3.14159265F * footprint / period_;  // 2 pi sigma / period, sigma half a footprint
  return mean_ * (1 + modulation_ * std::exp(-0.5F * blur * blur) * std::sin(6.2831853F * s / period_));
}

}  // namespace devo::sim
