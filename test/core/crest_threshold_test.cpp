// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/crest_threshold.h"

#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "devo/core/crests.h"

namespace devo {
namespace {

constexpr double kBlur_px = 1;

/// Single events at random places, so many per pixel in the mean.
cv::Mat1w Noise(double per_pixel) {
  std::mt19937 random(1);
  cv::Mat1w image(260, 346, std::uint16_t{0});
  std::poisson_distribution<int> events(per_pixel);
  for (std::uint16_t& pixel : image) pixel = static_cast<std::uint16_t>(kEventWeight * events(random));
  return image;
}

/// Faint edges: every tenth column has an event in two of three pixels.
cv::Mat1w WithEdges(const cv::Mat1w& noise) {
  cv::Mat1w image = noise.clone();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 5; x < image.cols; x += 10) image(y, x) += y % 3 < 2 ? kEventWeight : 0;
  }
  return image;
}

cv::Mat1w Blurred(const cv::Mat1w& image) {
  cv::Mat1w scratch, blurred;
  Blur(image, kBlur_px, &scratch, &blurred);
  return blurred;
}

double CountFrom(const cv::Mat1w& image, int least) { return cv::countNonZero(image >= least); }

TEST(CrestThreshold, CountsOnlyPixelsThatAreNotZero) {
  cv::Mat1w image(40, 80, std::uint16_t{0});
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < 40; ++x) image(y, x) = static_cast<std::uint16_t>(8 * (x + 1));
  }
  EXPECT_EQ(CrestThreshold(image, 0.25, 0, kBlur_px), 80);
  EXPECT_EQ(CrestThreshold(image, 0.5, 0, kBlur_px), 160);
  EXPECT_EQ(CrestThreshold(image, 1, 0, kBlur_px), 320);
}

TEST(CrestThreshold, IsTheFirstThatHardlyAnyNoiseReaches) {
  for (const double per_pixel : {0.01, 0.02, 0.04}) {
    const cv::Mat1w noise = Noise(per_pixel), alone = Blurred(noise), both = Blurred(WithEdges(noise));
    const int threshold = CrestThreshold(both, 0.1, per_pixel, kBlur_px);
    EXPECT_LE(CountFrom(alone, threshold), 0.06 * CountFrom(both, threshold)) << per_pixel << " events per pixel";
    EXPECT_GE(CountFrom(alone, threshold - 8), 0.04 * CountFrom(both, threshold - 8)) << per_pixel;
  }
}

TEST(CrestThreshold, LeavesCrestsOfFaintEdgesAmongNoise) {
  const cv::Mat1w both = WithEdges(Noise(0.03)), blurred = Blurred(both);
  const auto count = [&](double noise_per_pixel) {
    std::vector<EdgePoint> crests;
    FindCrests(blurred, {}, CrestThreshold(blurred, 0.45, noise_per_pixel, kBlur_px), &crests);
    int of_edges = 0;
    for (const EdgePoint& crest : crests) of_edges += std::abs(std::fmod(crest.x, 10) - 5) < 1 ? 1 : 0;
    return std::pair<int, int>(of_edges, static_cast<int>(crests.size()) - of_edges);
  };
  const auto [edges_before, noise_before] = count(0);
  const auto [edges, noise] = count(0.03);
  EXPECT_GT(noise_before, edges_before / 10);  // else there would be nothing to leave out
  EXPECT_LT(noise, 0.2 * noise_before);
  EXPECT_GT(edges, 0.8 * edges_before);
}

TEST(CrestThreshold, IsTheQuantileWhereNoiseIsTooRareToMatter) {
  const cv::Mat1w blurred = Blurred(WithEdges(Noise(0.0005)));
  EXPECT_EQ(CrestThreshold(blurred, 0.45, 0.0005, kBlur_px), CrestThreshold(blurred, 0.45, 0, kBlur_px));
}

TEST(CrestThreshold, KeepsTheHighestWhereNoiseIsAllThereIs) {
  const cv::Mat1w blurred = Blurred(Noise(0.03));
  const int threshold = CrestThreshold(blurred, 0.45, 0.03, kBlur_px);
  EXPECT_GT(CountFrom(blurred, threshold), 0.02 * CountFrom(blurred, 8));
}

TEST(CrestThreshold, IsFiniteForAnEmptyImage) {
  const cv::Mat1w empty(40, 80, std::uint16_t{0});
  EXPECT_GT(CrestThreshold(empty, 0.45, 0.03, kBlur_px), 0);
}

}  // namespace
}  // namespace devo
