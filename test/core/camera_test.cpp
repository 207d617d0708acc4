// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/camera.h"

#include <cmath>
#include <limits>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "numeric_jacobian.h"

namespace devo {
namespace {

struct NamedCamera {
  const char* name;
  Camera camera;
};
void PrintTo(const NamedCamera& named, std::ostream* out) { *out << named.name; }

/// Published or plausible calibrations of the sensors that this package meets, all four distortion models.
std::vector<NamedCamera> Cameras() {
  return {
      {"simulated_640x480_none", {640, 480, 520, 520, 319.5, 239.5, "", {}}},
      {"davis240_plumb_bob_4", {240, 180, 199.65, 199.42, 129.47, 88.12, "plumb_bob", {-0.37, 0.15, -3e-4, 4e-4}}},
      {"davis240_plumb_bob_5",
       {240, 180, 199.092, 198.828, 132.192, 110.712, "plumb_bob", {-0.368436, 0.150947, -0.000296, -0.000439, 0}}},
      {"vector_left_event_plumb_bob_5",
       {640,
        480,
        327.32749,
        327.46184,
        304.97749,
        235.37621,
        "plumb_bob",
        {-0.031982, 0.041966, -0.000507, -0.001031, 0}}},
      {"vector_left_regular_radtan",
       {1224,
        1024,
        886.19107,
        886.59163,
        610.57891,
        514.59271,
        "radtan",
        {-0.315760, 0.104955, 0.00032, -0.000156, 0}}},
      {"azure_kinect_depth_rational",
       {640,
        576,
        504.574,
        504.674,
        321.848,
        336.139,
        "rational_polynomial",
        {5.3633, 3.35493, -1.08168e-05, -1.43868e-05, 0.163032, 5.69124, 5.13437, 0.887861}}},
      {"azure_kinect_colour_labelled_plumb_bob_8",
       {1280,
        720,
        602.965,
        602.786,
        640.028,
        364.642,
        "plumb_bob",
        {0.902495, -2.96383, 0.000432662, -0.000477238, 1.60099, 0.781251, -2.80924, 1.54229}}},
      {"mvsec_davis346_equidistant",
       {346, 260, 226.38, 226.15, 173.64, 133.73, "equidistant", {-0.048031, 0.011330, -0.055378, 0.021500}}},
      {"wide_1280x720_equidistant", {1280, 720, 530, 531, 640.3, 358.8, "equidistant", {0.02, -0.004, 0.001, -0.0003}}},
  };
}

class CameraTest : public testing::TestWithParam<NamedCamera> {};
INSTANTIATE_TEST_SUITE_P(Calibrations, CameraTest, testing::ValuesIn(Cameras()),
                         [](const auto& info) { return std::string(info.param.name); });

TEST_P(CameraTest, ProjectInvertsUnprojectOnAGridOverTheImage) {
  const Camera& camera = GetParam().camera;
  for (int row = 0; row <= 20; ++row) {
    for (int column = 0; column <= 20; ++column) {
      const Eigen::Vector2d u(column / 20.0 * (camera.width() - 1), row / 20.0 * (camera.height() - 1));
      const auto ray = camera.Unproject(u);
      ASSERT_TRUE(ray) << "pixel " << u.transpose();
      EXPECT_EQ(ray->z(), 1);
      for (const double depth_m : {0.1, 1.0, 30.0}) {
        const auto back = camera.Project(depth_m * *ray);
        ASSERT_TRUE(back) << "pixel " << u.transpose();
        EXPECT_NEAR((*back - u).norm(), 0, 1e-6) << "pixel " << u.transpose();
      }
    }
  }
}

TEST_P(CameraTest, ThePrincipalPointLooksAlongTheOpticalAxis) {
  const Camera& camera = GetParam().camera;
  const auto u = camera.Project({0, 0, 2});
  ASSERT_TRUE(u);
  EXPECT_NEAR((*u - Eigen::Vector2d(camera.cx(), camera.cy())).norm(), 0, 1e-12);
}

TEST_P(CameraTest, DistortionJacobianIsTheNumericOne) {
  const Camera& camera = GetParam().camera;
  const auto distort = [&camera](const Eigen::VectorXd& x) {
    const auto u = camera.Project({x[0], x[1], 1});
    const double nan = std::numeric_limits<double>::quiet_NaN();
    if (!u) return Eigen::Vector2d(nan, nan);
    return Eigen::Vector2d((u->x() - camera.cx()) / camera.fx(), (u->y() - camera.cy()) / camera.fy());
  };
  for (int row = 0; row <= 10; ++row) {
    for (int column = 0; column <= 10; ++column) {
      const auto ray = camera.Unproject({column / 10.0 * (camera.width() - 1), row / 10.0 * (camera.height() - 1)});
      ASSERT_TRUE(ray);
      const Eigen::Vector2d x = ray->head<2>();
      EXPECT_TRUE(JacobianIsNear("distortion", camera.DistortionJacobian(x), distort, x, 1e-7, 1e-5));
    }
  }
  EXPECT_TRUE(JacobianIsNear("distortion on the axis", camera.DistortionJacobian({0, 0}), distort,
                             Eigen::Vector2d::Zero(), 1e-7, 1e-5));
}

TEST_P(CameraTest, PointsBehindOrInTheCameraHaveNoPixel) {
  const Camera& camera = GetParam().camera;
  EXPECT_FALSE(camera.Project({0, 0, -1}));
  EXPECT_FALSE(camera.Project({0.1, 0.1, 0}));
  EXPECT_FALSE(camera.Project({0, 0, std::numeric_limits<double>::quiet_NaN()}));
}

TEST_P(CameraTest, NoPointFarOutsideTheFieldOfViewFoldsBackIntoTheImage) {
  const Camera& camera = GetParam().camera;
  // Wherever a point does land in the image, the ray of that pixel must be the one to the point.
  for (double tangent = 0; tangent < 20; tangent += 0.05) {
    for (double direction = 0; direction < 2 * M_PI; direction += M_PI / 8) {
      const Eigen::Vector3d p(tangent * std::cos(direction), tangent * std::sin(direction), 1);
      const auto u = camera.Project(p);
      if (!u || !camera.Contains(*u)) continue;
      const auto ray = camera.Unproject(*u);
      ASSERT_TRUE(ray) << "pixel " << u->transpose();
      EXPECT_NEAR((*ray - p).norm() / p.norm(), 0, 1e-6) << "point " << p.transpose() << ", pixel " << u->transpose();
    }
  }
}

TEST_P(CameraTest, RayTableHoldsTheRayOfEachPixel) {
  const Camera& camera = GetParam().camera;
  const cv::Mat2f table = RayTable(camera);
  ASSERT_EQ(table.size(), cv::Size(camera.width(), camera.height()));
  for (const cv::Point u : {cv::Point(0, 0), cv::Point(camera.width() - 1, camera.height() - 1), cv::Point(17, 101)}) {
    const auto ray = camera.Unproject({u.x, u.y});
    ASSERT_TRUE(ray);
    EXPECT_NEAR(table(u)[0], ray->x(), 1e-6);
    EXPECT_NEAR(table(u)[1], ray->y(), 1e-6);
  }
}

TEST_P(CameraTest, TheUndistortedCameraIsAPinholeOfTheSameFocalLengths) {
  const Camera &camera = GetParam().camera, undistorted = camera.Undistorted();
  EXPECT_EQ(undistorted.distortion(), DistortionModel::kNone);
  EXPECT_EQ(undistorted.fx(), camera.fx());
  EXPECT_EQ(undistorted.fy(), camera.fy());
  const auto u = undistorted.Project({0.2, -0.1, 2});
  ASSERT_TRUE(u);
  EXPECT_NEAR(u->x(), undistorted.fx() * 0.1 + undistorted.cx(), 1e-9);
  EXPECT_NEAR(u->y(), undistorted.fy() * -0.05 + undistorted.cy(), 1e-9);
}

TEST_P(CameraTest, TheUndistortedImageHoldsThatOfTheSensorsSizeShiftedByWholePixels) {
  const Camera &camera = GetParam().camera, undistorted = camera.Undistorted();
  const double left_px = undistorted.cx() - camera.cx(), top_px = undistorted.cy() - camera.cy();
  EXPECT_EQ(left_px, std::round(left_px));
  EXPECT_EQ(top_px, std::round(top_px));
  EXPECT_GE(left_px, 0);
  EXPECT_GE(top_px, 0);
  EXPECT_GE(undistorted.width(), camera.width() + left_px);
  EXPECT_GE(undistorted.height(), camera.height() + top_px);
}

TEST_P(CameraTest, TheUndistortedImageGoesOnNoFartherThanTheSensorSees) {
  const Camera &camera = GetParam().camera, undistorted = camera.Undistorted();
  const double left_px = undistorted.cx() - camera.cx(), top_px = undistorted.cy() - camera.cy();
  const auto is_seen = [&](double x, double y) {
    const auto u = camera.Project(*undistorted.Unproject({x, y}));
    return u && camera.Contains(*u);
  };
  const auto expect_column = [&](double x) {
    for (double y = top_px; y < top_px + camera.height(); ++y) EXPECT_TRUE(is_seen(x, y)) << x << " " << y;
  };
  if (left_px > 0) expect_column(0);
  if (undistorted.width() > left_px + camera.width()) expect_column(undistorted.width() - 1);
  if (top_px > 0) {
    for (double x = left_px; x < left_px + camera.width(); ++x) EXPECT_TRUE(is_seen(x, 0)) << x;
  }
}

TEST(CameraModelTest, TheUndistortedImageOfADavisHoldsNineTenthsOfItsPixelsNotThreeQuarters) {
  const Camera camera(240, 180, 198.2, 198.4, 121.3, 91.8, "plumb_bob", {-0.3684, 0.1509, -0.0003, -0.0002, 0});
  const Camera undistorted = camera.Undistorted();
  int held = 0, held_in_sensors_size = 0;
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const Eigen::Vector3d ray = *camera.Unproject({x, y});
      held += undistorted.Contains(*undistorted.Project(ray));
      held_in_sensors_size +=
          camera.Contains({camera.fx() * ray.x() + camera.cx(), camera.fy() * ray.y() + camera.cy()});
    }
  }
  EXPECT_LT(held_in_sensors_size, 0.8 * camera.width() * camera.height());
  EXPECT_GT(held, 0.92 * camera.width() * camera.height());
}

TEST(CameraModelTest, TheUndistortedImageOfAFisheyeIsAtMostHalfAsWideAgain) {
  const Camera camera(400, 300, 150, 150, 199.5, 149.5, "equidistant", {0, 0, 0, 0});
  const Camera undistorted = camera.Undistorted();
  EXPECT_EQ(undistorted.width(), 600);
  EXPECT_LE(undistorted.height(), 450);
}

TEST_P(CameraTest, ShrunkImagesShowTheSameView) {
  const Camera undistorted = GetParam().camera.Undistorted();
  const Camera shrunk = undistorted.ShrunkTo(undistorted.width() / 2, undistorted.height());
  EXPECT_LE(shrunk.width(), undistorted.width() / 2);
  EXPECT_LE(shrunk.height(), undistorted.height());
  // Pixel centres lie at integers: the image's corner is half a pixel before the first.
  const Eigen::Vector3d corner = *undistorted.Unproject({-0.5, -0.5});
  EXPECT_NEAR((*shrunk.Project(corner) - Eigen::Vector2d(-0.5, -0.5)).norm(), 0, 1e-9);
  const auto same = undistorted.ShrunkTo(2 * undistorted.width(), 2 * undistorted.height());
  EXPECT_EQ(same.width(), undistorted.width());
  EXPECT_EQ(same.cx(), undistorted.cx());
}

TEST(CameraModelTest, NameAndCoefficientCountTogetherDecideTheModel) {
  const auto model = [](const char* name, std::size_t count) {
    return Camera(640, 480, 500, 500, 320, 240, name, std::vector<double>(count, 0.0)).distortion();
  };
  EXPECT_EQ(model("", 0), DistortionModel::kNone);
  EXPECT_EQ(model("none", 0), DistortionModel::kNone);
  EXPECT_EQ(model("plumb_bob", 0), DistortionModel::kNone);
  EXPECT_EQ(model("plumb_bob", 4), DistortionModel::kPlumbBob);
  EXPECT_EQ(model("plumb_bob", 5), DistortionModel::kPlumbBob);
  EXPECT_EQ(model("plumb_bob", 8), DistortionModel::kRationalPolynomial);
  EXPECT_EQ(model("rational_polynomial", 8), DistortionModel::kRationalPolynomial);
  EXPECT_EQ(model("equidistant", 4), DistortionModel::kEquidistant);
}

TEST(CameraModelTest, PlumbBobOrdersItsCoefficientsAsRosDoes) {
  // k1 k2 p1 p2 k3, worked out by hand at x = 0.5, y = 0.2 (r^2 = 0.29).
  const Camera camera(640, 480, 100, 100, 0, 0, "plumb_bob", {0.1, 0.01, 0.002, 0.003, 0.0005});
  const double r2 = 0.29, radial = 1 + 0.1 * r2 + 0.01 * r2 * r2 + 0.0005 * r2 * r2 * r2;
  const auto u = camera.Project({0.5, 0.2, 1});
  ASSERT_TRUE(u);
  EXPECT_NEAR(u->x(), 100 * (0.5 * radial + 2 * 0.002 * 0.1 + 0.003 * (r2 + 2 * 0.25)), 1e-12);
  EXPECT_NEAR(u->y(), 100 * (0.2 * radial + 0.002 * (r2 + 2 * 0.04) + 2 * 0.003 * 0.1), 1e-12);
}

TEST(CameraModelTest, EquidistantIsLinearInTheAngleWithoutCoefficients) {
  const Camera camera(640, 480, 200, 200, 320, 240, "equidistant", {0, 0, 0, 0});
  for (const double angle : {0.1, 0.8, 1.3, 1.5}) {
    const auto u = camera.Project({std::tan(angle), 0, 1});
    ASSERT_TRUE(u);
    EXPECT_NEAR(u->x(), 320 + 200 * angle, 1e-9);
  }
}

TEST(CameraModelTest, APolynomialThatFoldsBackRejectsWhatLiesBeyondTheFold) {
  // r (1 - 0.37 r^2) turns at r = 0.95: without the test, r = 1.3 would land at 0.49, well inside the image.
  const Camera camera(240, 180, 199, 199, 120, 90, "plumb_bob", {-0.37, 0, 0, 0});
  EXPECT_TRUE(camera.Project({0.9, 0, 1}));
  EXPECT_FALSE(camera.Project({1.3, 0, 1}));
  EXPECT_FALSE(camera.Unproject({120 + 199 * 0.7, 90})) << "beyond the largest radius that any ray reaches";
}

struct BadCamera {
  const char* name;
  int width, height;
  double fx;
  const char* model;
  std::vector<double> coefficients;
  const char* expected;
};
void PrintTo(const BadCamera& bad, std::ostream* out) { *out << bad.name; }

class BadCameraTest : public testing::TestWithParam<BadCamera> {};
INSTANTIATE_TEST_SUITE_P(
    Values, BadCameraTest,
    testing::Values(BadCamera{"uncalibrated", 640, 480, 0, "", {}, "fx = 0"},
                    BadCamera{"negative_focal_length", 640, 480, -500, "", {}, "fx = -500"},
                    BadCamera{"focal_length_nan", 640, 480, std::nan(""), "", {}, "fx = nan"},
                    BadCamera{"empty_image", 0, 480, 500, "", {}, "0x480"},
                    BadCamera{"unknown_model", 640, 480, 500, "fov", {0.9}, "'fov' with 1 coefficients"},
                    BadCamera{"wrong_count", 640, 480, 500, "equidistant", {0, 0, 0, 0, 0}, "'equidistant' with 5"},
                    BadCamera{"three_coefficients", 640, 480, 500, "plumb_bob", {0, 0, 0}, "'plumb_bob' with 3"},
                    BadCamera{"coefficient_nan", 640, 480, 500, "plumb_bob", {0, 0, 0, std::nan("")}, "coefficients"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST_P(BadCameraTest, IsRejectedWithTheValueNamed) {
  const BadCamera& bad = GetParam();
  try {
    const Camera camera(bad.width, bad.height, bad.fx, 500, 320, 240, bad.model, bad.coefficients);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(bad.expected));
  }
}

TEST(Camera, MagnifiesTheImageAboutItsPrincipalPointWithALongerFocalLength) {
  const Camera camera(640, 480, 500, 510, 320, 240, "plumb_bob", {-0.1, 0.02, 1e-3, -1e-3, 0.01});
  const Camera longer = camera.WithFocalLength(1.1);
  const Eigen::Vector3d p(0.2, -0.1, 1);
  const Eigen::Vector2d centre(320, 240);
  EXPECT_LT((*longer.Project(p) - centre - 1.1 * (*camera.Project(p) - centre)).norm(), 1e-9);
  EXPECT_THROW(camera.WithFocalLength(0), std::invalid_argument);
}

}  // namespace
}  // namespace devo
