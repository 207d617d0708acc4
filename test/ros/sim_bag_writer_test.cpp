// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/sim_bag_writer.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <iterator>
#include <map>

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include "devo/EventArray.h"
#include "devo/io/dataset_calibration.h"
#include "devo/io/rig_config.h"
#include "devo/io/trajectory.h"

namespace devo {
namespace {

sim::SequenceOptions Short(const std::string& sensor) {
  sim::SequenceOptions o;
  o.sensor = sensor;
  o.duration_s = 0.12;
  o.rest_s = 0;
  o.lidar = true;
  return o;
}

/// A folder of this process: several runs of the tests may share the machine.
const std::string& Folder() {
  static const std::string folder = [] {
    std::string path = testing::TempDir() + "sim_bag_writer_test_" + std::to_string(getpid());
    mkdir(path.c_str(), 0777);
    return path;
  }();
  return folder;
}

/// Writes the sequence; `stem` below the test's folder.
std::string Write(BagDialect dialect, const std::string& name, sim::Sequence* sequence, std::size_t* events = nullptr) {
  std::string stem = Folder() + "/" + name;
  const auto writer = SimBagWriter::Create(dialect, stem, *sequence);
  sim::Chunk chunk;
  while (sequence->Next(&chunk)) {
    writer->Write(chunk);
    if (events != nullptr) *events += chunk.events.size();
  }
  writer->Close();
  return stem;
}

/// Type of each topic of a bag.
std::map<std::string, std::string> TypesIn(const std::string& path) {
  rosbag::Bag bag(path);
  rosbag::View view(bag);
  std::map<std::string, std::string> types;
  for (const auto* connection : view.getConnections()) types[connection->topic] = connection->datatype;
  return types;
}

std::size_t EventsIn(const std::string& path, const std::string& topic) {
  rosbag::Bag bag(path);
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  std::size_t events = 0;
  for (const auto& m : view) {
    EXPECT_EQ(m.getMD5Sum(), "5e8beee5a6c107e504c2e78903c224b8");
    // Instantiating as this package's type works because the md5 is the same.
    const auto message = m.instantiate<EventArray>();
    if (message) events += message->events.size();
  }
  return events;
}

TEST(SimBagWriter, WritesThePlainDialectWithAConfigurationThatTheOdometryReads) {
  sim::Sequence sequence(Short("davis240"));
  std::size_t events = 0;
  const std::string stem = Write(BagDialect::kPlain, "plain", &sequence, &events);
  const auto types = TypesIn(stem + ".bag");
  EXPECT_EQ(types.at("/depth/image_raw"), "sensor_msgs/Image");
  EXPECT_EQ(types.at("/tf_static"), "tf2_msgs/TFMessage");
  EXPECT_EQ(types.at("/ground_truth/pose"), "geometry_msgs/PoseStamped");
  EXPECT_EQ(types.at("/velodyne_points"), "sensor_msgs/PointCloud2");
  EXPECT_EQ(types.count("/event_camera/camera_info"), 1U);
  EXPECT_GT(events, 500U);
  EXPECT_EQ(EventsIn(stem + ".bag", "/event_camera/events"), events);
  const RigConfig config = LoadRigConfig({stem + ".yaml"});
  EXPECT_EQ(config.topics.events, "/event_camera/events");
  ASSERT_TRUE(config.T_event_depth && config.event_camera && config.depth_camera);
  EXPECT_LT(Log(config.T_event_depth->inverse() * sequence.rig().T_event_depth).norm(), 1e-9);
  EXPECT_EQ(config.depth_camera->distortion(), DistortionModel::kRationalPolynomial);
  EXPECT_EQ(ReadTum(stem + "_groundtruth.txt").size(), 24U);
  const RigConfig lidar = LoadRigConfig({stem + "_lidar.yaml"});
  EXPECT_EQ(lidar.topics.points, "/velodyne_points");
  ASSERT_TRUE(lidar.T_event_depth && lidar.event_camera);
  EXPECT_LT(Log(lidar.T_event_depth->inverse() * sequence.lidar_model().T_event_lidar).norm(), 1e-9);
}

TEST(SimBagWriter, WritesMvsecsTopicsAndACamchainThatItsReaderReads) {
  sim::SequenceOptions options = Short("davis346_mvsec");
  options.depth = sim::SequenceOptions::Depth::kRegistered;
  options.T_event_imu = sim::ImuInDavis();
  sim::Sequence sequence(options);
  std::size_t events = 0;
  const std::string stem = Write(BagDialect::kMvsec, "flying1", &sequence, &events);
  const auto data = TypesIn(stem + "_data.bag"), gt = TypesIn(stem + "_gt.bag");
  EXPECT_EQ(data.at("/davis/left/events"), "dvs_msgs/EventArray");
  EXPECT_EQ(data.at("/velodyne_point_cloud"), "sensor_msgs/PointCloud2");
  EXPECT_EQ(gt.at("/davis/left/pose"), "geometry_msgs/PoseStamped");
  EXPECT_EQ(gt.count("/davis/left/depth_image_rect"), 1U);
  EXPECT_EQ(EventsIn(stem + "_data.bag", "/davis/left/events"), events);
  rosbag::Bag bag(stem + "_gt.bag");
  rosbag::View view(bag, rosbag::TopicQuery("/davis/left/depth_image_raw"));
  ASSERT_GT(view.size(), 0U);
  EXPECT_EQ(view.begin()->instantiate<sensor_msgs::Image>()->encoding, "32FC1");
  const auto read = ReadMvsecCalibration(Folder() + "/camchain-imucam-flying.yaml");
  EXPECT_EQ(read.event_camera.distortion(), DistortionModel::kEquidistant);
  EXPECT_NEAR(read.event_camera.fx(), sequence.rig().event_camera.fx(), 1e-9);
  ASSERT_TRUE(read.T_event_lidar && read.T_event_imu);
  EXPECT_LT(Log(read.T_event_lidar->inverse() * sequence.lidar_model().T_event_lidar).norm(), 1e-9);
  EXPECT_LT(Log(read.T_event_imu->inverse() * options.T_event_imu).norm(), 1e-9);
  // No times, as in MVSEC: the stamp is the end of the turn.
  rosbag::Bag data_bag(stem + "_data.bag");
  rosbag::View clouds(data_bag, rosbag::TopicQuery("/velodyne_point_cloud"));
  ASSERT_GT(clouds.size(), 0U);
  const auto cloud = clouds.begin()->instantiate<sensor_msgs::PointCloud2>();
  EXPECT_EQ(cloud->fields.back().name, "ring");
  EXPECT_NEAR((cloud->header.stamp - ros::Time(1000)).toSec(), 0.01 + 1 / sequence.lidar_model().rate_hz, 1e-6);
}

TEST(SimBagWriter, WritesMvsecsRightCameraOnRequestWithItsPlaceInTheCamchain) {
  sim::SequenceOptions options = Short("davis240");
  options.depth = sim::SequenceOptions::Depth::kRegistered;
  options.duration_s = 0.06;
  sim::Sequence left(options), right(RightCameraOf(options));
  const std::string stem = Folder() + "/stereo1";
  const auto writer = SimBagWriter::Create(BagDialect::kMvsec, stem, left, &right);
  sim::Chunk chunk;
  std::size_t events = 0;
  while (left.Next(&chunk)) {
    writer->Write(chunk);
    ASSERT_TRUE(right.Next(&chunk));
    writer->WriteRight(chunk);
    events += chunk.events.size();
  }
  writer->Close();
  const auto data = TypesIn(stem + "_data.bag"), gt = TypesIn(stem + "_gt.bag");
  for (const std::string side : {"/davis/left", "/davis/right"}) {
    EXPECT_EQ(data.at(side + "/events"), "dvs_msgs/EventArray");
    for (const char* topic : {"/image_raw", "/imu", "/camera_info"}) EXPECT_EQ(data.count(side + topic), 1U) << topic;
    for (const char* topic : {"/depth_image_raw", "/depth_image_rect", "/camera_info"})
      EXPECT_EQ(gt.count(side + topic), 1U) << topic;
  }
  EXPECT_GT(events, 200U);
  EXPECT_EQ(EventsIn(stem + "_data.bag", "/davis/right/events"), events);
  // The same motion, 10 cm to the right, in front of the same wall: the camchain says so, and so do the poses.
  const Rigid3 T_left_right = left.trajectory().PoseAt(0.05).inverse() * right.trajectory().PoseAt(0.05);
  EXPECT_LT(Log(T_left_right.inverse() * Rigid3::Translation({0.1, 0, 0})).norm(), 1e-9);
  std::ifstream file(Folder() + "/camchain-imucam-stereo.yaml");
  const std::string text(std::istreambuf_iterator<char>(file), {});
  EXPECT_NE(text.find("cam1:\n  T_cn_cnm1:\n  - [1, 0, 0, -0.1]"), std::string::npos) << text;
  EXPECT_NO_THROW(ReadMvsecCalibration(Folder() + "/camchain-imucam-stereo.yaml"));
  EXPECT_TRUE(std::ifstream(Folder() + "/stereo_right_x_map.txt").good());
}

TEST(SimBagWriter, WritesVectorsBagsAndCalibrationThatItsReaderReads) {
  sim::SequenceOptions options = Short("gen3_vector");
  options.regular_camera = true;
  options.pose_rate_hz = 120;
  options.T_event_imu = sim::VectorRegularCamera().T_event_camera * sim::ImuBesideVectorRegularCamera();
  sim::Sequence sequence(options);
  std::size_t events = 0;
  const std::string stem = Write(BagDialect::kVector, "desk", &sequence, &events);
  const auto types = TypesIn(stem + ".synced.left_event.bag");
  ASSERT_EQ(types.size(), 1U);
  EXPECT_EQ(types.at("/prophesee/left/events"), "prophesee_event_msgs/EventArray");
  EXPECT_EQ(EventsIn(stem + ".synced.left_event.bag", "/prophesee/left/events"), events);
  EXPECT_EQ(TypesIn(stem + ".synced.kinect_depth.bag").count("/kinect/depth_image"), 1U);
  EXPECT_EQ(TypesIn(stem + ".synced.gt.bag").at("/gt/pose"), "geometry_msgs/PoseStamped");
  const auto read = ReadVectorCalibration(Folder() + "/yaml");
  ASSERT_TRUE(read.T_event_depth && read.depth_camera && read.T_body_event);
  EXPECT_LT(Log(read.T_event_depth->inverse() * sequence.rig().T_event_depth).norm(), 1e-9);
  ASSERT_TRUE(read.T_event_lidar && read.T_event_imu);
  EXPECT_LT(Log(read.T_event_lidar->inverse() * sequence.lidar_model().T_event_lidar).norm(), 1e-9);
  EXPECT_LT(Log(read.T_event_imu->inverse() * options.T_event_imu).norm(), 1e-9);
  EXPECT_EQ(TypesIn(stem + ".synced.imu.bag").at("/imu/data"), "sensor_msgs/Imu");
  EXPECT_EQ(read.depth_camera->distortion(), DistortionModel::kRationalPolynomial);
  // Ground truth is the pose of the body: with the calibration it gives the event camera's.
  rosbag::Bag bag(stem + ".synced.gt.bag");
  rosbag::View view(bag);
  const auto pose = view.begin()->instantiate<geometry_msgs::PoseStamped>();
  const Rigid3 T_world_body(Eigen::Quaterniond(pose->pose.orientation.w, pose->pose.orientation.x,
                                               pose->pose.orientation.y, pose->pose.orientation.z),
                            {pose->pose.position.x, pose->pose.position.y, pose->pose.position.z});
  const Rigid3 T_world_event = sequence.trajectory().PoseAt(1.0 / 120);
  EXPECT_EQ(view.size(), 14U) << "120 Hz for 0.12 s";
  EXPECT_LT(Log((T_world_body * *read.T_body_event).inverse() * T_world_event).norm(), 1e-6);
}

TEST(SimBagWriter, WritesFramesOfVectorsRegularCameraFromWhereItsCalibrationSaysThatItIs) {
  sim::SequenceOptions options = Short("davis240");
  options.regular_camera = true;
  options.duration_s = 0.05;
  options.depth = sim::SequenceOptions::Depth::kKinectExact;
  options.lidar = false;
  options.ideal_pixels = true;
  sim::Sequence sequence(options);
  const std::string stem = Write(BagDialect::kVector, "regular", &sequence);
  rosbag::Bag bag(stem + ".synced.left_camera.bag");
  rosbag::View view(bag, rosbag::TopicQuery("/camera/left/image_mono"));
  ASSERT_EQ(view.size(), 2U);
  const auto image = view.begin()->instantiate<sensor_msgs::Image>();
  EXPECT_EQ(image->width, 1224U);
  EXPECT_EQ(image->height, 1024U);
  EXPECT_EQ(image->encoding, "mono8");
  std::ifstream file(Folder() + "/yaml/small_scale_joint_camera_extrinsic_results.yaml");
  const std::string text(std::istreambuf_iterator<char>(file), {});
  // 4 cm above the event camera, as published.
  EXPECT_NE(text.find("-0.0408197"), std::string::npos) << text;
  double sum = 0;
  for (const std::uint8_t v : image->data) sum += v;
  EXPECT_GT(sum / static_cast<double>(image->data.size()), 30) << "an exposed image is not black";
}

TEST(SimBagWriter, WritesTheSameBytesForTheSameSeedInEveryDialect) {
  const auto bytes = [](const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  for (const BagDialect dialect : {BagDialect::kPlain, BagDialect::kMvsec, BagDialect::kVector}) {
    sim::SequenceOptions options = Short("davis240");
    options.duration_s = 0.05;
    options.regular_camera = dialect == BagDialect::kVector;
    if (dialect == BagDialect::kMvsec) options.depth = sim::SequenceOptions::Depth::kRegistered;
    std::vector<std::vector<std::string>> files(2);
    for (int run = 0; run < 2; ++run) {
      options.threads = 1 + run;
      sim::Sequence sequence(options);
      const std::string stem = Folder() + "/same" + std::to_string(run) + "_seed";
      const auto writer = SimBagWriter::Create(dialect, stem, sequence);
      for (sim::Chunk chunk; sequence.Next(&chunk);) writer->Write(chunk);
      writer->Close();
      files[run] = writer->files();
    }
    ASSERT_EQ(files[0].size(), files[1].size());
    for (std::size_t i = 0; i < files[0].size(); ++i) {
      EXPECT_FALSE(bytes(files[0][i]).empty()) << files[0][i];
      EXPECT_EQ(bytes(files[0][i]) == bytes(files[1][i]), true) << files[0][i];
    }
  }
}

TEST(SimBagWriter, GivesBagsOfEveryDialectTheirNamesOnceTheyAreComplete) {
  const auto exists = [](const std::string& path) { return std::ifstream(path).good(); };
  for (const BagDialect dialect : {BagDialect::kPlain, BagDialect::kMvsec, BagDialect::kVector}) {
    sim::SequenceOptions options = Short("davis240");
    options.duration_s = 0.03;
    options.frames = options.lidar = false;
    if (dialect == BagDialect::kMvsec) options.depth = sim::SequenceOptions::Depth::kRegistered;
    sim::Sequence sequence(options);
    const std::string stem = Folder() + "/complete" + std::to_string(static_cast<int>(dialect)) + "_bag";
    for (const char* end : {".bag", "_data.bag", ".synced.gt.bag"}) std::ofstream(stem + end) << "of a run before";
    const auto writer = SimBagWriter::Create(dialect, stem, sequence);
    for (sim::Chunk chunk; sequence.Next(&chunk);) writer->Write(chunk);
    std::vector<std::string> bags;
    for (const std::string& file : writer->files()) {
      if (file.size() > 4 && file.compare(file.size() - 4, 4, ".bag") == 0) bags.push_back(file);
    }
    ASSERT_FALSE(bags.empty());
    for (const std::string& bag : bags) {
      EXPECT_FALSE(exists(bag)) << bag;
      EXPECT_TRUE(exists(bag + ".active")) << bag;
    }
    writer->Close();
    for (const std::string& bag : bags) {
      EXPECT_FALSE(exists(bag + ".active")) << bag;
      EXPECT_FALSE(TypesIn(bag).empty()) << bag;
    }
  }
}

TEST(SimBagWriter, NamesTheBagForWhichTheDiskHasNoRoom) {
  sim::Sequence sequence(Short("davis240"));
  const std::string stem = Folder() + "/full";
  ASSERT_EQ(symlink("/dev/full", (stem + ".bag.active").c_str()), 0);
  try {
    const auto writer = SimBagWriter::Create(BagDialect::kPlain, stem, sequence);
    for (sim::Chunk chunk; sequence.Next(&chunk);) writer->Write(chunk);
    writer->Close();
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("bag '" + stem + ".bag.active' cannot be written"), std::string::npos)
        << e.what();
  }
}

TEST(SimBagWriter, NamesTheFileThatItCannotWriteAndTheDialectThatItDoesNotKnow) {
  sim::Sequence sequence(Short("davis240"));
  try {
    SimBagWriter::Create(BagDialect::kPlain, "/nowhere/at/all", sequence);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("/nowhere/at/all"), std::string::npos);
  }
  EXPECT_THROW(BagDialectOf("kitti"), std::invalid_argument);
}

TEST(ToDepthMsg, RoundsToMillimetresAndMarksInvalidAsEachEncodingDoes) {
  DepthImage depth{1000, cv::Mat1f(1, 3, 0.0F)};
  depth.depth_m(0, 1) = 1.2346F;
  depth.depth_m(0, 2) = 0.0004F;
  const auto mm = ToDepthMsg(depth, "16UC1", "d");
  std::uint16_t v[3];
  std::memcpy(v, mm.data.data(), sizeof v);
  EXPECT_EQ(v[0], 0);
  EXPECT_EQ(v[1], 1235);
  EXPECT_EQ(v[2], 0);
  const auto m = ToDepthMsg(depth, "32FC1", "d");
  float f[3];
  std::memcpy(f, m.data.data(), sizeof f);
  EXPECT_TRUE(std::isnan(f[0]));
  EXPECT_FLOAT_EQ(f[1], 1.2346F);
}

}  // namespace
}  // namespace devo
