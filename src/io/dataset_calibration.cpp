// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/dataset_calibration.h"

#include <fstream>

#include "devo/io/rig_config.h"
#include "yaml.h"

namespace devo {
namespace {

bool Exists(const std::string& path) { return std::ifstream(path).good(); }

Rigid3 TransformIn(const std::string& path, const std::string& camera, const std::string& name) {
  const YAML::Node root = LoadYamlFile(path);
  const YamlPlace place{path, camera + "." + name};
  if (!root.IsMap() || !root[camera] || !root[camera][name]) place.Fail("missing, expected a 4x4 transformation");
  return YamlTransform(root[camera][name], place);
}

/// Of the numbered files of a calibration that was repeated the first is the published one.
std::string FirstThere(const std::string& stem) {
  for (const char* end : {".yaml", "1.yaml"}) {
    if (Exists(stem + end)) return stem + end;
  }
  return "";
}

std::optional<Rigid3> ImuInVectorsCamera(const std::string& folder, const std::string& scale,
                                         const Rigid3& T_cam0_event) {
  const std::string file = FirstThere(folder + scale + "_camera_imu_extrinsic_results");
  if (file.empty()) return std::nullopt;
  return T_cam0_event.inverse() * TransformIn(file, "cam0", "T_cam_imu");
}

KalibrCamera ReadKalibrCamera(const YAML::Node& node, const YamlPlace& place) {
  const auto intrinsics = YamlNumbers(node["intrinsics"], place.Under("intrinsics"));
  const auto resolution = YamlNumbers(node["resolution"], place.Under("resolution"));
  if (intrinsics.size() != 4) place.Under("intrinsics").Fail("expected [fx, fy, cx, cy]");
  if (resolution.size() != 2) place.Under("resolution").Fail("expected [width, height]");
  const auto model = YamlScalar<std::string>(node["distortion_model"], place.Under("distortion_model"), "a name");
  KalibrCamera result;
  try {
    result.camera = Camera(static_cast<int>(resolution[0]), static_cast<int>(resolution[1]), intrinsics[0],
                           intrinsics[1], intrinsics[2], intrinsics[3], model,
                           YamlNumbers(node["distortion_coeffs"], place.Under("distortion_coeffs")));
  } catch (const std::invalid_argument& e) {
    place.Fail(e.what());
  }
  if (node["rostopic"]) result.rostopic = node["rostopic"].as<std::string>("");
  if (node["T_cn_cnm1"]) result.T_cn_cnm1 = YamlTransform(node["T_cn_cnm1"], place.Under("T_cn_cnm1"));
  if (node["T_cam_imu"]) result.T_cam_imu = YamlTransform(node["T_cam_imu"], place.Under("T_cam_imu"));
  return result;
}

}  // namespace

DatasetCalibration ReadVectorCalibration(const std::string& directory) {
  const std::string base = directory + "/";
  DatasetCalibration result;
  result.event_camera = ReadCameraFile(base + "left_event_camera_intrinsic_results.yaml");
  result.depth_camera = ReadCameraFile(base + "rgbd_depth_camera_factory_intrinsic_results.yaml");
  const std::string joint = base + "small_scale_joint_camera_extrinsic_results.yaml";
  const Rigid3 T_cam0_event = TransformIn(joint, "cam2", "T_cam0_cam2");
  const Rigid3 T_cam0_color = TransformIn(joint, "cam4", "T_cam0_cam4");
  const Rigid3 T_color_depth =
      TransformIn(base + "rgbd_camera_calibrated_extrinsic_results.yaml", "cam1", "T_cam0_cam1");
  result.T_event_depth = T_cam0_event.inverse() * T_cam0_color * T_color_depth;
  result.T_event_imu = ImuInVectorsCamera(base, "small_scale", T_cam0_event);
  // The LiDAR was recorded in the large-scale sequences, for which the cameras were mounted anew.
  const std::string large = base + "large_scale_joint_camera_extrinsic_results.yaml";
  const Rigid3 T_cam0_event_then = Exists(large) ? TransformIn(large, "cam2", "T_cam0_cam2") : T_cam0_event;
  result.T_event_imu_of_lidar_rig = ImuInVectorsCamera(base, "large_scale", T_cam0_event_then);
  if (!result.T_event_imu_of_lidar_rig) result.T_event_imu_of_lidar_rig = result.T_event_imu;
  const std::string lidar = base + "camera_lidar_extrinsic_results.yaml";
  if (Exists(lidar)) {
    // Its cam1 is the left regular camera, which the joint calibration calls cam0.
    result.T_event_lidar = T_cam0_event_then.inverse() * TransformIn(lidar, "cam1", "T_cam_lidar");
  }
  const std::string mocap = FirstThere(base + "camera_mocap_extrinsic_results");
  if (!mocap.empty()) result.T_body_event = TransformIn(mocap, "cam0", "T_body_cam") * T_cam0_event;
  return result;
}

KalibrChain ReadKalibrChain(const std::string& path) {
  const YAML::Node root = LoadYamlFile(path);
  const YamlPlace place{path, ""};
  if (!root.IsMap() || !root["cam0"]) place.Under("cam0").Fail("missing, expected a Kalibr camchain");
  KalibrChain chain;
  for (int i = 0;; ++i) {
    const std::string name = "cam" + std::to_string(i);
    if (!root[name]) break;
    chain.cameras.push_back(ReadKalibrCamera(root[name], place.Under(name)));
  }
  if (root["T_cam0_lidar"]) chain.T_cam0_lidar = YamlTransform(root["T_cam0_lidar"], place.Under("T_cam0_lidar"));
  return chain;
}

Rigid3 KalibrChain::Between(std::size_t a, std::size_t b) const {
  if (a < b) return Between(b, a).inverse();
  Rigid3 T_a_b;
  for (std::size_t n = a; n > b; --n) {
    const auto& link = cameras.at(n).T_cn_cnm1;
    if (!link) throw std::invalid_argument("camchain: key 'cam" + std::to_string(n) + ".T_cn_cnm1' is missing");
    T_a_b = T_a_b * *link;
  }
  return T_a_b;
}

DatasetCalibration ReadMvsecCalibration(const std::string& path) {
  const KalibrChain chain = ReadKalibrChain(path);
  DatasetCalibration result;
  result.event_camera = chain.cameras.front().camera;
  result.T_event_lidar = chain.T_cam0_lidar;
  result.T_event_imu = result.T_event_imu_of_lidar_rig = chain.cameras.front().T_cam_imu;
  return result;
}

}  // namespace devo
