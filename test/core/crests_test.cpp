// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/crests.h"
#include "devo/core/crest_threshold.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

namespace devo {
namespace {

using ::testing::IsEmpty;
using ::testing::Not;

/// A straight line n . (p - center) = 0 in an image.
struct Line {
  double angle, cx, cy;  // of the normal; a point on it
  double nx() const { return std::cos(angle); }
  double ny() const { return std::sin(angle); }
  double Distance(double x, double y) const { return nx() * (x - cx) + ny() * (y - cy); }
};

/// A ridge of Gaussian profile, standard deviation 1.2 px.
cv::Mat1w Ridge(const Line& line, double height, int width_px = 48, int height_px = 40) {
  cv::Mat1w image(height_px, width_px);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double d = line.Distance(x, y);
      image(y, x) = static_cast<std::uint16_t>(std::lround(height * std::exp(-d * d / (2 * 1.2 * 1.2))));
    }
  }
  return image;
}

// The ridge is as narrow as that of a sharp surface. One step of second order from a pixel's centre is then good to a
// twentieth of a pixel on the whole, and to a fifth at the worst phase of a diagonal line.
TEST(Crests, LieOnAStraightRidgeAtAnyAngleAndOffset) {
  double sum2 = 0;
  std::size_t count = 0;
  for (double angle = 0; angle < M_PI; angle += M_PI / 16) {
    for (double offset = 0; offset < 1; offset += 0.125) {
      const Line line{angle, 24 + offset * std::cos(angle), 20 + offset * std::sin(angle)};
      std::vector<EdgePoint> crests;
      FindCrests(Ridge(line, 1000), {}, 500, &crests);
      for (const EdgePoint& crest : crests) {
        const double distance = line.Distance(crest.x, crest.y);
        sum2 += distance * distance;
        EXPECT_NEAR(distance, 0, 0.22) << "angle " << angle << " offset " << offset;
        EXPECT_GT(std::abs(crest.nx * line.nx() + crest.ny * line.ny()), 0.998) << "angle " << angle;
        EXPECT_NEAR(std::hypot(crest.nx, crest.ny), 1, 1e-5);
      }
      // The ridge crosses at least 34 rows or columns of the searched part.
      EXPECT_GE(crests.size(), 34U) << "angle " << angle << " offset " << offset;
      count += crests.size();
    }
  }
  EXPECT_LT(std::sqrt(sum2 / static_cast<double>(count)), 0.05);
}

TEST(Crests, LieOnAnUprightOrLyingRidgeToATwentiethOfAPixel) {
  for (const double angle : {0.0, M_PI / 2}) {
    for (double offset = 0; offset < 1; offset += 0.125) {
      const Line line{angle, 24 + offset * std::cos(angle), 20 + offset * std::sin(angle)};
      std::vector<EdgePoint> crests;
      FindCrests(Ridge(line, 1000), {}, 500, &crests);
      ASSERT_THAT(crests, Not(IsEmpty()));
      for (const EdgePoint& crest : crests) EXPECT_NEAR(line.Distance(crest.x, crest.y), 0, 0.05) << offset;
    }
  }
}

TEST(Crests, HaveTheHeightOfTheRidgeInEventsPerPixelAsStrength) {
  std::vector<EdgePoint> crests;
  FindCrests(Ridge({0, 24, 20}, 10 * kEventWeight), {}, 100, &crests);
  ASSERT_THAT(crests, Not(IsEmpty()));
  for (const EdgePoint& crest : crests) EXPECT_NEAR(crest.strength, 10, 0.01);
}

TEST(Crests, BelowTheThresholdAreNotFound) {
  cv::Mat1w image = Ridge({0, 12, 20}, 400);
  image += Ridge({0, 36, 20}, 900);
  std::vector<EdgePoint> crests;
  FindCrests(image, {}, 600, &crests);
  ASSERT_THAT(crests, Not(IsEmpty()));
  for (const EdgePoint& crest : crests) EXPECT_NEAR(crest.x, 36, 0.1);
}

TEST(Crests, AreNotFoundOnFlatImagesAndSlopes) {
  cv::Mat1w flat(40, 48, std::uint16_t{1000}), slope(40, 48);
  for (int y = 0; y < slope.rows; ++y) {
    for (int x = 0; x < slope.cols; ++x) slope(y, x) = static_cast<std::uint16_t>(500 + 40 * x + 10 * y);
  }
  std::vector<EdgePoint> crests;
  FindCrests(flat, {}, 100, &crests);
  EXPECT_THAT(crests, IsEmpty());
  FindCrests(slope, {}, 100, &crests);
  EXPECT_THAT(crests, IsEmpty());
}

/// Crests of random events scattered along the line x = 24.3, of which a share is ON.
std::vector<EdgePoint> CrestsOfEvents(double share_on) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  cv::Mat1w accumulated(40, 48, std::uint16_t{0}), scratch, blurred;
  SignedCounts signed_events(40, 48, std::int8_t{0});
  for (int y = 0; y < 40; ++y) {
    for (int k = 0; k < 20; ++k) {
      const int x = uniform(random) < 0.3 ? 25 : 24;
      accumulated(y, x) += kEventWeight;
      signed_events(y, x) += uniform(random) < share_on ? 1 : -1;
    }
  }
  Blur(accumulated, 1, &scratch, &blurred);
  std::vector<EdgePoint> crests;
  FindCrests(blurred, signed_events, CrestThreshold(blurred, 0.7, 0, 1), &crests);
  return crests;
}

TEST(Crests, HaveThePolarityOfTheirEvents) {
  for (const double share_on : {0.0, 0.5, 1.0}) {
    const auto crests = CrestsOfEvents(share_on);
    ASSERT_GE(crests.size(), 30U);
    double mean = 0;
    for (const EdgePoint& crest : crests) {
      mean += crest.polarity / static_cast<double>(crests.size());
      EXPECT_LE(std::abs(crest.polarity), 1);
    }
    EXPECT_NEAR(mean, 2 * share_on - 1, 0.15) << "ON: " << share_on;
  }
}

TEST(Crests, OfScatteredEventsLieOnTheirMean) {
  double sum = 0;
  const auto crests = CrestsOfEvents(1);
  for (const EdgePoint& crest : crests) sum += crest.x;
  EXPECT_NEAR(sum / static_cast<double>(crests.size()), 24.3, 0.1);
}

/// Events as many as chance makes of `mean(x, y)` per pixel, blurred as a surface is.
template <typename Mean>
std::vector<EdgePoint> CrestsOfTexture(const Mean& mean) {
  std::mt19937 random(7);
  cv::Mat1w accumulated(60, 80, std::uint16_t{0}), scratch, blurred;
  for (int y = 0; y < accumulated.rows; ++y) {
    for (int x = 0; x < accumulated.cols; ++x) {
      const double lambda = mean(x, y);
      const int events = lambda > 0 ? std::poisson_distribution<int>(lambda)(random) : 0;
      accumulated(y, x) = static_cast<std::uint16_t>(kEventWeight * std::min(events, 60));
    }
  }
  Blur(accumulated, 1, &scratch, &blurred);
  std::vector<EdgePoint> crests;
  FindCrests(blurred, {}, CrestThreshold(blurred, 0.45, 0, 1), &crests);
  return crests;
}

TEST(Crests, AreNextToNoneInTextureFinerThanTheSensorResolves) {
  // A period of two pixels, in stripes along either axis and in a chequerboard, on 4000 searched pixels.
  const auto stripes = CrestsOfTexture([](int x, int) { return x % 2 ? 12.0 : 2.0; });
  const auto lying = CrestsOfTexture([](int, int y) { return y % 2 ? 12.0 : 2.0; });
  const auto board = CrestsOfTexture([](int x, int y) { return (x + y) % 2 ? 12.0 : 2.0; });
  for (const auto* crests : {&stripes, &lying, &board}) EXPECT_LT(crests->size(), 20U);
}

TEST(Crests, OfAnIsolatedLineOfTheSameEventsAreFoundInEveryRow) {
  const auto crests = CrestsOfTexture([](int x, int) { return x == 40 ? 12.0 : 0.0; });
  EXPECT_GE(crests.size(), 54U);  // rows that are searched
  for (const EdgePoint& crest : crests) EXPECT_NEAR(crest.x, 40, 0.3);
}

TEST(Crests, OfALineThatRisesAboveFineTextureAreFound) {
  const auto crests = CrestsOfTexture([](int x, int y) { return x == 40 ? 40.0 : (x + y) % 2 ? 6.0 : 1.0; });
  const auto on_line =
      std::count_if(crests.begin(), crests.end(), [](const EdgePoint& crest) { return std::abs(crest.x - 40) < 0.5; });
  EXPECT_GE(on_line, 50);
}

TEST(Crests, OfTwoLinesAreFoundWhenTheyAreSixPixelsApart) {
  const auto crests = CrestsOfTexture([](int x, int) { return x == 37 || x == 43 ? 12.0 : 0.0; });
  EXPECT_GE(crests.size(), 108U);
}

TEST(Blur, OfOnePixelIsTheBinomialKernelWhoseSumIsThePixel) {
  cv::Mat1w image(11, 12, std::uint16_t{0}), scratch, blurred;
  image(5, 6) = 2560;
  Blur(image, 1, &scratch, &blurred);
  const int kernel[] = {1, 4, 6, 4, 1};
  int sum = 0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const bool inside = std::abs(y - 5) <= 2 && std::abs(x - 6) <= 2;
      EXPECT_EQ(blurred(y, x), inside ? 10 * kernel[y - 3] * kernel[x - 4] : 0) << x << " " << y;
      sum += blurred(y, x);
    }
  }
  EXPECT_EQ(sum, 2560);
}

TEST(Blur, KeepsAConstantAndMakesTheOutermostTwoPixelsZero) {
  for (const double sigma_px : {0.0, 0.5, 0.8, 1.0, 1.2}) {
    const cv::Mat1w image(9, 13, std::uint16_t{4095});
    cv::Mat1w scratch, blurred;
    Blur(image, sigma_px, &scratch, &blurred);
    ASSERT_EQ(blurred.size(), image.size());
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const bool inside = x >= 2 && y >= 2 && x < image.cols - 2 && y < image.rows - 2;
        EXPECT_EQ(blurred(y, x), inside ? 4095 : 0) << "sigma " << sigma_px << " at " << x << " " << y;
      }
    }
  }
}

}  // namespace
}  // namespace devo
