// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/point_cloud_file.h"

#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::HasSubstr;

std::string Contents(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(PointCloudFile, EndsInOneRecordPerPoint) {
  std::vector<MapPoint> points(3);
  points[1].p_ref = {1, 2, 3};
  for (const char* name : {"cloud_test.pcd", "cloud_test.ply"}) {
    const std::string path = ::testing::TempDir() + name;
    WritePointCloud(path, points);
    const std::string text = Contents(path);
    std::remove(path.c_str());
    const std::string end_of_header = name[11] == 'p' && name[12] == 'c' ? "DATA binary\n" : "end_header\n";
    const std::size_t begin = text.find(end_of_header) + end_of_header.size();
    ASSERT_EQ(text.size() - begin, 3 * 32U) << name;
    float xyz[3];
    std::memcpy(xyz, text.data() + begin + 32, sizeof(xyz));
    EXPECT_EQ(xyz[0], 1) << name;
    EXPECT_EQ(xyz[2], 3) << name;
    EXPECT_THAT(text.substr(0, begin), HasSubstr(" 3\n")) << name;
  }
}

TEST(PointCloudFile, NamesTheFileThatCannotBeWritten) {
  EXPECT_THAT([] { WritePointCloud("no/such/folder/map.pcd", {}); },
              ThrowsMessage<std::runtime_error>(HasSubstr("no/such/folder/map.pcd")));
  EXPECT_THAT([] { WritePointCloud("map.obj", {}); }, ThrowsMessage<std::runtime_error>(HasSubstr(".pcd or .ply")));
}

}  // namespace
}  // namespace devo
