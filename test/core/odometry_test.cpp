// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/odometry.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "devo/core/time.h"
#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

constexpr double kCorner_m = 3, kSlope = 1.5, kDuration_s = 1.5;
constexpr std::int64_t kStart_ns = 1'000'000'000, kStep_ns = 500'000, kDepthPeriod_ns = 33'000'000;
constexpr int kSteps = 4;

/// Depth registered to an event image without distortion.
Rig TestRig() {
  Rig rig;
  rig.event_camera = rig.depth_camera = Camera(346, 260, 260, 260, 172.5, 129.5, "", {});
  rig.depth_registered = true;
  return rig;
}

/// A swing in front of a corner of two walls, z = kCorner_m - kSlope * |x|: all six directions,
/// from rest to 0.6 m/s.
Rigid3 TruePose(std::int64_t t_ns) {
  const double a = 2 * M_PI * SecondsFromNs(t_ns - kStart_ns) / 1.5;
  const double sway = 1 - std::cos(a), nod = std::sin(a) * std::sin(a);
  Vector6d xi;
  xi << 0.15 * sway, 0.06 * nod, 0.04 * sway, 0.02 * nod, 0.02 * sway, 0.04 * sway;
  return Exp(xi);
}

/// A bright or dark step on one of the walls.
struct Segment {
  Eigen::Vector3d a, b;
  double sign;
};

std::vector<Segment> Segments() {
  std::mt19937 random(15);
  std::uniform_real_distribution<double> angle(0, M_PI), shift(-0.02, 0.02);
  std::vector<Segment> segments;
  for (int row = 0; row < 8; ++row) {
    for (int column = 0; column < 10; ++column) {
      const double x = -1.08 + 0.24 * column + shift(random), y = -1.05 + 0.3 * row + shift(random);
      const double a = angle(random), half_x = 0.09 * std::cos(a), half_y = 0.09 * std::sin(a);
      const double side = column < 5 ? -1 : 1;  // no segment reaches over the corner
      const auto on_wall = [&](double px, double py) {
        return Eigen::Vector3d(px, py, kCorner_m - kSlope * side * px);
      };
      segments.push_back(
          {on_wall(x - half_x, y - half_y), on_wall(x + half_x, y + half_y), (row + column) % 2 ? 1.0 : -1.0});
    }
  }
  return segments;
}

/// The image line of a segment: `across` as a function of `along`, along the axis that is closer to the segment.
struct ImageLine {
  bool upright;  // along = row, across = column
  double along_a, across_a, along_b, across_b;
  double AcrossAt(double along) const {
    return across_a + (along - along_a) / (along_b - along_a) * (across_b - across_a);
  }
};

ImageLine Project(const Segment& segment, const Rigid3& T_event_world, bool upright) {
  const Camera& camera = TestRig().event_camera;
  const Eigen::Vector2d u = *camera.Project(T_event_world * segment.a), v = *camera.Project(T_event_world * segment.b);
  return upright ? ImageLine{true, u.y(), u.x(), v.y(), v.x()} : ImageLine{false, u.x(), u.y(), v.x(), v.y()};
}

/// The events of edges one pixel wide whose contrast is kSteps times the sensor's threshold: so many whenever a segment
/// crosses a pixel, evenly, in closed form between the steps of time.
std::vector<Event> MakeEvents() {
  const Camera camera = TestRig().event_camera;
  std::vector<Event> events;
  for (const Segment& segment : Segments()) {
    const Eigen::Vector3d along = segment.b - segment.a;
    const bool upright = std::abs(along.y()) > std::abs(along.x());
    ImageLine before = Project(segment, TruePose(kStart_ns).inverse(), upright);
    for (std::int64_t t_ns = kStart_ns + kStep_ns; t_ns < kStart_ns + NsFromSeconds(kDuration_s); t_ns += kStep_ns) {
      const ImageLine now = Project(segment, TruePose(t_ns).inverse(), upright);
      const int from = static_cast<int>(std::ceil(std::min(now.along_a, now.along_b)));
      const int to = static_cast<int>(std::floor(std::max(now.along_a, now.along_b)));
      for (int k = from; k <= to; ++k) {
        const double old_across = before.AcrossAt(k), across = now.AcrossAt(k);
        const double old_level = std::floor(kSteps * old_across + 0.5), level = std::floor(kSteps * across + 0.5);
        if (old_level == level) continue;
        const double crossed = (std::max(old_level, level) - 0.5) / kSteps, pixel = std::round(crossed);
        const double x = upright ? pixel : k, y = upright ? k : pixel;
        if (!camera.Contains({x, y})) continue;
        const std::int64_t t_event_ns = t_ns + std::llround((crossed - across) / (across - old_across) * kStep_ns);
        events.push_back({t_event_ns, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                          static_cast<std::uint8_t>(segment.sign * (across - old_across) > 0)});
      }
      before = now;
    }
  }
  std::stable_sort(events.begin(), events.end(), [](const Event& e, const Event& f) { return e.t_ns < f.t_ns; });
  return events;
}

DepthImage DepthOfCorner(std::int64_t t_ns) {
  const Camera camera = TestRig().event_camera;
  const Rigid3 T_world_event = TruePose(t_ns);
  DepthImage depth{t_ns, cv::Mat1f(camera.height(), camera.width())};
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const Eigen::Vector3d ray = T_world_event.rotation() * *camera.Unproject(Eigen::Vector2d(x, y));
      double nearest_m = 1e9;  // a corner seen from inside: of both walls, the one that the ray meets first
      for (const double side : {-1, 1}) {
        const Eigen::Vector3d normal(kSlope * side, 0, 1);
        const double z_m = (kCorner_m - normal.dot(T_world_event.translation())) / normal.dot(ray);
        if (z_m > 0) nearest_m = std::min(nearest_m, z_m);
      }
      depth.depth_m(y, x) = static_cast<float>(nearest_m);
    }
  }
  return depth;
}

OdometryOptions WithoutFilter() {
  OdometryOptions options;
  options.surface.noise_neighbours = 0;  // these events have no noise
  options.surface.hot_pixel_factor = 0;
  return options;
}

struct Outcome {
  std::vector<PoseEstimate> poses;
  std::vector<LocalMapPtr> maps;
  Odometry::Counters counters;
  std::size_t surfaces = 0;
};

/// Feeds the sequence, events in slices of random sizes up to `max_slice`.
Outcome OutcomeWith(std::size_t max_slice, int threads = 1,
                    const std::function<DepthImage(std::int64_t)>& depth_at = DepthOfCorner) {
  static const std::vector<Event> events = MakeEvents();
  Odometry odometry(TestRig(), WithoutFilter(), threads);
  Outcome run;
  odometry.on_pose = [&](const PoseEstimate& pose, const Surface& surface) {
    EXPECT_EQ(pose.t_ns, surface.t_ns);
    run.poses.push_back(pose);
  };
  odometry.on_local_map = [&](const LocalMapPtr& map) { run.maps.push_back(map); };
  std::mt19937 random(16);
  std::uniform_int_distribution<std::size_t> size(1, max_slice);
  std::size_t next = 0;
  for (std::int64_t depth_ns = kStart_ns; next < events.size(); depth_ns += kDepthPeriod_ns) {
    odometry.AddDepth(depth_at(depth_ns));
    while (next < events.size() && events[next].t_ns < depth_ns + kDepthPeriod_ns) {
      std::size_t end = next;
      for (std::size_t n = size(random); n > 0 && end < events.size() && events[end].t_ns < depth_ns + kDepthPeriod_ns;
           --n) {
        ++end;
      }
      odometry.AddEvents({events.data() + next, end - next});
      next = end;
    }
  }
  odometry.Finish();
  run.counters = odometry.counters();
  run.surfaces = odometry.timings().surface_ms.size();
  return run;
}

TEST(Odometry, FollowsASwingToOnePercentOfItsLength) {
  const Outcome run = OutcomeWith(1000);
  ASSERT_FALSE(run.maps.empty());
  // The world's frame is the event camera's at the first reference.
  const Rigid3 T_truth_world = TruePose(run.maps.front()->t_ns);
  double length_m = 0, sum2 = 0, worst = 0;
  for (std::size_t k = 0; k < run.poses.size(); ++k) {
    const Rigid3 truth = T_truth_world.inverse() * TruePose(run.poses[k].t_ns);
    const double error_m = (truth.translation() - run.poses[k].T_world_event.translation()).norm();
    sum2 += error_m * error_m / static_cast<double>(run.poses.size());
    worst = std::max(worst, error_m);
    if (k > 0) {
      length_m += (TruePose(run.poses[k].t_ns).translation() - TruePose(run.poses[k - 1].t_ns).translation()).norm();
    }
  }
  RecordProperty("ate_mm", std::to_string(1e3 * std::sqrt(sum2)));
  EXPECT_GT(length_m, 0.5);
  EXPECT_GT(run.poses.size(), 120U);  // of 150 surfaces; the first reference needs motion
  EXPECT_LT(std::sqrt(sum2), 0.01 * length_m);
  EXPECT_LT(worst, 0.03 * length_m);
}

TEST(Odometry, GivesPosesInOrderThatAreFiniteAndTracking) {
  const Outcome run = OutcomeWith(1000);
  std::int64_t last_ns = 0;
  for (const PoseEstimate& pose : run.poses) {
    ASSERT_EQ(pose.t_ns % 10'000'000, 0);
    ASSERT_TRUE(last_ns == 0 || pose.t_ns == last_ns + 10'000'000);
    last_ns = pose.t_ns;
    ASSERT_TRUE(pose.T_world_event.IsFinite() && pose.T_world_event_edges.IsFinite());
    ASSERT_TRUE(pose.covariance_event.allFinite() && pose.velocity_event.allFinite());
    ASSERT_TRUE(std::isfinite(pose.inlier_share) && std::isfinite(pose.mean_residual_px));
    EXPECT_EQ(pose.state, TrackingState::kTracking) << SecondsFromNs(pose.t_ns);
  }
  for (const auto& map : run.maps) {
    for (const MapPoint& point : map->points) ASSERT_TRUE(point.p_ref.allFinite() && point.normal_ref.allFinite());
  }
  EXPECT_EQ(run.counters.events.unordered, 0U);
  EXPECT_EQ(run.counters.events.outside, 0U);
  EXPECT_EQ(run.counters.mapping.depth_without_valid_pixel, 0U);
  EXPECT_GE(run.counters.mapping.references, 1U);
  EXPECT_GT(run.counters.mapping.depth_used, 35U);
}

TEST(Odometry, GivesTheSamePosesHoweverTheEventsAreCut) {
  const Outcome reference = OutcomeWith(1000);
  for (const std::size_t max_slice : {1UL, 37UL, 1000000UL}) {
    const Outcome other = OutcomeWith(max_slice);
    ASSERT_EQ(other.poses.size(), reference.poses.size()) << max_slice;
    for (std::size_t k = 0; k < reference.poses.size(); ++k) {
      ASSERT_EQ(other.poses[k].t_ns, reference.poses[k].t_ns);
      ASSERT_EQ(other.poses[k].T_world_event.matrix(), reference.poses[k].T_world_event.matrix()) << max_slice;
    }
    EXPECT_EQ(other.surfaces, reference.surfaces);
  }
}

TEST(Odometry, GivesTheSamePosesAndMapsWithThreads) {
  const Outcome reference = OutcomeWith(1000), other = OutcomeWith(1000, 2);
  ASSERT_EQ(other.poses.size(), reference.poses.size());
  for (std::size_t k = 0; k < reference.poses.size(); ++k) {
    ASSERT_EQ(other.poses[k].t_ns, reference.poses[k].t_ns);
    ASSERT_EQ(other.poses[k].T_world_event.matrix(), reference.poses[k].T_world_event.matrix());
    ASSERT_EQ(other.poses[k].reference_id, reference.poses[k].reference_id);
  }
  ASSERT_EQ(other.maps.size(), reference.maps.size());
  for (std::size_t k = 0; k < reference.maps.size(); ++k) {
    ASSERT_EQ(other.maps[k]->t_ns, reference.maps[k]->t_ns);
    ASSERT_EQ(other.maps[k]->points.size(), reference.maps[k]->points.size());
  }
  EXPECT_EQ(other.counters.mapping.depth_used, reference.counters.mapping.depth_used);
  EXPECT_EQ(other.surfaces, reference.surfaces);
}

TEST(Odometry, FollowsADepthImageFromThePoseAfterTheFirstOneThatItsTimeLiesBefore) {
  const std::int64_t other_ns = kStart_ns + 20 * kDepthPeriod_ns;
  const auto with_other = [other_ns](std::int64_t t_ns) {
    DepthImage depth = DepthOfCorner(t_ns);
    if (t_ns == other_ns) depth.depth_m = cv::Mat1f(depth.depth_m * 1.002);
    return depth;
  };
  for (const int threads : {1, 2}) {
    const auto as_it_is = OutcomeWith(1000, threads).poses, otherwise = OutcomeWith(1000, threads, with_other).poses;
    ASSERT_EQ(as_it_is.size(), otherwise.size());
    const auto same = [](const PoseEstimate& a, const PoseEstimate& b) {
      return a.T_world_event.translation() == b.T_world_event.translation();
    };
    const auto first = std::mismatch(as_it_is.begin(), as_it_is.end(), otherwise.begin(), same).first;
    ASSERT_GT(first - as_it_is.begin(), 2);
    ASSERT_NE(first, as_it_is.end());
    EXPECT_LT((first - 2)->t_edges_ns, other_ns);
    EXPECT_GE((first - 1)->t_edges_ns, other_ns);
  }
}

TEST(Odometry, DeliversAnErrorOfItsThreadsToTheCaller) {
  Odometry odometry(TestRig(), WithoutFilter(), 2);
  odometry.AddDepth({kStart_ns, cv::Mat1f(10, 10, 1.0F)});
  const auto feed = [&] {
    odometry.AddEvents(MakeEvents());
    odometry.Finish();
  };
  EXPECT_THAT(feed, ThrowsMessage<std::invalid_argument>(HasSubstr("10x10")));
}

TEST(Odometry, RefusesEventsThatJumpToAnotherClockRatherThanRenderAllTheTimeBetween) {
  Odometry odometry(TestRig(), WithoutFilter());
  odometry.AddEvents(std::vector<Event>{{kStart_ns, 10, 10, 1}, {kStart_ns + 20'000'000, 11, 10, 1}});
  const std::vector<Event> later = {{kStart_ns + 1'700'000'000'000'000'000, 10, 10, 1}};
  EXPECT_THAT([&] { odometry.AddEvents(later); }, ThrowsMessage<std::runtime_error>(HasSubstr("those up to 1.030 s")));
}

TEST(Odometry, HasNoPoseWithoutDepth) {
  Odometry odometry(TestRig(), WithoutFilter());
  int poses = 0;
  odometry.on_pose = [&](const PoseEstimate&, const Surface&) { ++poses; };
  odometry.AddEvents(MakeEvents());
  EXPECT_EQ(poses, 0);
  EXPECT_TRUE(odometry.GlobalMap().empty());
  EXPECT_GT(odometry.counters().events.used, 0U);
}

TEST(Odometry, RefusesAnOptionThatIsOutOfRangeAndNamesIt) {
  OdometryOptions options;
  options.surface.rate_hz = 0;
  EXPECT_THAT([&] { const Odometry odometry(TestRig(), options); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("surface.rate_hz")));
}

}  // namespace
}  // namespace devo
