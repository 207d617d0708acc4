// SPDX-License-Identifier: BSD-3-Clause
#include "devo/sim/rig_file.h"

#include <iomanip>
#include <sstream>

namespace devo::sim {
namespace {

void WriteCamera(const char* key, const Camera& c, std::ostream& out) {
  out << key << ":\n  width: " << c.width() << "\n  height: " << c.height() << "\n  fx: " << c.fx()
      << "\n  fy: " << c.fy() << "\n  cx: " << c.cx() << "\n  cy: " << c.cy()
      << "\n  distortion_model: " << DistortionName(c) << "\n  distortion_coefficients: [";
  for (std::size_t i = 0; i < c.coefficients().size(); ++i) out << (i > 0 ? ", " : "") << c.coefficients()[i];
  out << "]\n";
}

}  // namespace

const char* DistortionName(const Camera& camera) {
  switch (camera.distortion()) {
    case DistortionModel::kNone: return "none";
    case DistortionModel::kPlumbBob: return "plumb_bob";
    case DistortionModel::kRationalPolynomial: return "rational_polynomial";
    case DistortionModel::kEquidistant: return "equidistant";
  }
  return "none";
}

std::string RigYaml(const Rig& rig, double depth_time_offset_s, const std::string& comment) {
  std::ostringstream out;
  out << std::setprecision(12) << "# " << comment << "\ntopics:\n  events: " << PlainTopics::kEvents
      << "\n  event_camera_info: " << PlainTopics::kEventCameraInfo << "\n  depth: " << PlainTopics::kDepth
      << "\n  depth_camera_info: " << PlainTopics::kDepthCameraInfo << "\n  imu: " << PlainTopics::kImu
      << "\n  ground_truth: " << PlainTopics::kGroundTruth << '\n';
  if (rig.depth_from_lidar) out << "  points: " << PlainTopics::kPoints << '\n';
  WriteCamera("event_camera", rig.event_camera, out);
  if (rig.depth_registered) {
    out << "registered: true\n";
  } else {
    if (!rig.depth_from_lidar) WriteCamera("depth_camera", rig.depth_camera, out);
    const Eigen::Vector3d t = rig.T_event_depth.translation();
    const Eigen::Quaterniond q = rig.T_event_depth.rotation();
    out << "T_event_depth:\n  translation: [" << t.x() << ", " << t.y() << ", " << t.z() << "]\n  quaternion: ["
        << q.x() << ", " << q.y() << ", " << q.z() << ", " << q.w() << "]\n";
  }
  // The configuration's offset is added to the stamps: what makes them late is taken off again.
  out << "depth_time_offset_s: " << (depth_time_offset_s == 0 ? 0.0 : -depth_time_offset_s) << '\n';
  return out.str();
}

}  // namespace devo::sim
