// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/depth_sensor.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include <opencv2/imgproc.hpp>

#include "devo/sim/random.h"

namespace devo::sim {
namespace {

// Parts of an exposure, and where in the pixel each looks: together they cover the pixel and the exposure.
constexpr double kParts[5][2] = {{-0.3, -0.4}, {0.4, -0.2}, {0.0, 0.0}, {-0.4, 0.2}, {0.3, 0.4}};
constexpr int kMiddle = 2;
constexpr double kModulation_Hz = 200e6;
constexpr double kLight_m_s = 299792458;

}  // namespace

double DepthModel::NoiseSigma(double z_m, double reflectance, double cosine) const {
  const double signal = std::max(1e-6, reflectance * cosine / (z_m * z_m));
  return std::sqrt(noise_floor_m * noise_floor_m + noise_gain_m * noise_gain_m / signal);
}

DepthModel AzureKinect() {
  DepthModel m;
  m.camera = Camera(640, 576, 504.574, 504.674, 321.848, 336.139, "rational_polynomial",
                    {5.3633, 3.35493, -1.08168e-05, -1.43868e-05, 0.163032, 5.69124, 5.13437, 0.887861});
  m.T_event_depth = Rigid3(ExpSO3({0.021, -0.014, 0.006}), {0.062, -0.031, 0.008});
  return m;
}

DepthModel RegisteredDepth(const Camera& event_camera) {
  DepthModel m;
  m.camera = event_camera;
  m.exact = true;
  m.corner_mask = false;
  m.min_range_m = 0;
  m.max_range_m = 65;
  return m;
}

DepthSensor::DepthSensor(const Scene& scene, const DepthModel& model, std::uint64_t seed)
    : scene_(scene), model_(model), seed_(seed) {
  const Camera& c = model_.camera;
  const char* names[] = {"none", "plumb_bob", "rational_polynomial", "equidistant"};
  for (const auto& part : kParts) {
    const bool middle = part[0] == 0 && part[1] == 0;
    if (model_.exact && !middle) continue;
    rays_.push_back(
        std::make_unique<RayGrid>(Camera(c.width(), c.height(), c.fx(), c.fy(), c.cx() - part[0], c.cy() - part[1],
                                         names[static_cast<int>(c.distortion())], c.coefficients())));
  }
}

cv::Mat1f DepthSensor::Capture(const Trajectory& trajectory, double t_s, std::uint64_t index, ThreadPool* pool) const {
  std::vector<View> views;
  for (std::size_t k = 0; k < rays_.size(); ++k) {
    const double share = rays_.size() == 1 ? 0 : (static_cast<double>(k) - kMiddle) / static_cast<double>(rays_.size());
    const double at_s = t_s + share * model_.exposure_s;
    views.emplace_back(scene_, trajectory.PoseAt(at_s) * model_.T_event_depth, at_s);
  }
  cv::Mat1f depth(model_.camera.height(), model_.camera.width(), 0.0F);
  pool->ForEach(rays_[0]->tile_rows(), [&](int tile_row) { MeasureBand(views, tile_row, index, &depth); });
  if (model_.multipath > 0 && !model_.exact) AddMultipath(&depth);
  return depth;
}

void DepthSensor::MeasureBand(const std::vector<View>& views, int tile_row, std::uint64_t index,
                              cv::Mat1f* depth) const {
  std::vector<BandRenderer> bands;
  for (std::size_t k = 0; k < rays_.size(); ++k) {
    bands.emplace_back(scene_, *rays_[k]);
    bands.back().Trace(views[k], tile_row);
  }
  std::vector<Hit> hits(rays_.size());
  const int end = std::min((tile_row + 1) * RayGrid::kTile, depth->rows);
  for (int row = tile_row * RayGrid::kTile; row < end; ++row) {
    for (int column = 0; column < depth->cols; ++column) {
      const RayGrid& centre = *rays_[rays_.size() / 2];
      if (!centre.valid(row, column)) continue;
      for (std::size_t k = 0; k < bands.size(); ++k) hits[k] = bands[k].HitAt(row, column);
      (*depth)(row, column) = Measure(hits, row, column, index);
    }
  }
}

float DepthSensor::Measure(const std::vector<Hit>& hits, int row, int column, std::uint64_t index) const {
  const Hit& middle = hits[hits.size() / 2];
  const auto in_range = [&](double z) { return z >= model_.min_range_m && z <= model_.max_range_m; };
  if (model_.exact) return middle.surface >= 0 && in_range(middle.distance) ? middle.distance : 0;
  const Camera& camera = model_.camera;
  if (model_.corner_mask &&
      std::abs(2.0 * column / camera.width() - 1) + std::abs(2.0 * row / camera.height() - 1) > 1.6)
    return 0;
  const float norm = rays_[hits.size() / 2]->norm(row)[column];
  float lo = middle.distance, hi = middle.distance;
  for (const auto& hit : hits) {
    if (hit.surface < 0) return 0;
    lo = std::min(lo, hit.distance);
    hi = std::max(hi, hit.distance);
  }
  const auto reflectance = [&](const Hit& hit) {
    return InfraredReflectance(scene_, hit, hit.distance / static_cast<float>(camera.fx()));
  };
  const auto cosine = [&](const Hit& hit) { return 1.0 / (hit.slant * norm); };
  const double rho = reflectance(middle), cos_middle = cosine(middle);
  double z = 0, signal = 0;
  if (hi - lo < 0.03F * lo) {  // one surface: the mean over pixel and exposure
    for (const auto& hit : hits) z += hit.distance / static_cast<double>(hits.size());
    signal = rho * cos_middle / (z * z);
  } else {  // a silhouette: the sensor adds the returning waves of both distances
    std::complex<double> wave = 0;
    double amplitude = 0;
    for (const auto& hit : hits) {
      const double a = reflectance(hit) * cosine(hit) / (hit.distance * hit.distance);
      wave += std::polar(a, 4 * 3.14159265358979 * kModulation_Hz * (hit.distance - lo) / kLight_m_s);
      amplitude += a;
      z += a * hit.distance;
    }
    if (std::abs(wave) < model_.min_coherence * amplitude) return 0;
    z /= amplitude;
    signal = std::abs(wave) / static_cast<double>(hits.size());
  }
  if (!in_range(z) || signal < model_.min_signal) return 0;
  Rng rng(seed_, Mix(index) ^ 0xde974, static_cast<std::uint64_t>(row) * camera.width() + column);
  z += model_.systematic_m * std::sin(6.283185307 * 2 * kModulation_Hz * z / kLight_m_s);
  z += rng.Gaussian() *
       std::sqrt(model_.noise_floor_m * model_.noise_floor_m + model_.noise_gain_m * model_.noise_gain_m / signal);
  return static_cast<float>(z);
}

void DepthSensor::AddMultipath(cv::Mat1f* depth) const {
  // Light that takes a detour over the other side of a corner arrives later: corners look deeper and rounder.
  constexpr int kReach_px = 31;
  constexpr float kSameBody_m = 0.15F;
  cv::Mat1f sum, weight, valid = (*depth > 0) / 255;
  cv::boxFilter(*depth, sum, CV_32F, {kReach_px, kReach_px}, {-1, -1}, false);
  cv::boxFilter(valid, weight, CV_32F, {kReach_px, kReach_px}, {-1, -1}, false);
  for (int y = 0; y < depth->rows; ++y) {
    for (int x = 0; x < depth->cols; ++x) {
      float& z = (*depth)(y, x);
      if (z <= 0) continue;
      const float nearer = z - sum(y, x) / std::max(1.0F, weight(y, x));
      if (nearer > 0 && nearer < kSameBody_m) z += static_cast<float>(model_.multipath) * nearer;
    }
  }
}

}  // namespace devo::sim
