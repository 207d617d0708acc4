// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/core_messages.h"

#include <gtest/gtest.h>

#include <vector>

namespace devo {
namespace {

template <typename T>
std::vector<std::uint8_t> Bytes(const T& message) {
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  EXPECT_EQ(stream.getLength(), 0U) << "serializedLength counts more than was written";
  return bytes;
}

template <typename T>
T FromBytes(std::vector<std::uint8_t> bytes) {
  T message;
  ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::deserialize(stream, message);
  EXPECT_EQ(stream.getLength(), 0U) << "bytes left over";
  return message;
}

Surface SomeSurface() {
  Surface surface;
  surface.t_ns = 1'600'000'000'123'456'789;
  surface.t_edges_ns = 1'600'000'000'113'456'780;
  surface.epoch = 3;
  const cv::Mat1b wide(4, 9, std::uint8_t{7});
  surface.image = wide.colRange(2, 7).clone();
  surface.image(3, 4) = 255;
  surface.edges = {{1.5F, 2.5F, 0.6F, 0.8F, 4.F, -0.25F}, {3.F, 1.F, 1.F, 0.F, 2.F, 1.F}};
  surface.nearest_edge = cv::Mat1i(4, 5, Surface::kNoEdge);
  surface.nearest_edge(2, 1) = (37 << 16) | 1;
  surface.event_rate_hz = 1e6;
  surface.activity_hz = 2.5;
  surface.window_s = 0.02;
  surface.events_used = 12345;
  surface.still = surface.maybe_noise = surface.noise_goes_on = true;
  surface.turn_event = {0.1, -0.2, 0.3};
  return surface;
}

PoseEstimate SomePose() {
  PoseEstimate estimate;
  estimate.t_ns = 42'000'000'007;
  estimate.epoch = 9;
  estimate.T_world_event = Rigid3(Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5), {1, -2, 3});
  estimate.t_edges_ns = 42'000'000'003;
  estimate.T_world_event_edges = Rigid3(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), {4, 5, -6});
  estimate.earlier = {{42'000'000'001, Rigid3()}, {42'000'000'002, Rigid3::Translation({7, 8, 9})}};
  estimate.velocity_event << 1, 2, 3, 4, 5, 6;
  estimate.velocity_of_poses = true;
  estimate.acceleration_event << 7, 8, 9, 10, 11, 12;
  for (int i = 0; i < 36; ++i) estimate.covariance_event(i / 6, i % 6) = i;
  estimate.covariance_in_chapter = 0.5 * estimate.covariance_event;
  estimate.state = TrackingState::kLost;
  estimate.reference_id = 5;
  estimate.points_used = 1800;
  estimate.inlier_share = 0.75;
  estimate.mean_residual_px = 0.3;
  estimate.delays = {0.004, -0.007, 0.002, -0.003};
  estimate.inertial_fit = {2, 3, 9.7, 1e-3, 0.02, true};
  estimate.chapter = 2;
  estimate.needs_map = true;
  estimate.iterations = 8;
  return estimate;
}

TEST(CoreMessages, ASurfaceReadAsItsMessageHasTheSameContent) {
  const Surface surface = SomeSurface();
  const auto message = FromBytes<TimeSurface>(Bytes(surface));
  EXPECT_EQ(message.stamp.toNSec(), 1'600'000'000'123'456'789U);
  EXPECT_EQ(message.edges_stamp.toNSec(), 1'600'000'000'113'456'780U);
  EXPECT_EQ(message.epoch, 3U);
  ASSERT_EQ(message.height, 4U);
  ASSERT_EQ(message.width, 5U);
  ASSERT_EQ(message.image.size(), 20U);
  EXPECT_EQ(message.image[19], 255);
  ASSERT_EQ(message.edges.size(), 2U);
  EXPECT_FLOAT_EQ(message.edges[0].ny, 0.8F);
  EXPECT_FLOAT_EQ(message.edges[0].polarity, -0.25F);
  EXPECT_FLOAT_EQ(message.edges[1].strength, 2.F);
  ASSERT_EQ(message.nearest_edge.size(), 20U);
  EXPECT_EQ(message.nearest_edge[2 * 5 + 1], (37 << 16) | 1);
  EXPECT_EQ(message.nearest_edge[0], Surface::kNoEdge);
  EXPECT_DOUBLE_EQ(message.event_rate_hz, 1e6);
  EXPECT_DOUBLE_EQ(message.activity_hz, 2.5);
  EXPECT_DOUBLE_EQ(message.window_s, 0.02);
  EXPECT_EQ(message.events_used, 12345U);
  EXPECT_TRUE(message.still && message.maybe_noise && message.noise_goes_on);
  EXPECT_EQ(message.turn_event[2], 0.3);
}

TEST(CoreMessages, ASurfaceSurvivesARoundTripByteForByte) {
  const auto bytes = Bytes(SomeSurface());
  EXPECT_EQ(Bytes(FromBytes<Surface>(bytes)), bytes);
  EXPECT_EQ(Bytes(FromBytes<TimeSurface>(bytes)), bytes);
}

TEST(CoreMessages, ASurfaceReadBackHasEveryFieldAndFindsTheSameEdges) {
  const Surface sent = SomeSurface();
  const auto read = FromBytes<Surface>(Bytes(sent));
  EXPECT_EQ(read.t_ns, sent.t_ns);
  EXPECT_EQ(read.t_edges_ns, sent.t_edges_ns);
  EXPECT_EQ(read.epoch, sent.epoch);
  EXPECT_EQ(read.NearestEdge(1, 2), 1);
  EXPECT_EQ(read.NearestEdge(0, 0), -1);
  EXPECT_EQ(read.event_rate_hz, sent.event_rate_hz);
  EXPECT_EQ(read.activity_hz, sent.activity_hz);
  EXPECT_EQ(read.window_s, sent.window_s);
  EXPECT_EQ(read.events_used, sent.events_used);
  EXPECT_EQ(read.still, sent.still);
  EXPECT_EQ(read.maybe_noise, sent.maybe_noise);
  EXPECT_EQ(read.noise_goes_on, sent.noise_goes_on);
  EXPECT_EQ(read.turn_event, sent.turn_event);
}

TEST(CoreMessages, ANearestEdgeThatDoesNotExistIsRefused) {
  Surface surface = SomeSurface();
  surface.nearest_edge(0, 3) = (16 << 16) | 2;  // of two edges
  EXPECT_THROW(FromBytes<Surface>(Bytes(surface)), std::runtime_error);
}

TEST(CoreMessages, ASurfaceWhoseRowsAreNotAdjacentIsWrittenRowByRow) {
  Surface surface = SomeSurface();
  const cv::Mat1b wide(4, 9, std::uint8_t{0});
  surface.image.copyTo(wide.colRange(2, 7));
  const auto expected = Bytes(surface);
  surface.image = wide.colRange(2, 7);
  ASSERT_FALSE(surface.image.isContinuous());
  EXPECT_EQ(Bytes(surface), expected);
}

TEST(CoreMessages, AnEmptySurfaceSurvivesARoundTrip) {
  const Surface surface = FromBytes<Surface>(Bytes(Surface()));
  EXPECT_TRUE(surface.image.empty());
  EXPECT_TRUE(surface.edges.empty());
  EXPECT_TRUE(surface.nearest_edge.empty());
}

TEST(CoreMessages, APoseReadAsItsMessageHasTheSameContent) {
  const PoseEstimate estimate = SomePose();
  const auto message = FromBytes<TrackedPose>(Bytes(estimate));
  EXPECT_EQ(message.stamp.toNSec(), 42'000'000'007U);
  EXPECT_DOUBLE_EQ(message.T_world_event.position.y, -2);
  EXPECT_DOUBLE_EQ(message.T_world_event.orientation.x, -0.5);
  EXPECT_EQ(message.edges_stamp.toNSec(), 42'000'000'003U);
  EXPECT_DOUBLE_EQ(message.T_world_event_edges.position.z, -6);
  EXPECT_DOUBLE_EQ(message.T_world_event_edges.orientation.y, -0.5);
  ASSERT_EQ(message.earlier.size(), 2U);
  EXPECT_EQ(message.earlier[1].stamp.toNSec(), 42'000'000'002U);
  EXPECT_DOUBLE_EQ(message.earlier[1].T_world_event.position.z, 9);
  EXPECT_DOUBLE_EQ(message.velocity_event[5], 6);
  EXPECT_TRUE(message.velocity_of_poses);
  EXPECT_DOUBLE_EQ(message.acceleration_event[0], 7);
  EXPECT_DOUBLE_EQ(message.covariance_event[1 * 6 + 2], estimate.covariance_event(1, 2));
  EXPECT_DOUBLE_EQ(message.covariance_in_chapter[1 * 6 + 2], estimate.covariance_in_chapter(1, 2));
  EXPECT_EQ(message.state, TrackedPose::LOST);
  EXPECT_EQ(message.reference_id, 5);
  EXPECT_EQ(message.points_used, 1800);
  EXPECT_DOUBLE_EQ(message.inlier_share, 0.75);
  EXPECT_DOUBLE_EQ(message.mean_residual_px, 0.3);
  EXPECT_DOUBLE_EQ(message.event_delay_s, 0.004);
  EXPECT_DOUBLE_EQ(message.depth_delay_s, -0.007);
  EXPECT_DOUBLE_EQ(message.depth_delay_sigma_s, 0.002);
  EXPECT_DOUBLE_EQ(message.inertial_delay_s, -0.003);
  EXPECT_DOUBLE_EQ(message.gyroscope_misfit, 2);
  EXPECT_DOUBLE_EQ(message.accelerometer_misfit, 3);
  EXPECT_DOUBLE_EQ(message.mean_force_m_s2, 9.7);
  EXPECT_DOUBLE_EQ(message.gyroscope_noise, 1e-3);
  EXPECT_DOUBLE_EQ(message.accelerometer_noise, 0.02);
  EXPECT_TRUE(message.inertial_left_out);
  EXPECT_EQ(message.chapter, 2);
  EXPECT_TRUE(message.needs_map);
  EXPECT_EQ(message.iterations, 8);
  const auto bytes = Bytes(estimate);
  const auto read = FromBytes<PoseEstimate>(bytes);
  EXPECT_EQ(read.t_ns, estimate.t_ns);
  EXPECT_EQ(read.t_edges_ns, estimate.t_edges_ns);
  ASSERT_EQ(read.earlier.size(), 2U);
  EXPECT_EQ(read.earlier[1].t_ns, 42'000'000'002);
  EXPECT_EQ(read.earlier[1].T_world_event.translation(), Eigen::Vector3d(7, 8, 9));
  EXPECT_TRUE(read.T_world_event_edges.translation().isApprox(estimate.T_world_event_edges.translation()));
  EXPECT_TRUE(read.T_world_event.translation().isApprox(estimate.T_world_event.translation()));
  EXPECT_EQ(Bytes(FromBytes<PoseEstimate>(bytes)), bytes);
}

TEST(CoreMessages, ALocalMapReadAsItsMessageHasTheSameContent) {
  LocalMap map;
  map.t_ns = 5;
  map.epoch = 1;
  map.id = 17;
  map.chapter = 3;
  map.found_by_depth = true;
  map.T_world_ref = Rigid3::Translation({0, 0, 2});
  map.points.resize(3);
  map.points[2].p_ref = {1, 2, 3};
  map.points[2].normal_ref = {0, 1, 0};
  map.points[2].sign = -1;
  map.points[2].sigma_px = 0.5F;
  map.points[2].reference = 16;
  const auto bytes = Bytes(map);
  const auto message = FromBytes<SemiDenseMap>(bytes);
  EXPECT_EQ(message.id, 17);
  EXPECT_TRUE(message.found_by_depth);
  EXPECT_DOUBLE_EQ(message.T_world_ref.position.z, 2);
  ASSERT_EQ(message.points.size(), 3U);
  EXPECT_FLOAT_EQ(message.points[2].p_ref[2], 3);
  EXPECT_FLOAT_EQ(message.points[2].normal_ref[1], 1);
  EXPECT_FLOAT_EQ(message.points[2].sigma_px, 0.5F);
  EXPECT_EQ(message.points[2].reference, 16);
  EXPECT_EQ(Bytes(FromBytes<LocalMap>(bytes)), bytes);
}

TEST(CoreMessages, ASceneDepthWithAndWithoutAGridSurvivesARoundTrip) {
  SceneDepth depth;
  depth.t_ns = 8;
  depth.median_m = 1.5;
  EXPECT_TRUE(FromBytes<SceneDepth>(Bytes(depth)).inverse_depth.empty());
  depth.inverse_depth = cv::Mat1f(3, 2, 0.5F);
  depth.inverse_depth(2, 1) = 0.25F;
  const auto bytes = Bytes(depth);
  const auto message = FromBytes<SceneInverseDepth>(bytes);
  EXPECT_EQ(message.height, 3U);
  EXPECT_FLOAT_EQ(message.inverse_depth[5], 0.25F);
  EXPECT_EQ(Bytes(FromBytes<SceneDepth>(bytes)), bytes);
}

TEST(CoreMessages, APoseByDepthReadAsItsMessageHasTheSameContent) {
  DepthPose pose;
  pose.t_ns = 12'000'000'034;
  pose.epoch = 2;
  pose.chapter = 4;
  pose.T_world_event = Rigid3(Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5), {1, -2, 3});
  for (int i = 0; i < 36; ++i) pose.information(i / 6, i % 6) = i;
  pose.per_delay << 1, 2, 3, 4, 5, 6;
  pose.delay_sigma_s = 0.003;
  pose.shared_share = 0.25;
  pose.confirmed = true;
  const auto bytes = Bytes(pose);
  const auto message = FromBytes<PoseByDepth>(bytes);
  EXPECT_EQ(message.stamp.toNSec(), 12'000'000'034U);
  EXPECT_EQ(message.epoch, 2U);
  EXPECT_EQ(message.chapter, 4);
  EXPECT_DOUBLE_EQ(message.T_world_event.position.z, 3);
  EXPECT_DOUBLE_EQ(message.information[1 * 6 + 2], 8);
  EXPECT_DOUBLE_EQ(message.per_delay[5], 6);
  EXPECT_DOUBLE_EQ(message.delay_sigma_s, 0.003);
  EXPECT_DOUBLE_EQ(message.shared_share, 0.25);
  EXPECT_TRUE(message.confirmed);
  EXPECT_EQ(Bytes(FromBytes<DepthPose>(bytes)), bytes);
}

TEST(CoreMessages, TruncatedBytesAreRefused) {
  const auto bytes = Bytes(SomeSurface());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    std::vector<std::uint8_t> cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    cut.reserve(1);
    Surface surface;
    ros::serialization::IStream stream(cut.data(), static_cast<std::uint32_t>(size));
    EXPECT_ANY_THROW(ros::serialization::deserialize(stream, surface)) << size << " of " << bytes.size() << " bytes";
  }
}

TEST(CoreMessages, AnImageOfAnotherSizeThanStatedIsRefused) {
  TimeSurface message;
  message.height = 2;
  message.width = 3;
  message.image.resize(5);
  EXPECT_THROW(FromBytes<Surface>(Bytes(message)), std::runtime_error);
}

TEST(CoreMessages, AnUnknownTrackingStateIsRefused) {
  TrackedPose message;
  message.T_world_event.orientation.w = message.T_world_event_edges.orientation.w = 1;
  message.state = 5;
  EXPECT_THROW(FromBytes<PoseEstimate>(Bytes(message)), std::runtime_error);
}

TEST(CoreMessages, PointersOfTheTwoLibrariesShareOneObjectAndReleaseIt) {
  auto original = std::make_shared<const Surface>();
  const std::weak_ptr<const Surface> watch = original;
  const Surface* const address = original.get();
  boost::shared_ptr<const Surface> as_boost = ToBoost(std::move(original));
  EXPECT_EQ(as_boost.get(), address);
  std::shared_ptr<const Surface> back = ToStd(std::move(as_boost));
  EXPECT_EQ(back.get(), address);
  EXPECT_FALSE(watch.expired());
  back.reset();
  EXPECT_TRUE(watch.expired());
}

}  // namespace
}  // namespace devo
