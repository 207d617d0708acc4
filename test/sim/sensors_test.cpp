// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "devo/sim/depth_sensor.h"
#include "devo/sim/imu_sensor.h"
#include "devo/sim/lidar.h"
#include "sim/sim_test_scenes.h"

namespace devo::sim {
namespace {

Trajectory Standing(const Rigid3& T = {}) { return Trajectory(std::vector<Rigid3>(8, T), 1.0); }

TEST(DepthSensor, GivesTheExactDepthOfATiltedWallToATenthOfAMillimetre) {
  Scene scene = WallScene(1.7, Texture::Make("plain", 1));
  scene.BakeLight(100);
  const Camera camera(240, 180, 198, 198, 121, 91, "plumb_bob", {-0.36, 0.15, 0, 0});
  const DepthSensor sensor(scene, RegisteredDepth(camera), 1);
  const Rigid3 T(ExpSO3({0.3, -0.2, 0.4}), {0.1, 0.2, -0.1});
  ThreadPool pool(1);
  const cv::Mat1f depth = sensor.Capture(Standing(T), 1, 0, &pool);
  for (int y = 0; y < 180; y += 7) {
    for (int x = 0; x < 240; x += 7) {
      const Eigen::Vector3d ray = T.rotation() * *camera.Unproject({x, y});
      EXPECT_NEAR(depth(y, x), (1.7 - T.translation().z()) / ray.z(), 1e-4);
    }
  }
}

TEST(DepthSensor, IsAsNoisyAsItsModel) {
  for (const double distance : {0.8, 1.6, 3.0}) {
    Scene scene = WallScene(distance, Texture(cv::Mat1f(4, 4, 0.5F)));
    scene.BakeLight(100);
    const DepthModel model = AzureKinect();
    const DepthSensor sensor(scene, model, 1);
    ThreadPool pool(1);
    const cv::Mat1f depth = sensor.Capture(Standing(model.T_event_depth.inverse()), 1, 0, &pool);
    const double bias = model.systematic_m * std::sin(6.283185307 * 2 * 200e6 * distance / 299792458);
    double sum = 0, squares = 0;
    int n = 0;
    for (int y = 100; y < 476; ++y) {
      for (int x = 100; x < 540; ++x) {
        const Eigen::Vector3d ray = *model.camera.Unproject({x, y});
        const double rho = 0.85 * (0.5 + 0.7 * 0.5), sigma = model.NoiseSigma(distance, rho, 1 / ray.norm());
        const double e = (depth(y, x) - distance - bias) / sigma;
        sum += e;
        squares += e * e;
        ++n;
      }
    }
    EXPECT_NEAR(std::sqrt(squares / n), 1, 0.05) << "at " << distance << " m";
    EXPECT_NEAR(sum / n, 0, 0.05) << "at " << distance << " m";
  }
}

TEST(DepthSensor, DoesNotMeasureWhatIsTooNearTooFarOrTooDark) {
  ThreadPool pool(1);
  const auto share = [&](double distance, double infrared) {
    Scene scene;
    Scene wall = WallScene(distance, Texture(cv::Mat1f(4, 4, 0.5F)));
    Material m{wall.AddTexture(Texture(cv::Mat1f(4, 4, 0.5F))), 1, 1, infrared};
    Eigen::Matrix3d R;
    R << -1, 0, 0, 0, 1, 0, 0, 0, -1;
    wall.AddRectangle({Eigen::Quaterniond(R), {4, -4, distance - 0.01}}, 8, 8, m);
    wall.BakeLight(100);
    const DepthModel model = AzureKinect();
    const cv::Mat1f depth = DepthSensor(wall, model, 1).Capture(Standing(model.T_event_depth.inverse()), 1, 0, &pool);
    return cv::countNonZero(depth(cv::Rect(280, 250, 80, 80))) / 6400.0;
  };
  EXPECT_EQ(share(1.5, 0.85), 1);
  EXPECT_EQ(share(0.2, 0.85), 0);
  EXPECT_EQ(share(6.0, 0.85), 0);
  EXPECT_EQ(share(3.5, 0.05), 0);
}

TEST(DepthSensor, MixesDistancesOrGivesNothingAtSilhouettes) {
  Scene scene = WallScene(1.5, Texture(cv::Mat1f(4, 4, 0.5F)));
  Material m{0, 1, 1, 0.85};
  Eigen::Matrix3d R;
  R << -1, 0, 0, 0, 1, 0, 0, 0, -1;
  scene.AddRectangle({Eigen::Quaterniond(R) * ExpSO3({0, 0, 0.2}), {0.2, -0.3, 1.2}}, 0.5, 0.6, m);
  scene.BakeLight(100);
  const DepthModel model = AzureKinect();
  ThreadPool pool(1);
  const cv::Mat1f depth = DepthSensor(scene, model, 1).Capture(Standing(model.T_event_depth.inverse()), 1, 0, &pool);
  int flying = 0, empty = 0, near = 0;
  for (int y = 150; y < 520; ++y) {
    for (int x = 150; x < 500; ++x) {
      const float z = depth(y, x);
      flying += z > 1.23F && z < 1.47F;
      empty += z == 0;
      near += z > 1.17F && z <= 1.23F;
    }
  }
  EXPECT_GT(near, 5000);
  EXPECT_GT(flying, 50);
  EXPECT_LT(flying + empty, near / 5);
}

TEST(Lidar, PutsPointsOnTheWallsWhenTheMotionDuringTheTurnIsUndone) {
  Scene scene = MakeScene("hall");
  scene.BakeLight(200);
  LidarModel model;
  model.noise_m = 0;
  const Trajectory motion = RandomTrajectory(scene.motion, LimitsOf("fast"), 3, 1);
  ThreadPool pool(2);
  const LidarScan scan = Lidar(scene, model, 1).Capture(motion, 1.0, 0, &pool);
  ASSERT_GT(scan.points.size(), 20000U);
  int far = 0;
  double without = 0;
  for (const LidarPoint& p : scan.points) {
    const Eigen::Vector3d local(p.x, p.y, p.z);
    const auto distance = [&](double t) {
      const Eigen::Vector3d w = motion.PoseAt(t) * (model.T_event_lidar * local);
      double nearest = 1e9;
      for (const Surface& s : scene.surfaces()) {
        nearest = std::min(nearest, s.kind == SurfaceKind::kCylinder
                                        ? std::abs((w - s.origin - (w - s.origin).dot(s.n) * s.n).norm() - s.size_u)
                                        : std::abs((w - s.origin).dot(s.n)));
      }
      return nearest;
    };
    far += distance(1.0 + p.time_s) > 2e-3;  // within one firing of 55 us the LiDAR moves 0.1 mm, turns 0.01 deg
    without = std::max(without, distance(1.0));
  }
  EXPECT_LT(far, static_cast<int>(scan.points.size() / 100));
  EXPECT_GT(without, 0.02);
}

TEST(ImuSensor, MeasuresWhatABodyFeelsWhereItSits) {
  ImuModel model;
  model.T_event_imu = Rigid3(ExpSO3({0.7, -1.2, 0.4}), {0.08, -0.02, -0.14});
  model.gyroscope_bias = model.accelerometer_bias = model.gyroscope_walk = model.accelerometer_walk = 0;
  model.gyroscope_noise = model.accelerometer_noise = 0;
  ImuSensor imu(model, 5);
  const Trajectory motion = RandomTrajectory(MakeScene("table").motion, LimitsOf("fast"), 4, 3);
  const auto pose_at = [&](double t_s) { return motion.PoseAt(t_s) * model.T_event_imu; };
  double least_part = 1;
  for (double t_s = 0.5; t_s < 3.5; t_s += 0.1) {
    constexpr double kStep_s = 1e-3;
    const Rigid3 T_world_imu = pose_at(t_s), before = pose_at(t_s - kStep_s), after = pose_at(t_s + kStep_s);
    const Eigen::Vector3d acceleration =
        (after.translation() - 2 * T_world_imu.translation() + before.translation()) / (kStep_s * kStep_s);
    const Eigen::Vector3d force = T_world_imu.rotation().conjugate() * (acceleration + Eigen::Vector3d(0, 0, 9.81));
    const Eigen::Vector3d turn = Log(before.inverse() * after).tail<3>() / (2 * kStep_s);
    const ImuSample sample = imu.Measure(motion, t_s);
    EXPECT_LT((sample.angular_velocity - turn).norm(), 1e-3 * turn.norm() + 1e-4) << t_s;
    EXPECT_LT((sample.linear_acceleration - force).norm(), 0.03) << t_s;
    const Eigen::Vector3d at_camera =
        motion.PoseAt(t_s).rotation().conjugate() * (motion.AccelerationAt(t_s) + Eigen::Vector3d(0, 0, 9.81));
    least_part = std::min(least_part, (sample.linear_acceleration.norm() - at_camera.norm()) / force.norm());
  }
  EXPECT_LT(least_part, -0.01) << "the lever matters in this motion, or nothing is tested";
}

TEST(ImuSensor, FeelsGravityAndHasTheNoiseOfItsDensities) {
  ImuModel model;
  model.gyroscope_bias = model.accelerometer_bias = model.gyroscope_walk = model.accelerometer_walk = 0;
  const Rigid3 T(ExpSO3({0.4, 1.1, -0.3}), {1, 2, 3});
  ImuSensor imu(model, 5);
  const Trajectory standing = Standing(T);
  const Eigen::Vector3d expected = T.rotation().conjugate() * Eigen::Vector3d(0, 0, 9.81);
  double gyro = 0, accel = 0;
  constexpr int kSamples = 4000;
  for (int i = 0; i < kSamples; ++i) {
    const ImuSample s = imu.Measure(standing, 1.0);
    gyro += s.angular_velocity.squaredNorm() / (3 * kSamples);
    accel += (s.linear_acceleration - expected).squaredNorm() / (3 * kSamples);
  }
  EXPECT_NEAR(std::sqrt(gyro), model.gyroscope_noise * std::sqrt(200), 0.05 * model.gyroscope_noise * std::sqrt(200));
  EXPECT_NEAR(std::sqrt(accel), model.accelerometer_noise * std::sqrt(200),
              0.05 * model.accelerometer_noise * std::sqrt(200));
}

}  // namespace
}  // namespace devo::sim
