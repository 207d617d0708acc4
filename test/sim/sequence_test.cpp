// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/sequence.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include <gtest/gtest.h>

#include "devo/core/time.h"
#include "devo/sim/rig_file.h"

namespace devo::sim {
namespace {

SequenceOptions Small() {
  SequenceOptions o;
  o.sensor = "davis240";
  o.duration_s = 0.25;
  o.rest_s = 0.05;
  return o;
}

struct Recording {
  std::vector<Event> events;
  std::vector<DepthImage> depth;
  std::vector<Frame> frames;
  std::vector<ImuSample> imu;
  std::vector<TimedPose> poses;
  std::vector<LidarScan> scans;
};

Recording Record(const SequenceOptions& options) {
  Sequence sequence(options);
  Recording all;
  Chunk chunk;
  const auto append = [](auto& from, auto* to) { to->insert(to->end(), from.begin(), from.end()); };
  while (sequence.Next(&chunk)) {
    append(chunk.events, &all.events);
    append(chunk.depth, &all.depth);
    append(chunk.frames, &all.frames);
    append(chunk.imu, &all.imu);
    append(chunk.poses, &all.poses);
    append(chunk.scans, &all.scans);
  }
  return all;
}

bool Same(const Recording& a, const Recording& b) {
  if (a.events.size() != b.events.size() || a.depth.size() != b.depth.size() || a.frames.size() != b.frames.size())
    return false;
  for (std::size_t i = 0; i < a.events.size(); ++i) {
    const Event &e = a.events[i], &f = b.events[i];
    if (e.t_ns != f.t_ns || e.x != f.x || e.y != f.y || e.polarity != f.polarity) return false;
  }
  for (std::size_t i = 0; i < a.depth.size(); ++i) {
    if (std::memcmp(a.depth[i].depth_m.data, b.depth[i].depth_m.data, a.depth[i].depth_m.total() * 4) != 0)
      return false;
  }
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    if (std::memcmp(a.frames[i].image.data, b.frames[i].image.data, a.frames[i].image.total()) != 0) return false;
  }
  return true;
}

TEST(Sequence, IsTheSameWhateverTheNumberOfThreadsAndAnotherWithAnotherSeed) {
  SequenceOptions options = Small();
  options.threads = 1;
  const Recording one = Record(options);
  options.threads = 3;
  EXPECT_TRUE(Same(one, Record(options)));
  options.seed = 2;
  EXPECT_FALSE(Same(one, Record(options)));
  EXPECT_GT(one.events.size(), 5000U);
}

TEST(Sequence, DeliversEverythingInOrderInsideItsChunk) {
  SequenceOptions options = Small();
  options.lidar = true;
  Sequence sequence(options);
  Chunk chunk;
  std::int64_t last_ns = sequence.begin_ns();
  std::size_t depth = 0, frames = 0, imu = 0, poses = 0;
  while (sequence.Next(&chunk)) {
    EXPECT_EQ(chunk.begin_ns, last_ns);
    std::int64_t t = chunk.begin_ns;
    for (const Event& e : chunk.events) {
      ASSERT_GE(e.t_ns, t);
      ASSERT_LE(e.t_ns, chunk.end_ns);
      ASSERT_LT(e.x, 240);
      ASSERT_LT(e.y, 180);
      ASSERT_EQ(e.t_ns % 1000, 0);
      t = e.t_ns;
    }
    for (const auto& d : chunk.depth) EXPECT_TRUE(d.t_ns > chunk.begin_ns && d.t_ns <= chunk.end_ns);
    for (const auto& p : chunk.poses) EXPECT_TRUE(p.t_ns > chunk.begin_ns && p.t_ns <= chunk.end_ns);
    depth += chunk.depth.size();
    frames += chunk.frames.size();
    imu += chunk.imu.size();
    poses += chunk.poses.size();
    last_ns = chunk.end_ns;
  }
  EXPECT_EQ(last_ns, sequence.end_ns());
  EXPECT_EQ(depth, 7U);   // 30 Hz from 20 ms on
  EXPECT_EQ(frames, 8U);  // 30 Hz, exposed 8 ms from 5 ms on
  EXPECT_EQ(imu, 50U);
  EXPECT_EQ(poses, 50U);
}

TEST(Sequence, HasAlmostNoEventsAtRestInBrightLight) {
  SequenceOptions options = Small();
  options.rest_s = 10;
  options.depth = SequenceOptions::Depth::kNone;
  const Recording still = Record(options);
  EXPECT_LT(static_cast<double>(still.events.size()) / (240 * 180 * options.duration_s), 1.0);
  EXPECT_TRUE(still.depth.empty());
}

TEST(Sequence, FiresBrighterAndDarkerWithLightThatFlickersAtRest) {
  SequenceOptions options = Small();
  options.rest_s = 10;
  options.depth = SequenceOptions::Depth::kNone;
  options.frames = false;
  options.duration_s = 0.1;
  options.flicker = 0.2;  // 0.4 from the darkest to the brightest, of which thresholds are a half
  const std::vector<Event> events = Record(options).events;
  EXPECT_GT(events.size(), 240 * 180 * 10);
  std::size_t alike = 0;
  for (const Event& event : events) {
    const std::int64_t in_period_ns = event.t_ns % NsFromSeconds(0.01);
    // The photoreceptor follows within a millisecond.
    const bool brightens = in_period_ns < NsFromSeconds(0.0035) || in_period_ns > NsFromSeconds(0.0075);
    alike += brightens == (event.polarity == 1);
  }
  EXPECT_GT(alike, 0.95 * static_cast<double>(events.size()));
}

TEST(Sequence, SeesAThingThatSwaysBeforeACameraThatStandsWhereItIsAtEachTime) {
  const std::string path = testing::TempDir() + "sway_" + std::to_string(getpid()) + ".yaml";
  std::ofstream(path) << R"(
    materials: [{name: wall, texture: plain, reflectance: 0.3}, {name: box, texture: checker, size_m: 0.1}]
    room: {min: [-1, -2, 0], max: [3, 2, 2], floor: wall, ceiling: wall, wall: wall}
    boxes: [{position: [1.5, -0.2, 0.8], size: [0.2, 0.2, 0.4], material: box, sway: {by: [0, 0.4, 0], period_s: 0.4}}]
    motion: {position_min: [0, 0, 1], position_max: [0, 0, 1], target_min: [2, 0, 1], target_max: [2, 0, 1]})";
  SequenceOptions options = Small();
  options.scene = path;
  options.rest_s = 10;
  options.depth = SequenceOptions::Depth::kRegistered;
  const Recording seen = Record(options);
  const Sequence sequence(options);
  const Camera& camera = sequence.rig().event_camera;
  const auto pixel_of = [&](double y) {
    return *camera.Project(sequence.trajectory().PoseAt(0).inverse() * Eigen::Vector3d(1.4, y, 1));
  };
  ASSERT_EQ(seen.depth.size(), 7U);
  for (const DepthImage& image : seen.depth) {
    const double t_s = SecondsFromNs(image.t_ns - sequence.begin_ns());
    const Eigen::Vector2d on = pixel_of(-0.2 * std::cos(6.283185307 * t_s / 0.4));
    EXPECT_NEAR(image.depth_m(std::lround(on.y()), std::lround(on.x())), 1.4, 5e-3) << t_s;  // behind it are 3 m
  }
  const double left = pixel_of(0.3).x() - 2, right = pixel_of(-0.3).x() + 2;  // y is to the left
  const auto on_way =
      std::count_if(seen.events.begin(), seen.events.end(), [&](const Event& e) { return e.x > left && e.x < right; });
  EXPECT_GT(on_way, 5000);
  EXPECT_LT(static_cast<double>(seen.events.size() - on_way), 0.05 * static_cast<double>(on_way));
}

TEST(Sequence, TakesDepthAtTheRateAndWithTheTimeOffsetThatAreSet) {
  SequenceOptions options = Small();
  options.depth_rate_hz = 5;
  options.depth_time_offset_s = 0.01;
  const Recording late = Record(options);
  ASSERT_EQ(late.depth.size(), 2U);
  EXPECT_EQ(late.depth[1].t_ns - late.depth[0].t_ns, 200000000);
  options.depth_time_offset_s = 0;
  const Recording right = Record(options);
  EXPECT_EQ(late.depth[1].t_ns - right.depth[1].t_ns, 10000000);
  EXPECT_EQ(std::memcmp(late.depth[1].depth_m.data, right.depth[1].depth_m.data, 640 * 576 * 4), 0);
}

TEST(Sequence, GivesFewerEventsAndMoreNoiseWithLessLight) {
  SequenceOptions options = Small();
  options.depth = SequenceOptions::Depth::kNone;
  options.frames = false;
  const std::size_t bright = Record(options).events.size();
  options.light = "dark";
  const std::size_t dark = Record(options).events.size();
  EXPECT_LT(dark, bright);
  options.rest_s = 10;
  const std::size_t noise = Record(options).events.size();
  options.light = "bright";
  EXPECT_GT(noise, Record(options).events.size());
}

TEST(Sequence, FollowsTheTrajectoryOfATumFile) {
  const Trajectory motion = RandomTrajectory(MakeScene("table").motion, LimitsOf("slow"), 1, 9);
  const std::string path = testing::TempDir() + "motion_" + std::to_string(getpid()) + ".tum";
  std::ofstream file(path);
  file.precision(12);
  for (int i = 0; i <= 50; ++i) {
    const Rigid3 T = motion.PoseAt(0.02 * i);
    const Eigen::Quaterniond& q = T.rotation();
    file << 5 + 0.02 * i << ' ' << T.translation().transpose() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' '
         << q.w() << '\n';
  }
  file.close();
  SequenceOptions options = Small();
  options.trajectory_file = path;
  options.rest_s = 0;
  options.depth = SequenceOptions::Depth::kNone;
  options.frames = false;
  for (const TimedPose& pose : Record(options).poses) {
    const Rigid3 expected = motion.PoseAt(1e-9 * static_cast<double>(pose.t_ns) - options.start_s);
    EXPECT_LT(Log(expected.inverse() * pose.T_world_event).norm(), 1e-4);
  }
}

TEST(Sequence, NamesTheOptionThatItCannotUse) {
  const auto message = [](const SequenceOptions& o) -> std::string {
    try {
      Sequence sequence(o);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  };
  SequenceOptions o = Small();
  o.scene = "kitchen";
  EXPECT_NE(message(o).find("kitchen"), std::string::npos);
  o = Small();
  o.light = "neon";
  EXPECT_NE(message(o).find("neon"), std::string::npos);
  o = Small();
  o.sensor = "gen9";
  EXPECT_NE(message(o).find("gen9"), std::string::npos);
  o = Small();
  o.speed = "warp";
  EXPECT_NE(message(o).find("warp"), std::string::npos);
  o = Small();
  o.flicker = 1;
  EXPECT_NE(message(o).find("flicker = 1"), std::string::npos);
  o = Small();
  o.flicker_hz = 0;
  EXPECT_NE(message(o).find("flicker_hz"), std::string::npos);
  o = Small();
  o.duration_s = 0;
  EXPECT_NE(message(o).find("duration"), std::string::npos);
  o = Small();
  o.trajectory_file = "/nowhere/poses.txt";
  EXPECT_NE(message(o).find("/nowhere/poses.txt"), std::string::npos);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  o = Small();
  o.stops = {{nan, 1}};
  EXPECT_NE(message(o).find("stop"), std::string::npos);
  o = Small();
  o.depth_time_offset_s = nan;
  EXPECT_NE(message(o).find("depth offset"), std::string::npos);
  o = Small();
  o.lidar_rate_hz = nan;
  EXPECT_NE(message(o).find("LiDAR rate"), std::string::npos);
  o = Small();
  o.multipath = nan;
  EXPECT_NE(message(o).find("multipath"), std::string::npos);
}

TEST(LoadScene, ReadsTheExample) {
  const Scene scene = LoadScene(DEVO_SOURCE_DIR "/config/sim/example_scene.yaml");
  EXPECT_EQ(scene.name, "example");
  EXPECT_GT(scene.surfaces().size(), 10U);
  EXPECT_FALSE(scene.lamps.empty());
}

TEST(LoadScene, NamesTheKeyThatItDoesNotKnowAndTheMaterialThatIsMissing) {
  const auto message = [](const std::string& yaml) -> std::string {
    const std::string path = testing::TempDir() + "scene_" + std::to_string(getpid()) + ".yaml";
    std::ofstream(path) << yaml;
    try {
      LoadScene(path);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(message("spheres: []").find("spheres"), std::string::npos);
  EXPECT_NE(message("boxes: [{position: [0, 0, 0], size: [1, 1, 1], material: gold}]").find("gold"), std::string::npos);
  EXPECT_NE(message("materials: [{name: a, texture: velvet}]").find("velvet"), std::string::npos);
  const std::string sways =
      "materials: [{name: a, texture: plain}]\n"
      "boxes: [{position: [0, 0, 0], size: [1, 1, 1], material: a, sway: ";
  EXPECT_NE(message(sways + "{by: [1, 0, 0], speed: 2}}]").find("speed"), std::string::npos);
  EXPECT_NE(message(sways + "{by: [1, 0, 0], period_s: 0}}]").find("period_s"), std::string::npos);
}

}  // namespace
}  // namespace devo::sim
