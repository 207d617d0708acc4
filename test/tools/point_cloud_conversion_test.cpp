// SPDX-License-Identifier: BSD-3-Clause
//
// Clouds as the drivers of LiDARs lay them out.
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sensor_msgs/PointCloud2.h>

#include "devo/core/time.h"
#include "devo/ros/message_conversion.h"
#include "throws_message.h"

namespace devo {
namespace {

using sensor_msgs::PointCloud2;
using sensor_msgs::PointField;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::int64_t kStamp_ns = 1700000000'500000000;

/// Puts the points of a cloud together: fields in order, then their values.
class Cloud {
 public:
  Cloud() {
    message_.header.stamp.fromNSec(kStamp_ns);
    message_.height = 1;
    for (const char* name : {"x", "y", "z"}) Field(name, PointField::FLOAT32, 4);
  }
  Cloud& Field(const std::string& name, std::uint8_t type, std::uint32_t size) {
    PointField field;
    field.name = name;
    field.offset = message_.point_step;
    field.datatype = type;
    field.count = 1;
    message_.fields.push_back(field);
    message_.point_step += size;
    return *this;
  }
  template <typename... Values>
  Cloud& Point(Values... values) {
    (Append(values), ...);
    ++message_.width;
    message_.row_step = message_.width * message_.point_step;
    return *this;
  }
  const PointCloud2& message() const { return message_; }
  PointCloud2& message() { return message_; }

 private:
  template <typename Value>
  void Append(Value value) {
    const std::size_t at = message_.data.size();
    message_.data.resize(at + sizeof(Value));
    std::memcpy(&message_.data[at], &value, sizeof(Value));
  }
  PointCloud2 message_;
};

std::vector<std::int64_t> TimesAfterStamp(const LidarSweep& sweep) {
  std::vector<std::int64_t> times;
  for (const LidarPoint& point : sweep.points) times.push_back(point.t_ns - kStamp_ns);
  return times;
}

TEST(PointClouds, OfVelodyneHaveSecondsAfterTheStampOfEitherSign) {
  Cloud cloud;
  cloud.Field("intensity", PointField::FLOAT32, 4).Field("ring", PointField::UINT16, 2);
  cloud.Field("time", PointField::FLOAT32, 4);
  cloud.Point(1.0F, 2.0F, 3.0F, 9.0F, std::uint16_t{7}, -0.0625F).Point(4.0F, 5.0F, 6.0F, 9.0F, std::uint16_t{8}, 0.0F);
  const LidarSweep sweep = ToLidarSweep(cloud.message(), 0, 1000);
  ASSERT_EQ(sweep.points.size(), 2U);
  EXPECT_EQ(sweep.points[0].p_lidar, Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(sweep.points[1].ring, 8);
  EXPECT_EQ(TimesAfterStamp(sweep), (std::vector<std::int64_t>{-62500000 + 1000, 1000}));
  EXPECT_EQ(sweep.end_ns, kStamp_ns + 1000) << "the offset of the clocks is added to every time";
}

TEST(PointClouds, OfOusterHaveNanosecondsAfterTheStamp) {
  Cloud cloud;
  cloud.Field("t", PointField::UINT32, 4).Field("ring", PointField::UINT8, 1);
  cloud.Point(1.0F, 0.0F, 0.0F, 99999999U, std::uint8_t{127}).Point(0.0F, 0.0F, 0.0F, 5U, std::uint8_t{3});
  const LidarSweep sweep = ToLidarSweep(cloud.message());
  EXPECT_EQ(TimesAfterStamp(sweep), (std::vector<std::int64_t>{99999999})) << "no return, no point";
  EXPECT_EQ(sweep.points[0].ring, 127);
  EXPECT_EQ(sweep.end_ns, kStamp_ns + 99999999);
}

TEST(PointClouds, WithTimestampsHaveTheTimeItselfInSecondsOrNanoseconds) {
  Cloud seconds, nanoseconds;
  seconds.Field("timestamp", PointField::FLOAT64, 8).Point(1.0F, 0.0F, 0.0F, 1700000000.25);
  nanoseconds.Field("timestamp", PointField::FLOAT64, 8).Point(1.0F, 0.0F, 0.0F, 1700000000.25e9);
  for (const Cloud& cloud : {seconds, nanoseconds}) {
    const LidarSweep sweep = ToLidarSweep(cloud.message(), 0, 2000);
    EXPECT_NEAR(SecondsFromNs(sweep.points[0].t_ns - kStamp_ns), -0.25 + 2e-6, 3e-7) << "as exact as a double";
  }
}

TEST(PointClouds, WithoutTimesAreMeasuredAtTheStamp) {
  Cloud cloud;
  cloud.Point(1.0F, 0.0F, 0.0F).Point(0.0F, 1.0F, 0.0F);
  const LidarSweep sweep = ToLidarSweep(cloud.message());
  EXPECT_EQ(TimesAfterStamp(sweep), (std::vector<std::int64_t>{0, 0}));
  EXPECT_EQ(sweep.points[0].ring, -1);
}

TEST(PointClouds, WithoutTimesAreSpreadOverATurnThatEndsAtTheStampWhereItsDurationIsGiven) {
  for (const double direction : {-1.0, 1.0}) {
    Cloud cloud;
    // From behind, and the points of one quarter missing.
    for (int k = 0; k <= 360; k += 5) {
      if (k > 90 && k < 180) continue;
      const double azimuth = M_PI + direction * k * M_PI / 180;
      cloud.Point(static_cast<float>(3 * std::cos(azimuth)), static_cast<float>(3 * std::sin(azimuth)), 0.5F);
    }
    const LidarSweep sweep = ToLidarSweep(cloud.message(), 0.05);
    EXPECT_NEAR(static_cast<double>(sweep.points.front().t_ns - kStamp_ns), -50e6, 1e3) << direction;
    EXPECT_EQ(sweep.points.back().t_ns, kStamp_ns);
    for (const LidarPoint& point : sweep.points) {
      if (point.p_lidar.x() <= 2.999F) continue;
      EXPECT_NEAR(static_cast<double>(point.t_ns - kStamp_ns), -25e6, 1e3);
    }
  }
}

/// A point at this azimuth, of a beam that is `ring` degrees up.
void AddPoint(double azimuth_deg, int ring, Cloud* cloud) {
  const double azimuth = azimuth_deg * M_PI / 180;
  cloud->Point(static_cast<float>(5 * std::cos(azimuth)), static_cast<float>(5 * std::sin(azimuth)),
               static_cast<float>(5 * std::tan(ring * M_PI / 180)), static_cast<std::uint16_t>(ring));
}

TEST(PointClouds, WithoutTimesThatComeRowByRowAreSpreadOverTheOneTurnThatAllRowsShare) {
  for (const double direction : {-1.0, 1.0}) {
    Cloud cloud;
    for (int ring = 0; ring < 16; ++ring) {
      for (int column = 0; column < 1800; ++column) {
        const double azimuth = (170 + direction * (0.2 * column + 0.01 * (ring - 8))) * M_PI / 180;
        cloud.Point(static_cast<float>(5 * std::cos(azimuth)), static_cast<float>(5 * std::sin(azimuth)), 0.5F);
      }
    }
    cloud.message().height = 16;
    cloud.message().width = 1800;
    cloud.message().row_step = 1800 * cloud.message().point_step;
    const LidarSweep sweep = ToLidarSweep(cloud.message(), 0.1);
    ASSERT_EQ(sweep.points.size(), 16U * 1800U);
    EXPECT_EQ(sweep.end_ns, kStamp_ns);
    for (std::size_t i = 0; i < sweep.points.size(); ++i) {
      const double expected_ns = -0.1e9 * (1799 - static_cast<double>(i % 1800)) / 1800;
      ASSERT_NEAR(static_cast<double>(sweep.points[i].t_ns - kStamp_ns), expected_ns, 5e4) << direction << ", " << i;
    }
  }
}

TEST(PointClouds, WithoutTimesThatAreSortedByRingHaveTheSameTimeAtTheSameAzimuthWhateverTheirRingDoesNotSee) {
  // Pairs of begin and end of what each ring sees, degrees since the turn began.
  const std::vector<std::vector<int>> seen = {{210, 240},       {0, 359},  {0, 40, 270, 359},
                                              {0, 5, 325, 359}, {70, 359}, {330, 359}};
  for (const double direction : {-1.0, 1.0}) {
    Cloud cloud;
    cloud.Field("ring", PointField::UINT16, 2);
    std::vector<int> expected_deg;
    for (std::size_t ring = 0; ring < seen.size(); ++ring) {
      for (std::size_t k = 0; k < seen[ring].size(); k += 2) {
        for (int angle = seen[ring][k]; angle <= seen[ring][k + 1]; ++angle) {
          AddPoint(-100 + direction * angle, static_cast<int>(ring), &cloud);
          expected_deg.push_back(angle);
        }
      }
    }
    const LidarSweep sweep = ToLidarSweep(cloud.message(), 0.1);
    ASSERT_EQ(sweep.points.size(), expected_deg.size());
    for (std::size_t i = 0; i < sweep.points.size(); ++i) {
      ASSERT_NEAR(static_cast<double>(sweep.points[i].t_ns - kStamp_ns), 0.1e9 * (expected_deg[i] - 359) / 360, 1e3)
          << direction << ", ring " << sweep.points[i].ring << ", " << expected_deg[i] << " deg";
    }
  }
}

TEST(PointClouds, WithoutTimesThatComeFiringByFiringMayOverlapTheBeginOfTheirTurn) {
  for (const int rings : {16, 2}) {
    Cloud cloud;
    cloud.Field("ring", PointField::UINT16, 2);
    std::vector<int> expected_deg;
    for (int angle = 0; angle <= 370; ++angle) {
      // Two beams, of which the upper sees a post now and then: long runs of one ring.
      for (int ring = 0; ring < (rings > 2 || angle % 50 == 20 ? rings : 1); ++ring) {
        AddPoint(30 - angle, ring, &cloud);
        expected_deg.push_back(angle);
      }
    }
    const LidarSweep sweep = ToLidarSweep(cloud.message(), 0.1);
    ASSERT_EQ(sweep.points.size(), expected_deg.size());
    for (std::size_t i = 0; i < sweep.points.size(); ++i) {
      ASSERT_NEAR(static_cast<double>(sweep.points[i].t_ns - kStamp_ns), 0.1e9 * (expected_deg[i] - 370) / 360, 1e3)
          << rings << " rings, " << expected_deg[i] << " deg";
    }
  }
}

TEST(PointClouds, ThatAreOrganisedHaveTheirRowsAsRings) {
  Cloud cloud;
  for (int k = 0; k < 6; ++k) cloud.Point(1.0F + static_cast<float>(k), 0.0F, 0.0F);
  cloud.message().height = 2;
  cloud.message().width = 3;
  cloud.message().row_step = 3 * cloud.message().point_step;
  const LidarSweep sweep = ToLidarSweep(cloud.message());
  ASSERT_EQ(sweep.points.size(), 6U);
  EXPECT_EQ(sweep.points[2].ring, 0);
  EXPECT_EQ(sweep.points[3].ring, 1);
}

TEST(PointClouds, HaveNoPointsThatAreNotFinite) {
  Cloud cloud;
  cloud.Point(std::nanf(""), 0.0F, 0.0F).Point(std::numeric_limits<float>::infinity(), 1.0F, 0.0F);
  EXPECT_TRUE(ToLidarSweep(cloud.message()).points.empty());
  EXPECT_EQ(ToLidarSweep(cloud.message()).end_ns, kStamp_ns);
}

TEST(PointClouds, ThatCannotBeReadAreRefusedByTheNameOfTheField) {
  const auto refused = [](const PointCloud2& message, const auto& matcher) {
    EXPECT_THAT([&] { ToLidarSweep(message); }, ThrowsMessage<std::runtime_error>(matcher));
  };
  Cloud good;
  good.Point(1.0F, 0.0F, 0.0F);
  PointCloud2 cloud = good.message();
  cloud.fields[1].name = "range";
  refused(cloud, AllOf(HasSubstr("field 'y'"), HasSubstr("missing"), HasSubstr("range (float32)")));
  cloud = good.message();
  cloud.fields[2].datatype = PointField::FLOAT64;
  refused(cloud, AllOf(HasSubstr("field 'z' is float64"), HasSubstr("expected float32")));
  cloud = good.message();
  cloud.fields[2].name = "t";
  cloud.fields.push_back(good.message().fields[2]);
  refused(cloud, AllOf(HasSubstr("field 't' is float32"), HasSubstr("expected uint32")));
  cloud = good.message();
  cloud.fields[2].offset = 10;
  refused(cloud, AllOf(HasSubstr("field 'z'"), HasSubstr("point_step 12")));
  cloud = good.message();
  cloud.data.pop_back();
  refused(cloud, AllOf(HasSubstr("11 bytes"), HasSubstr("expected 12")));
  cloud = good.message();
  cloud.is_bigendian = 1;
  refused(cloud, HasSubstr("big-endian"));
}

}  // namespace
}  // namespace devo
