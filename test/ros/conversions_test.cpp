// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/conversions.h"

#include <gtest/gtest.h>

#include <random>

namespace devo {
namespace {

Rigid3 SomePose() { return {ExpSO3({0.3, -0.8, 1.1}), {1, 2, -3}}; }

Matrix6d SomeCovariance() {
  Matrix6d A;
  for (int i = 0; i < 36; ++i) A(i / 6, i % 6) = 1e-3 * (1 + (7 * i) % 11);
  return 1e-2 * A * A.transpose() + 1e-6 * Matrix6d::Identity();
}

/// Position and fixed-axis rotation by which `T` differs from `T0`, in the outer frame.
Vector6d FixedAxisDifference(const Rigid3& T0, const Rigid3& T) {
  Vector6d d;
  d << T.translation() - T0.translation(), LogSO3(T.rotation() * T0.rotation().conjugate());
  return d;
}

TEST(Conversions, CovarianceOfOdometryIsThatOfSampledPosesAboutFixedAxes) {
  const Rigid3 T = SomePose();
  const Matrix6d covariance = 1e-4 * SomeCovariance();
  const Matrix6d root = covariance.llt().matrixL();
  std::mt19937 random(1);
  std::normal_distribution<double> gauss;
  Matrix6d sampled = Matrix6d::Zero();
  const int n = 20000;
  for (int i = 0; i < n; ++i) {
    const Vector6d xi = root * Vector6d::NullaryExpr([&](Eigen::Index) { return gauss(random); });
    const Vector6d d = FixedAxisDifference(T, T * Exp(xi));
    sampled += d * d.transpose() / n;
  }
  const Matrix6d converted = FixedAxisCovariance(T, covariance);
  EXPECT_LT((converted - sampled).norm(), 0.03 * sampled.norm());
}

TEST(Conversions, OdometryOfABaseIsThatOfTheRigidlyMountedCamera) {
  OdometryFrames frames;
  frames.odom_frame = "odom";
  frames.child_frame = "base_link";
  frames.T_odom_world = Rigid3::Rotation(ExpSO3({0, 0, 0.5}));
  frames.T_event_child = {ExpSO3({0.2, 0, 0.1}), {0.5, 0.1, 0}};
  PoseEstimate estimate;
  estimate.T_world_event = SomePose();
  estimate.velocity_event << 0.1, -0.2, 0.3, 0.5, 0.6, -0.7;
  estimate.covariance_event = SomeCovariance();
  estimate.covariance_in_chapter = 0.25 * SomeCovariance();
  const nav_msgs::Odometry odometry = ToOdometryMsg(estimate, frames, 0.08);

  const Rigid3 T_odom_child = FromPoseMsg(odometry.pose.pose);
  const Rigid3 expected = frames.T_odom_world * estimate.T_world_event * frames.T_event_child;
  EXPECT_LT(Log(T_odom_child.inverse() * expected).norm(), 1e-12);

  // Both poses that tell the velocity are off by what is not known of their chapter.
  const double of_pose = odometry.pose.covariance[21] + odometry.pose.covariance[28] + odometry.pose.covariance[35];
  const double of_twist = odometry.twist.covariance[21] + odometry.twist.covariance[28] + odometry.twist.covariance[35];
  EXPECT_NEAR(of_twist, 2 / (0.08 * 0.08) * 0.25 * of_pose, 1e-9 * of_twist);
  // Moving the camera for a moment moves the base by its twist.
  const double dt = 1e-6;
  const Rigid3 later = frames.OdomFromChild(estimate.T_world_event * Exp(dt * estimate.velocity_event));
  const Vector6d twist = Log(T_odom_child.inverse() * later) / dt;
  EXPECT_NEAR(odometry.twist.twist.linear.y, twist(1), 1e-5);
  EXPECT_NEAR(odometry.twist.twist.angular.z, twist(5), 1e-5);

  // A perturbation of the camera's pose has, in the base's covariance, the size that it has in the camera's.
  const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> covariance(odometry.pose.covariance.data());
  Vector6d xi;
  xi << 1e-5, 2e-5, -1e-5, 1e-5, 0, 3e-5;
  const Vector6d d = FixedAxisDifference(T_odom_child, frames.OdomFromChild(estimate.T_world_event * Exp(xi)));
  const double in_camera = xi.dot(estimate.covariance_event.ldlt().solve(xi));
  const double in_base = d.dot(Matrix6d(covariance).ldlt().solve(d));
  EXPECT_NEAR(in_base, in_camera, 1e-3 * in_camera);
}

TEST(Conversions, APoseWithoutAUnitQuaternionIsRefused) {
  EXPECT_THROW(FromPoseMsg(geometry_msgs::Pose()), std::invalid_argument);
}

TEST(Conversions, TimesSurviveToTheNanosecond) {
  EXPECT_EQ(FromRosTime(ToRosTime(1'600'000'000'123'456'789)), 1'600'000'000'123'456'789);
  EXPECT_EQ(ToRosTime(-5), ros::Time(0));
}

}  // namespace
}  // namespace devo
