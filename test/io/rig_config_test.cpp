// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/rig_config.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/shared_data.h"
#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

RigConfig FromYaml(const std::string& text) {
  RigConfig config;
  ApplyYaml(text, "rig.yaml", "", &config);
  return config;
}

auto FailsWith(const std::string& part) { return ThrowsMessage<std::invalid_argument>(HasSubstr(part)); }

TEST(RigConfig, ReadsNestedGroupsAndDottedOverrides) {
  RigConfig config = FromYaml("topics: {events: /a, depth: /b}\nsurface: {rate_hz: 50}\nregistered: true");
  EXPECT_EQ(config.topics.events, "/a");
  EXPECT_EQ(config.topics.depth, "/b");
  EXPECT_EQ(config.odometry.surface.rate_hz, 50);
  EXPECT_TRUE(config.registered);
  config = LoadRigConfig({}, {"surface.rate_hz=200", "topics.events=/c", "depth_time_offset_s=-0.01"});
  EXPECT_EQ(config.odometry.surface.rate_hz, 200);
  EXPECT_EQ(config.topics.events, "/c");
  EXPECT_EQ(config.depth_time_offset_s, -0.01);
}

TEST(RigConfig, NamesFileUnknownKeyAndTheNearestKnownOne) {
  EXPECT_THAT([] { FromYaml("surface: {rate_hzz: 50}"); },
              FailsWith("rig.yaml: unknown key 'surface.rate_hzz'; nearest known key: 'surface.rate_hz'"));
  EXPECT_THAT([] { FromYaml("topic: {events: /a}"); },
              FailsWith("unknown key 'topic.events'; nearest known key: 'topics.events'"));
  EXPECT_THAT([] { LoadRigConfig({}, {"nonsense=1"}); }, FailsWith("--set nonsense=1: unknown key 'nonsense'"));
}

TEST(RigConfig, NamesKeyAndRangeOfAValueOutOfRange) {
  EXPECT_THAT([] { FromYaml("surface: {rate_hz: 0}"); },
              FailsWith("key 'surface.rate_hz': is 0, expected a number from 1 to 1000"));
  EXPECT_THAT([] { FromYaml("surface: {rate_hz: .nan}"); }, FailsWith("key 'surface.rate_hz': is nan"));
  EXPECT_THAT([] { FromYaml("depth_scale: 100"); },
              FailsWith("key 'depth_scale': is 100, expected a number from 0.1 to 10"));
  EXPECT_THAT([] { FromYaml("surface: {method: magic}"); },
              FailsWith("key 'surface.method': is 'magic', expected 'motion_compensated' or 'exponential'"));
}

TEST(RigConfig, NamesKeyOfAValueOfAnotherKind) {
  EXPECT_THAT([] { FromYaml("surface: {rate_hz: fast}"); },
              FailsWith("key 'surface.rate_hz': expected a number, got 'fast'"));
  EXPECT_THAT([] { FromYaml("surface: {rate_hz: [1, 2]}"); }, FailsWith("key 'surface.rate_hz': expected a number"));
  EXPECT_THAT([] { FromYaml("registered: perhaps"); },
              FailsWith("key 'registered': expected true or false, got 'perhaps'"));
  EXPECT_THAT([] { FromYaml("mapping: {max_points: 100.5}"); },
              FailsWith("key 'mapping.max_points': expected a whole number"));
  EXPECT_THAT([] { FromYaml("surface: {rate_hz: }"); }, FailsWith("key 'surface.rate_hz': missing"));
  EXPECT_THAT([] { FromYaml("{a: b"); }, FailsWith("rig.yaml: not valid yaml"));
  EXPECT_THAT([] { FromYaml("just a text"); }, FailsWith("rig.yaml: expected a map"));
  EXPECT_THAT([] { LoadRigConfig({}, {"no equals sign"}); }, FailsWith("expected key=value"));
  EXPECT_THAT([] { LoadRigConfig({"no/such.yaml"}); }, FailsWith("'no/such.yaml': cannot be read"));
}

TEST(RigConfig, AcceptsEveryDefaultThatItDescribes) {
  std::istringstream lines(Describe(RigConfig()));
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const std::size_t colon = line.find(": ");
    ASSERT_NE(colon, std::string::npos) << line;
    EXPECT_NO_THROW(LoadRigConfig({}, {line.substr(0, colon) + "=" + line.substr(colon + 2)})) << line;
  }
  EXPECT_GT(count, 20);
}

TEST(RigConfig, LaterFilesOverrideEarlierOnesKeyByKey) {
  const std::string base = ::testing::TempDir() + "rig_base.yaml", overlay = ::testing::TempDir() + "rig_overlay.yaml";
  std::ofstream(base) << "topics: {events: /base, depth: /base_depth}\nsurface: {rate_hz: 50}\n";
  std::ofstream(overlay) << "topics: {events: /overlay}\nevent_camera: {}\n";
  const RigConfig config = LoadRigConfig({base, overlay}, {"surface.rate_hz=25"});
  EXPECT_EQ(config.topics.events, "/overlay");
  EXPECT_EQ(config.topics.depth, "/base_depth");
  EXPECT_EQ(config.odometry.surface.rate_hz, 25);
  EXPECT_FALSE(config.event_camera);
  std::remove(base.c_str());
  std::remove(overlay.c_str());
}

TEST(RigConfig, ReadsCamerasInBothLayouts) {
  const RigConfig config = FromYaml(
      "event_camera: {width: 240, height: 180, fx: 200, fy: 201, cx: 119, cy: 89, distortion_model: plumb_bob,"
      " distortion_coefficients: [0.1, 0.2, 0, 0]}\n"
      "depth_camera: {image_width: 640, image_height: 576, camera_name: k, camera_model: plumb_bob,"
      " camera_matrix: {rows: 3, cols: 3, data: [504, 0, 321, 0, 505, 336, 0, 0, 1]},"
      " distortion_coefficients: {rows: 1, cols: 8, data: [1, 2, 3, 4, 5, 6, 7, 8]}}");
  ASSERT_TRUE(config.event_camera && config.depth_camera);
  EXPECT_EQ(config.event_camera->fy(), 201);
  EXPECT_EQ(config.event_camera->distortion(), DistortionModel::kPlumbBob);
  EXPECT_EQ(config.depth_camera->height(), 576);
  EXPECT_EQ(config.depth_camera->cx(), 321);
  EXPECT_EQ(config.depth_camera->distortion(), DistortionModel::kRationalPolynomial)
      << "8 coefficients, whatever the label";
}

TEST(RigConfig, ReadsACameraFromAFileBesideTheYaml) {
  const std::string folder = ::testing::TempDir();
  std::ofstream(folder + "camera_of_rig.yaml") << "{width: 10, height: 8, fx: 5, fy: 5, cx: 4, cy: 4}";
  std::ofstream(folder + "rig_with_file.yaml") << "event_camera: {file: camera_of_rig.yaml}";
  const RigConfig config = LoadRigConfig({folder + "rig_with_file.yaml"});
  ASSERT_TRUE(config.event_camera);
  EXPECT_EQ(config.event_camera->width(), 10);
  EXPECT_THAT([] { FromYaml("event_camera: {file: no_such_camera.yaml}"); },
              FailsWith("'no_such_camera.yaml': cannot be read"));
}

TEST(RigConfig, NamesWhatIsWrongWithACamera) {
  EXPECT_THAT([] { FromYaml("event_camera: {width: 10, height: 8, fx: 0, fy: 5, cx: 4, cy: 4}"); },
              ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("event_camera"), HasSubstr("fx = 0"))));
  EXPECT_THAT([] { FromYaml("event_camera: {width: 10, height: 8, fx: 5, fy: 5, cx: 4}"); },
              FailsWith("key 'event_camera.cy': missing, expected a number"));
  EXPECT_THAT([] { FromYaml("event_camera: {width: 10, hight: 8, fx: 5, fy: 5, cx: 4, cy: 3}"); },
              FailsWith("key 'event_camera.hight': unknown key"));
  EXPECT_THAT(
      [] { FromYaml("event_camera: {width: 10, height: 8, fx: 5, fy: 5, cx: 4, cy: 4, distortion_model: ftheta}"); },
      FailsWith("distortion model 'ftheta'"));
}

TEST(RigConfig, ReadsTransformationsInAllLayouts) {
  const Rigid3 T(ExpSO3({0, 0, M_PI / 2}), {1, 2, 3});
  for (const char* text : {"[0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]",
                           "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]",
                           "{rows: 4, cols: 4, data: [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]}",
                           "{translation: [1, 2, 3], quaternion: [0, 0, 0.70710678, 0.70710678]}"}) {
    const RigConfig config = FromYaml(std::string("T_event_depth: ") + text);
    ASSERT_TRUE(config.T_event_depth) << text;
    EXPECT_LT((config.T_event_depth->matrix() - T.matrix()).norm(), 1e-7) << text;
  }
}

TEST(RigConfig, TellsTheTransformationsApartByTheirKeys) {
  const char* const kText = R"(T_event_depth: {translation: [1, 0, 0], quaternion: [0, 0, 0, 1]}
T_event_imu: {translation: [0, 2, 0], quaternion: [0, 0, 0, 1]}
T_body_event: {translation: [0, 0, 3], quaternion: [0, 0, 0, 1]})";
  const RigConfig config = FromYaml(kText);
  ASSERT_TRUE(config.T_event_depth && config.T_event_imu && config.T_body_event);
  EXPECT_EQ(config.T_event_depth->translation(), Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(config.T_event_imu->translation(), Eigen::Vector3d(0, 2, 0));
  EXPECT_EQ(config.T_body_event->translation(), Eigen::Vector3d(0, 0, 3));
}

TEST(RigConfig, RefusesTransformationsThatAreNone) {
  EXPECT_THAT([] { FromYaml("T_event_depth: [1, 2, 3]"); }, FailsWith("key 'T_event_depth': expected a 4x4 matrix"));
  EXPECT_THAT([] { FromYaml("T_event_depth: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]"); },
              FailsWith("key 'T_event_depth'"));
  EXPECT_THAT([] { FromYaml("T_event_depth: {translation: [0, 0, 0], quaternion: [0, 0, 0, 0]}"); },
              FailsWith("key 'T_event_depth.quaternion': expected a unit quaternion"));
}

TEST(Configurations, OfThePackageAllLoad) {
  const std::string folder = std::string(DEVO_SOURCE_DIR) + "/config/";
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {  // config/sim holds scenes
    if (entry.path().extension() != ".yaml") continue;
    std::vector<std::string> files{entry.path().string()};
    if (entry.path().stem() == "method_paper") files.insert(files.begin(), folder + "esim.yaml");
    // A data set's calibration comes with its bags.
    EXPECT_NO_THROW(LoadRigConfig(files, {"calibration.format="})) << entry.path();
    ++count;
  }
  EXPECT_GE(count, 8);
  const RigConfig paper = LoadRigConfig({folder + "esim.yaml", folder + "method_paper.yaml"});
  EXPECT_EQ(paper.odometry.surface.method, "exponential");
  EXPECT_EQ(paper.topics.events, "/event_camera/events");
  EXPECT_TRUE(paper.registered);
}

TEST(Configurations, OfTheDavisAndKinectHoldTheCalibrationPublishedWithTheRecording) {
  const std::string path = SharedData("real_davis_kinect/seq1/calibration.yaml");
  if (path.empty()) GTEST_SKIP() << MissingSharedData("real_davis_kinect/seq1/calibration.yaml");
  const RigConfig ours = LoadRigConfig({std::string(DEVO_SOURCE_DIR) + "/config/davis_kinect.yaml"});
  std::ifstream file(path);
  std::string text, line;
  // The recording's file says more than a rig needs: its cameras and its transformation are taken.
  for (bool wanted = false; std::getline(file, line);) {
    if (line.find_first_of(" \t") != 0)
      wanted = line.find("_camera:") != std::string::npos || line.rfind("T_event_depth:", 0) == 0;
    if (wanted) text += line + "\n";
  }
  const RigConfig theirs = FromYaml(text);
  ASSERT_TRUE(ours.T_event_depth && theirs.T_event_depth);
  EXPECT_LT((ours.T_event_depth->matrix() - theirs.T_event_depth->matrix()).norm(), 1e-9);
  EXPECT_EQ(ours.event_camera->fx(), theirs.event_camera->fx());
  EXPECT_EQ(ours.event_camera->coefficients(), theirs.event_camera->coefficients());
  EXPECT_EQ(ours.depth_camera->cy(), theirs.depth_camera->cy());
}

TEST(Parameters, AreDocumentedAsTheyAre) {
  std::ifstream file(std::string(DEVO_SOURCE_DIR) + "/docs/parameters.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_EQ(text.str(), ParametersMarkdown()) << "regenerate: devo_offline --print-parameters > docs/parameters.md";
}

}  // namespace
}  // namespace devo
