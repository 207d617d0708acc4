// SPDX-License-Identifier: BSD-3-Clause
//
// The offline runner as a user runs it: the real program on small bags, good and bad.
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <variant>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "devo/core/time.h"
#include "devo/io/rig_config.h"
#include "devo/io/trajectory.h"
#include "devo/ros/bag_reader.h"
#include "devo/ros/conversions.h"
#include "tools/tiny_bag.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kConfig[] =
    "topics: {events: /events, event_camera_info: /event_info, depth: /depth, depth_camera_info: /depth_info,"
    " ground_truth: /truth}\n";

std::string Contents(const std::string& path) {
  std::stringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

std::size_t FileSize(const std::string& path) { return Contents(path).size(); }

class DevoOffline : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = ::testing::TempDir() + "devo_offline_test_" + std::to_string(getpid());
    ASSERT_EQ(std::system(("rm -rf " + folder_ + " && mkdir -p " + folder_).c_str()), 0);
    WriteConfig(kConfig);
  }
  void TearDown() override { ASSERT_EQ(std::system(("rm -rf " + folder_).c_str()), 0); }

  void WriteConfig(const std::string& text) { std::ofstream(folder_ + "/rig.yaml") << text; }
  std::string Bag() const { return folder_ + "/a.bag"; }
  ProgramResult Run(const std::string& more = "") {
    return RunProgram("devo_offline",
                      "--config " + folder_ + "/rig.yaml --bag " + Bag() + " --out " + folder_ + "/out " + more);
  }
  std::string Trajectory() const { return Contents(folder_ + "/out/trajectory.txt"); }
  nlohmann::json Report() const { return nlohmann::json::parse(Contents(folder_ + "/out/report.json")); }

  /// Bad input: status 2 and one line on standard error (but for progress) that says all of `matcher`.
  template <typename Matcher>
  static void ExpectRefused(const ProgramResult& result, const Matcher& matcher) {
    EXPECT_EQ(result.status, 2) << result.err;
    std::istringstream lines(result.err);
    std::string complaint;
    int complaints = 0;
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("devo_offline: ", 0) != 0 || line.rfind("devo_offline: warning", 0) == 0) continue;
      complaint = line;
      ++complaints;
    }
    EXPECT_EQ(complaints, 1) << result.err;
    EXPECT_THAT(complaint, matcher);
  }

  std::string folder_;
};

TEST_F(DevoOffline, FollowsAKnownMotion) {
  TinyRecording().Write(Bag());
  const ProgramResult result = Run();
  ASSERT_EQ(result.status, 0) << result.err;
  const auto report = Report();
  EXPECT_TRUE(report["error"].is_null());
  EXPECT_GE(report["coverage"], 0.99);
  EXPECT_TRUE(report["lost_intervals"].empty());
  EXPECT_GE(report["references"], 1);
  EXPECT_EQ(report["events"]["in"], report["events"]["used"]);
  ASSERT_FALSE(report["evaluation"].is_null());
  EXPECT_LT(report["evaluation"]["ate_rmse_m"], 0.005) << "of a path of 0.29 m";
  EXPECT_THAT(Contents(folder_ + "/out/map.pcd"), HasSubstr("DATA binary"));
  EXPECT_GT(report["map_points"], 100);
}

TEST_F(DevoOffline, FollowsAKnownMotionInLightThatFlickersAndSaysSo) {
  TinyRecording().Write(Bag());
  const ProgramResult result = Run("--disturb flicker=1");
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("anti-flicker"));
  const auto report = Report();
  EXPECT_GT(report["events"]["of_lamps"], 1000000);
  EXPECT_TRUE(report["lost_intervals"].empty());
  ASSERT_FALSE(report["evaluation"].is_null());
  EXPECT_LT(report["evaluation"]["ate_rmse_m"], 0.005) << "of a path of 0.29 m";
}

TEST_F(DevoOffline, GivesTheSameBytesOnEveryRunWithAnyNumberOfThreads) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(Run("--threads 1").status, 0);
  const std::string first = Trajectory(), first_map = Contents(folder_ + "/out/map.pcd");
  ASSERT_GT(first.size(), 1000U);
  for (const char* threads : {"--threads 1", "--threads 2", "--threads 4"}) {
    ASSERT_EQ(Run(threads).status, 0);
    EXPECT_EQ(Trajectory(), first) << threads;
    EXPECT_EQ(Contents(folder_ + "/out/map.pcd"), first_map) << threads;
  }
}

TEST_F(DevoOffline, GivesTheSameFromEveryCompressionAndFromSeveralBags) {
  TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  ASSERT_GT(expected.size(), 1000U);
  for (const auto compression : {rosbag::compression::Uncompressed, rosbag::compression::BZ2}) {
    recording.Write(Bag(), compression);
    ASSERT_EQ(Run().status, 0);
    EXPECT_EQ(Trajectory(), expected);
  }
  // One bag per topic, as VECtor publishes them.
  TinyRecording events = recording, rest = recording;
  events.depth.clear();
  events.truth.clear();
  events.transforms.clear();
  rest.events.clear();
  events.Write(Bag());
  rest.Write(folder_ + "/b.bag");
  ASSERT_EQ(Run("--bag " + folder_ + "/b.bag").status, 0);
  EXPECT_EQ(Trajectory(), expected);
}

TEST_F(DevoOffline, DoesNotTrustTheHeadersOfEventArrays) {
  TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  for (EventArray& array : recording.events) array.header.stamp = ros::Time(5, 0);
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  EXPECT_EQ(Trajectory(), expected);
}

TEST_F(DevoOffline, ThinsDepthToTheRateAskedFor) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(Run("--depth-rate 5").status, 0);
  EXPECT_EQ(Report()["depth_frames"]["in"], 5);
  EXPECT_EQ(Report()["depth_frames"]["skipped_by_rate"], 15);
}

TEST_F(DevoOffline, CutsTheRangeAskedFor) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(Run("--start 0.3 --duration 0.4").status, 0);
  const auto report = Report();
  EXPECT_NEAR(report["begin_s"], 100.3, 0.02);
  EXPECT_NEAR(report["end_s"], 100.7, 0.02);
}

TEST_F(DevoOffline, EvaluatesAgainstAFile) {
  TinyRecording recording;
  ::devo::Trajectory truth;
  for (int i = 0; i <= 100; ++i) {
    truth.push_back({recording.scene.begin_ns + i * 10000000LL, recording.scene.PoseAt(0.01 * i)});
  }
  WriteTum(folder_ + "/truth.txt", truth);
  recording.truth.clear();
  recording.Write(Bag());
  ASSERT_EQ(Run("--groundtruth " + folder_ + "/truth.txt").status, 0);
  EXPECT_LT(Report()["evaluation"]["ate_rmse_m"], 0.005);
}

TEST_F(DevoOffline, WritesPlainLinesWhereThereIsNoTerminal) {
  TinyRecording().Write(Bag());
  const ProgramResult result = Run();
  EXPECT_THAT(result.err, AllOf(HasSubstr("100 % of the events\n"), Not(HasSubstr("\r"))));
}

TEST_F(DevoOffline, NamesTheFileThatIsMissing) {
  ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("cannot be opened")));
  std::ofstream(Bag()) << "This is no bag.";
  ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("expected a ROS bag of format 2.0")));
  TinyRecording().Write(Bag());
  ExpectRefused(Run("--config no/such.yaml"), HasSubstr("'no/such.yaml'"));
  ExpectRefused(Run("--groundtruth no/such.txt"), HasSubstr("'no/such.txt'"));
  const ProgramResult nothing = RunProgram("devo_offline", "");
  EXPECT_EQ(nothing.status, 2);
  EXPECT_THAT(nothing.err, HasSubstr("--config"));
}

TEST_F(DevoOffline, NamesTheFolderForResultsThatCannotBeMade) {
  std::ofstream(folder_ + "/out") << "a file, where a folder is asked for";
  ExpectRefused(Run(), AllOf(HasSubstr(folder_ + "/out"), HasSubstr("expected a folder that can be written")));
}

TEST_F(DevoOffline, NamesTheFolderForResultsInWhichNothingCanBeWrittenBeforeItBegins) {
  TinyRecording().Write(Bag());
  const ProgramResult result =
      RunProgram("devo_offline", "--config " + folder_ + "/rig.yaml --bag " + Bag() + " --out /proc/self");
  ExpectRefused(result, AllOf(HasSubstr("'/proc/self'"), HasSubstr("cannot be written")));
  EXPECT_THAT(result.err, Not(HasSubstr("of the events")));
}

TEST_F(DevoOffline, RefusesABagThatIsGivenTwice) {
  TinyRecording().Write(Bag());
  ExpectRefused(Run("--bag " + folder_ + "/./a.bag"), HasSubstr("/./a.bag': given twice"));
}

TEST_F(DevoOffline, RefusesACopyOfABag) {
  TinyRecording().Write(Bag());
  std::ofstream(folder_ + "/a.orig.bag", std::ios::binary) << Contents(Bag());
  ExpectRefused(Run("--bag " + folder_ + "/a.orig.bag"),
                AllOf(HasSubstr("topic '/events' is in '" + Bag() + "'"), HasSubstr("would count twice")));
}

/// The recording's first and second half, as a recorder writes them that begins a new bag now and then.
std::pair<TinyRecording, TinyRecording> Halves(const TinyRecording& recording) {
  TinyRecording first = recording, second = recording;
  const auto halve = [](auto* before, auto* after) {
    const auto half = static_cast<std::ptrdiff_t>(before->size() / 2);
    before->erase(before->begin() + half, before->end());
    after->erase(after->begin(), after->begin() + half);
  };
  halve(&first.events, &second.events);
  halve(&first.depth, &second.depth);
  halve(&first.truth, &second.truth);
  return {first, second};
}

TEST_F(DevoOffline, GivesTheSameFromARecordingInTwoBagsWhicheverIsNamedFirst) {
  const TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  const auto [first, second] = Halves(recording);
  for (const bool reversed : {false, true}) {
    first.Write(reversed ? folder_ + "/b.bag" : Bag());
    second.Write(reversed ? Bag() : folder_ + "/b.bag");
    const ProgramResult result = Run("--bag " + folder_ + "/b.bag");
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(Trajectory(), expected);
  }
  const ProgramResult validated = RunProgram(
      "devo_validate_bag", "--config " + folder_ + "/rig.yaml --bag " + Bag() + " --bag " + folder_ + "/b.bag");
  EXPECT_EQ(validated.status, 0) << validated.out << validated.err;
  EXPECT_THAT(validated.out, Not(HasSubstr("will be dropped")));
}

TEST_F(DevoOffline, KeepsTheSensorsClockFromBagToBag) {
  const auto packet_at = [](std::uint64_t seq, std::uint32_t sensor_ms, double arrival_s) {
    EventPacket packet;
    packet.encoding = "evt2";
    packet.seq = seq;
    packet.header.stamp = ros::Time(arrival_s);
    for (const std::uint32_t word : {0x80000000U | sensor_ms * 1000 / 64, 0x10000000U}) {
      for (int i = 0; i < 4; ++i) packet.events.push_back(static_cast<std::uint8_t>(word >> (8 * i)));
    }
    return packet;
  };
  for (const int half : {0, 1}) {
    rosbag::Bag bag(folder_ + "/" + std::to_string(half) + ".bag", rosbag::bagmode::Write);
    for (std::uint32_t k = 1; k <= 10; ++k) {
      const std::uint32_t n = k + 10 * static_cast<std::uint32_t>(half);
      const double arrival_s = 100 + 0.064 * n + 0.005 * half;  // the second bag's packets are later underway
      bag.write("/events", ros::Time(arrival_s), packet_at(n, 64 * n, arrival_s));
      bag.write("/depth", ros::Time(arrival_s), DepthOf(TinyScene(), std::llround(1e9 * arrival_s), 1000));
    }
  }
  const RigConfig config = LoadRigConfig({folder_ + "/rig.yaml"}, {});
  BagReader reader({folder_ + "/0.bag", folder_ + "/1.bag"}, config);
  std::int64_t last_ns = 0;
  int events = 0;
  while (const auto item = reader.Next()) {
    const auto* slice = std::get_if<EventSlice>(&*item);
    if (!slice) continue;
    const std::int64_t t_ns = slice->events.begin()->t_ns;
    EXPECT_NEAR(1e-9 * static_cast<double>(t_ns - (events > 0 ? last_ns : t_ns - 64'000'000)), 0.064, 1e-6);
    last_ns = t_ns;
    ++events;
  }
  EXPECT_EQ(events, 20);
}

TEST_F(DevoOffline, NamesTheTopicThatIsMissingAndThoseThatAreThere) {
  TinyRecording().Write(Bag());
  ExpectRefused(Run("--set topics.events=/dvs/events"),
                AllOf(HasSubstr("'/dvs/events' (key 'topics.events')"), HasSubstr("/events (devo/EventArray)")));
  ExpectRefused(Run("--set topics.depth=/kinect"), HasSubstr("'/kinect' (key 'topics.depth')"));
  ExpectRefused(Run("--set topics.depth=/truth"),
                AllOf(HasSubstr("geometry_msgs/PoseStamped"), HasSubstr("expected sensor_msgs/Image")));
  ExpectRefused(Run("--set topics.depth="), HasSubstr("key 'topics.depth' is empty"));
  ExpectRefused(Run("--set topics.points=/velodyne"),
                HasSubstr("(key 'topics.points') is in none of the bags, expected sensor_msgs/PointCloud2"));
}

TEST_F(DevoOffline, RefusesNumbersThatAreNone) {
  TinyRecording().Write(Bag());
  for (const char* option : {"--start", "--duration", "--depth-rate"}) {
    for (const char* value : {"nan", "1e30", "inf", "-1"}) {
      const ProgramResult result = Run(std::string(option) + " " + value);
      EXPECT_EQ(result.status, 2) << option << " " << value;
      EXPECT_THAT(result.err, AllOf(HasSubstr(option), HasSubstr("expected a number from"))) << value;
    }
  }
  ExpectRefused(Run("--start 10"), HasSubstr("no events lie in the range that --start"));
}

TEST_F(DevoOffline, NamesTheCameraWithoutIntrinsics) {
  TinyRecording recording;
  recording.event_info.clear();
  recording.Write(Bag());
  ExpectRefused(Run(),
                AllOf(HasSubstr("'/event_info' (key 'topics.event_camera_info')"), HasSubstr("key 'event_camera'")));
  ExpectRefused(Run("--set topics.event_camera_info="), HasSubstr("no CameraInfo: neither key 'event_camera' nor"));
  recording.event_info.push_back(InfoOf(recording.scene, "event_optical"));
  recording.event_info[0].K.fill(0);
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/event_info'"), HasSubstr("is the camera calibrated?")));
}

TEST_F(DevoOffline, TakesTheCameraInfoBesideTheDataWhereTheConfigurationNamesNoneAsTheNodeletsDo) {
  const TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  rosbag::Bag bag(Bag(), rosbag::bagmode::Append);
  bag.write("/camera_info", ToRosTime(recording.scene.begin_ns), InfoOf(recording.scene, "event_optical"));
  bag.close();
  WriteConfig(
      "topics: {events: /events, depth: /depth, ground_truth: /truth}\nT_event_depth: "
      "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n");
  const ProgramResult result = Run();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(Trajectory(), expected);
}

TEST_F(DevoOffline, WarnsOfATopicThatIsMissingWhereItGoesOnWithoutIt) {
  TinyRecording().Write(Bag());
  const ProgramResult result = Run("--set topics.imu=/imu/data --set topics.ground_truth=/mocap");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, AllOf(HasSubstr("warning: topic '/imu/data' (key 'topics.imu') is in none of the bags"),
                                HasSubstr("warning: topic '/mocap' (key 'topics.ground_truth')")));
}

TEST_F(DevoOffline, NamesTheFramesWithoutExtrinsics) {
  TinyRecording recording;
  recording.transforms.clear();
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("no extrinsics from frame 'depth_optical' to frame 'event_optical'"),
                             HasSubstr("T_event_depth")));
  EXPECT_EQ(Run("--set T_event_depth='{translation: [0, 0, 0], quaternion: [0, 0, 0, 1]}'").status, 0);
  EXPECT_EQ(Run("--set registered=true").status, 0);
  recording.depth_info[0].header.frame_id.clear();
  for (auto& image : recording.depth) image.header.frame_id.clear();
  recording.Write(Bag());
  ExpectRefused(Run(), HasSubstr("the depth camera's messages name no frame_id (key 'frames.depth')"));
}

TEST_F(DevoOffline, NamesAnEncodingThatIsNoDepth) {
  TinyRecording recording;
  recording.depth[5].encoding = "mono8";
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/depth'"),
                             HasSubstr("encoding 'mono8', expected 16UC1 (millimetres) or 32FC1 (metres)")));
  EXPECT_GT(Trajectory().size(), 100U) << "what was computed until then is written";
}

TEST_F(DevoOffline, NamesASizeThatIsNotTheCalibrated) {
  TinyRecording recording;
  recording.depth_info[0].width = 320;
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/depth'"), HasSubstr("240x180, expected 320x180")));
}

TEST_F(DevoOffline, SaysThatNoDepthIsValid) {
  TinyRecording recording;
  for (auto& image : recording.depth) std::fill(image.data.begin(), image.data.end(), std::uint8_t{0});
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/depth'"), HasSubstr("has a valid pixel"), HasSubstr("mapping.min_depth_m")));
  EXPECT_EQ(Trajectory(), "");
}

TEST_F(DevoOffline, SaysThatEventsLieOutsideTheImage) {
  TinyRecording recording;
  for (EventArray& array : recording.events) {
    for (auto& event : array.events) event.x = static_cast<std::uint16_t>(event.x + 120);
  }
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/events' lie outside the image"), HasSubstr("x below 240 and y below 180")));
  EXPECT_GT(Report()["events"]["outside"], 0);
}

TEST_F(DevoOffline, SaysThatEventsGoBackInTime) {
  TinyRecording recording;
  for (EventArray& array : recording.events) std::reverse(array.events.begin(), array.events.end());
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/events'"), HasSubstr("earlier than the one before")));
  EXPECT_GT(Report()["events"]["unordered"], 0);
}

TEST_F(DevoOffline, ToleratesAFewUnorderedEventsWithAWarning) {
  TinyRecording recording;
  std::swap(recording.events[20].events[0], recording.events[20].events[30]);
  recording.Write(Bag());
  const ProgramResult result = Run();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("warning:"));
  EXPECT_THAT(result.err, HasSubstr("earlier than the one before"));
}

TEST_F(DevoOffline, LeavesOutEventsWhoseTimesAreFarFromAllOthers) {
  TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string undisturbed = Trajectory();
  // A bit that was transferred wrongly, and a first message without stamps.
  auto later = recording.events[20].events[10];
  later.ts = ros::Time(4000000000U, 0);
  recording.events[20].events.push_back(later);
  EventArray unstamped = recording.events[0];
  for (auto& event : unstamped.events) event.ts = ros::Time();
  recording.events.insert(recording.events.begin(), unstamped);
  recording.Write(Bag());
  const ProgramResult result = Run();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(Trajectory(), undisturbed);
  const std::string count = std::to_string(1 + unstamped.events.size());
  EXPECT_THAT(result.err, HasSubstr(count + " events of topic '/events' have times far from all others"));
}

TEST_F(DevoOffline, SaysThatDepthStampsRepeat) {
  TinyRecording recording;
  for (auto& image : recording.depth) image.header.stamp = recording.depth[4].header.stamp;
  recording.Write(Bag());
  ExpectRefused(Run(), AllOf(HasSubstr("'/depth'"), HasSubstr("not later than the one before")));
  EXPECT_EQ(Report()["depth_frames"]["unordered"], 19);
}

TEST_F(DevoOffline, DoesNotTakeRepeatedStampsOfOtherTopicsForThoseOfDepth) {
  TinyRecording recording;
  recording.AddImu();
  for (std::size_t i = 1; i < recording.imu.size(); i += 2) recording.imu[i].header = recording.imu[i - 1].header;
  for (std::size_t i = 1; i < recording.truth.size(); i += 2) recording.truth[i].header = recording.truth[i - 1].header;
  recording.Write(Bag());
  const ProgramResult result = Run("--set topics.imu=/imu");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(Report()["depth_frames"]["unordered"], 0);
  EXPECT_THAT(result.err, HasSubstr("50 IMU samples of topic '/imu' are not later than the one before"));
}

TEST_F(DevoOffline, ReadsAheadOfEventsByAsMuchAsTheClockOfAnImuMayBeLate) {
  TinyRecording recording;
  recording.AddImu();
  recording.Write(Bag());
  RigConfig config = LoadRigConfig({folder_ + "/rig.yaml"}, {"topics.imu=/imu"});
  const std::int64_t ahead_ns = NsFromSeconds(config.odometry.tracking.max_delay_s), period_ns = 10'000'000;
  BagReader reader({Bag()}, config);
  std::int64_t imu_ns = 0;
  int slices = 0;
  while (const auto item = reader.Next()) {
    if (const auto* sample = std::get_if<ImuSample>(&*item)) imu_ns = sample->t_ns;
    const auto* slice = std::get_if<EventSlice>(&*item);
    if (slice == nullptr) continue;
    const std::int64_t t_ns = slice->events.end()[-1].t_ns;
    EXPECT_GE(imu_ns, std::min(t_ns + ahead_ns - period_ns, FromRosTime(recording.imu.back().header.stamp)));
    EXPECT_LE(imu_ns, t_ns + ahead_ns + period_ns);
    ++slices;
  }
  EXPECT_GT(slices, 50);
}

TEST_F(DevoOffline, GivesNumbersWhereImuSamplesAreNone) {
  TinyRecording recording;
  recording.AddImu();
  for (std::size_t i = 0; i < recording.imu.size(); i += 4) {
    recording.imu[i].angular_velocity.x = 1e300;
    recording.imu[i].linear_acceleration.y = 1e300;
    recording.imu[i + 1].angular_velocity.z = std::numeric_limits<double>::quiet_NaN();
  }
  recording.Write(Bag());
  const ProgramResult result = Run("--set topics.imu=/imu");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("50 IMU samples of topic '/imu' are left out"));
  EXPECT_THAT(Trajectory(), Not(HasSubstr("nan")));
  EXPECT_LT(Report()["evaluation"]["ate_rmse_m"], 0.005);
}

TEST_F(DevoOffline, GoesOnWhereGroundTruthIsNoPose) {
  TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  recording.truth[40].pose.position.x = std::numeric_limits<double>::quiet_NaN();
  recording.truth[41].pose.orientation.w = 0;
  recording.Write(Bag());
  const ProgramResult result = Run();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("2 poses of topic '/truth' are left out"));
  EXPECT_EQ(Trajectory(), expected);
  EXPECT_FALSE(Report()["evaluation"].is_null());
}

TEST_F(DevoOffline, PutsDepthThatWasRecordedOutOfOrderBackIntoOrder) {
  TinyRecording recording;
  recording.Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  // Swapping the images, not their places: each is recorded in the other's place.
  rosbag::Bag bag(Bag(), rosbag::bagmode::Write);
  for (const auto& m : recording.transforms) bag.write("/tf_static", ToRosTime(recording.scene.begin_ns), m);
  for (const auto& m : recording.event_info) bag.write("/event_info", ToRosTime(recording.scene.begin_ns), m);
  for (const auto& m : recording.depth_info) bag.write("/depth_info", ToRosTime(recording.scene.begin_ns), m);
  for (const auto& m : recording.events) bag.write("/events", m.header.stamp, m);
  for (std::size_t i = 0; i < recording.depth.size(); ++i) {
    bag.write("/depth", recording.depth[i].header.stamp, recording.depth[i ^ 1U]);
  }
  bag.close();
  ASSERT_EQ(Run().status, 0);
  EXPECT_EQ(Trajectory(), expected);
}

TEST_F(DevoOffline, UsesWhatIsReadableOfATruncatedBag) {
  TinyRecording recording;
  for (const auto compression :
       {rosbag::compression::LZ4, rosbag::compression::BZ2, rosbag::compression::Uncompressed}) {
    recording.Write(Bag(), compression);
    ASSERT_EQ(truncate(Bag().c_str(), static_cast<off_t>(FileSize(Bag()) * 7 / 10)), 0);
    ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("ends early")));
    EXPECT_GT(ReadTum(folder_ + "/out/trajectory.txt").size(), 30U);
    EXPECT_THAT(Report()["error"].get<std::string>(), HasSubstr("ends early"));
  }
}

TEST_F(DevoOffline, UsesABagWhoseRecorderWasKilled) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::string expected = Trajectory();
  // Such a bag ends after its last chunk, and its header says that there is no index.
  std::string bytes = Contents(Bag());
  const std::size_t field = bytes.find("index_pos=") + 10;
  std::uint64_t index = 0;
  for (int i = 7; i >= 0; --i)
    index = index << 8 | static_cast<std::uint8_t>(bytes[field + static_cast<std::size_t>(i)]);
  ASSERT_LT(index, bytes.size());
  bytes.replace(field, 8, 8, '\0');
  std::ofstream(Bag(), std::ios::binary) << bytes.substr(0, index);
  ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("was not closed by its recorder")));
  EXPECT_EQ(Trajectory(), expected);
}

TEST_F(DevoOffline, UsesWhatIsReadableWhenAChunkIsDamaged) {
  TinyRecording().Write(Bag(), rosbag::compression::BZ2);
  std::fstream file(Bag(), std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(FileSize(Bag()) * 6 / 10));
  file << std::string(512, '\x55');
  file.close();
  ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("damaged")));
  EXPECT_GT(ReadTum(folder_ + "/out/trajectory.txt").size(), 30U);
}

TEST_F(DevoOffline, UsesWhatFollowsOnAChunkWhoseHeaderIsDamaged) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(Run().status, 0);
  const std::size_t whole = ReadTum(folder_ + "/out/trajectory.txt").size();
  std::string bytes = Contents(Bag());
  const std::size_t chunk = bytes.find("op=\x05", bytes.size() / 5);
  ASSERT_NE(chunk, std::string::npos);
  bytes.replace(chunk - 4, 4, "\xff\xff\xff\x7f");
  std::ofstream(Bag(), std::ios::binary) << bytes;
  ExpectRefused(Run(), AllOf(HasSubstr(Bag()), HasSubstr("is damaged at byte")));
  EXPECT_GT(ReadTum(folder_ + "/out/trajectory.txt").size(), whole * 8 / 10);
}

TEST_F(DevoOffline, KeepsWhatWasComputedUntilItIsInterrupted) {
  TinyScene slow;
  slow.duration_s = 8;
  TinyRecording(slow).Write(Bag());
  const std::string program = std::string(DEVO_BIN_DIR) + "/devo_offline --config " + folder_ + "/rig.yaml --bag " +
                              Bag() + " --out " + folder_ + "/out --threads 1";
  const std::string error = folder_ + "/error";
  const int status = std::system(("bash -c '" + program + " > /dev/null 2> " + error + " & while ! grep -q 25 " +
                                  error + "; do sleep 0.02; done; kill -TERM $!; wait $!'")
                                     .c_str());
  EXPECT_EQ(WEXITSTATUS(status), 2);
  EXPECT_THAT(Contents(error), HasSubstr("interrupted after"));
  EXPECT_GT(ReadTum(folder_ + "/out/trajectory.txt").size(), 100U);
  EXPECT_THAT(Report()["error"].get<std::string>(), HasSubstr("interrupted after"));
}

TEST_F(DevoOffline, WritesAndSaysTheRestWhereOneFileCannotBeWritten) {
  TinyRecording().Write(Bag());
  ASSERT_EQ(std::system(("mkdir -p " + folder_ + "/out/trajectory.txt").c_str()), 0);
  const ProgramResult result = Run();
  ExpectRefused(result, HasSubstr("trajectory.txt"));
  EXPECT_THAT(result.out, HasSubstr("ATE"));
  EXPECT_GT(Report()["map_points"], 100);
  EXPECT_THAT(Contents(folder_ + "/out/map.pcd"), HasSubstr("DATA binary"));
}

TEST_F(DevoOffline, SaysThatABagIsEmpty) {
  { rosbag::Bag bag(Bag(), rosbag::bagmode::Write); }
  ExpectRefused(Run(), AllOf(HasSubstr("'/depth' (key 'topics.depth')"), HasSubstr("the bags hold no messages")));
  TinyRecording recording;
  for (EventArray& array : recording.events) array.events.clear();
  recording.Write(Bag());
  ExpectRefused(Run(), HasSubstr("'/events' (key 'topics.events') holds no events"));
  std::ofstream(Bag(), std::ios::trunc).flush();
  ExpectRefused(Run(), HasSubstr("expected a ROS bag"));
}

TEST_F(DevoOffline, NamesTheUnknownKeyAndTheValueOutOfRange) {
  TinyRecording().Write(Bag());
  ExpectRefused(Run("--set surface.rate=1"),
                AllOf(HasSubstr("unknown key 'surface.rate'"), HasSubstr("'surface.rate_hz'")));
  ExpectRefused(Run("--set surface.rate_hz=1e9"), AllOf(HasSubstr("'surface.rate_hz'"), HasSubstr("from 1 to 1000")));
  WriteConfig(std::string(kConfig) + "colour: blue\n");
  ExpectRefused(Run(), AllOf(HasSubstr("rig.yaml"), HasSubstr("'colour'")));
}

TEST(DevoEvaluate, PrintsFiguresAndWritesThemAsJson) {
  const std::string folder = ::testing::TempDir();
  ::devo::Trajectory truth;
  const TinyScene scene;
  for (int i = 0; i <= 200; ++i) truth.push_back({i * 10000000LL, scene.PoseAt(0.005 * i)});
  WriteTum(folder + "evaluate_truth.txt", truth);
  const std::string files = folder + "evaluate_truth.txt " + folder + "evaluate_truth.txt";
  const ProgramResult result = RunProgram("devo_evaluate", files + " --json -");
  ASSERT_EQ(result.status, 0) << result.err;
  const auto json = nlohmann::json::parse(result.out);
  EXPECT_EQ(json["pairs"], 201);
  EXPECT_NEAR(json["ate_rmse_m"], 0, 1e-6);
  EXPECT_NEAR(json["path_length_m"], std::hypot(scene.way_x_m, scene.way_y_m), 1e-4);
  EXPECT_THAT(RunProgram("devo_evaluate", files).out, HasSubstr("ATE RMSE"));
  const ProgramResult missing = RunProgram("devo_evaluate", folder + "evaluate_truth.txt no/such.txt");
  EXPECT_EQ(missing.status, 2);
  EXPECT_THAT(missing.err, HasSubstr("'no/such.txt'"));
  const ProgramResult is_folder = RunProgram("devo_evaluate", folder + " " + folder + "evaluate_truth.txt");
  EXPECT_EQ(is_folder.status, 2);
  EXPECT_THAT(is_folder.err, HasSubstr("'" + folder + "': cannot be read"));
  for (const char* option : {"--interval nan", "--interval -1", "--interval 0", "--max-gap nan", "--max-gap 0"}) {
    EXPECT_EQ(RunProgram("devo_evaluate", files + " " + option).status, 2) << option;
  }
}

}  // namespace
}  // namespace devo
