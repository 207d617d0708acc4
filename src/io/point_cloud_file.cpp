// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/point_cloud_file.h"

#include <cstring>
#include <fstream>
#include <stdexcept>

namespace devo {
namespace {

/// One point as both formats store it; floats and a 32-bit integer in the machine's order, which both headers expect to
/// be little-endian (PCL writes memory as it is, too).
struct StoredPoint {
  float x, y, z, normal_x, normal_y, normal_z, sigma_px;
  std::int32_t reference;
};
static_assert(sizeof(StoredPoint) == 32, "stored without padding");

std::string PcdHeader(std::size_t count) {
  const std::string n = std::to_string(count);
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
         "FIELDS x y z normal_x normal_y normal_z sigma_px reference\n"
         "SIZE 4 4 4 4 4 4 4 4\nTYPE F F F F F F F I\nCOUNT 1 1 1 1 1 1 1 1\n"
         "WIDTH " +
         n + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA binary\n";
}

std::string PlyHeader(std::size_t count) {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) +
         "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float "
         "nz\n"
         "property float sigma_px\nproperty int reference\nend_header\n";
}

bool EndsWith(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

}  // namespace

void WritePointCloud(const std::string& path, const std::vector<MapPoint>& points) {
  const bool pcd = EndsWith(path, ".pcd");
  if (!pcd && !EndsWith(path, ".ply"))
    throw std::runtime_error("'" + path + "': expected a name ending in .pcd or .ply");
  std::ofstream file(path, std::ios::binary);
  file << (pcd ? PcdHeader(points.size()) : PlyHeader(points.size()));
  for (const MapPoint& point : points) {
    const auto &p = point.p_ref, &n = point.normal_ref;
    const StoredPoint stored{p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), point.sigma_px, point.reference};
    file.write(reinterpret_cast<const char*>(&stored), sizeof(stored));
  }
  if (!file.flush()) throw std::runtime_error("'" + path + "': cannot be written");
}

}  // namespace devo
