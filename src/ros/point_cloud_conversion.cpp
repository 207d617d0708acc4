// SPDX-License-Identifier: BSD-3-Clause
//
// PointCloud2 as the drivers of LiDARs fill it, to a sweep.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <sensor_msgs/PointCloud2.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/message_conversion.h"

namespace devo {
namespace {

using sensor_msgs::PointCloud2;
using sensor_msgs::PointField;

std::string TypeName(std::uint8_t datatype) {
  static const char* const kNames[] = {"?",     "int8",   "uint8",   "int16",  "uint16",
                                       "int32", "uint32", "float32", "float64"};
  return datatype <= PointField::FLOAT64 ? kNames[datatype] : "type " + std::to_string(datatype);
}

std::size_t SizeOf(std::uint8_t datatype) {
  static const std::size_t kSizes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};
  return datatype <= PointField::FLOAT64 ? kSizes[datatype] : 0;
}

std::string NamesOfFields(const PointCloud2& cloud) {
  std::string names;
  for (const PointField& field : cloud.fields) {
    names += (names.empty() ? "" : ", ") + field.name + " (" + TypeName(field.datatype) + ")";
  }
  return names.empty() ? "none" : names;
}

template <typename T>
T Load(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

/// A field of every point, read as a number.
class Field {
 public:
  explicit Field(const PointField& field) : offset_(field.offset), type_(field.datatype) {}

  template <typename Number>
  Number Of(const std::uint8_t* point) const {
    const std::uint8_t* bytes = point + offset_;
    switch (type_) {
      case PointField::INT8: return static_cast<Number>(Load<std::int8_t>(bytes));
      case PointField::UINT8: return static_cast<Number>(Load<std::uint8_t>(bytes));
      case PointField::INT16: return static_cast<Number>(Load<std::int16_t>(bytes));
      case PointField::UINT16: return static_cast<Number>(Load<std::uint16_t>(bytes));
      case PointField::INT32: return static_cast<Number>(Load<std::int32_t>(bytes));
      case PointField::UINT32: return static_cast<Number>(Load<std::uint32_t>(bytes));
      case PointField::FLOAT32: return static_cast<Number>(Load<float>(bytes));
      default: return static_cast<Number>(Load<double>(bytes));
    }
  }

 private:
  std::uint32_t offset_;
  std::uint8_t type_;
};

/// Empty where no field has the name. Throws when its type is none of `types` or it lies outside the point.
std::optional<Field> Find(const PointCloud2& cloud, const std::string& name,
                          std::initializer_list<std::uint8_t> types) {
  for (const PointField& field : cloud.fields) {
    if (field.name != name) continue;
    std::string expected;
    bool right = false;
    for (const std::uint8_t type : types) {
      right |= type == field.datatype;
      expected += (expected.empty() ? "" : " or ") + TypeName(type);
    }
    if (!right) {
      throw std::runtime_error("point cloud: field '" + name + "' is " + TypeName(field.datatype) + ", expected " +
                               expected);
    }
    if (std::size_t{field.offset} + SizeOf(field.datatype) > cloud.point_step) {
      throw std::runtime_error("point cloud: field '" + name + "' ends at byte " +
                               std::to_string(field.offset + SizeOf(field.datatype)) +
                               ", expected at most point_step " + std::to_string(cloud.point_step));
    }
    return Field(field);
  }
  return std::nullopt;
}

Field Coordinate(const PointCloud2& cloud, const std::string& name) {
  const auto field = Find(cloud, name, {PointField::FLOAT32});
  if (!field) {
    throw std::runtime_error("point cloud: field '" + name +
                             "' (float32) is missing; its fields: " + NamesOfFields(cloud));
  }
  return *field;
}

/// When a point was measured, from the field that its driver gives.
class PointTime {
 public:
  PointTime(const PointCloud2& cloud, std::int64_t offset_ns)
      : offset_ns_(offset_ns), stamp_ns_(FromRosTime(cloud.header.stamp) + offset_ns) {
    if ((field_ = Find(cloud, "time", {PointField::FLOAT32, PointField::FLOAT64}))) {
      unit_ = Unit::kSeconds;
    } else if ((field_ = Find(cloud, "t", {PointField::UINT32}))) {
      unit_ = Unit::kNanoseconds;
    } else if ((field_ = Find(cloud, "timestamp", {PointField::FLOAT64}))) {
      unit_ = Unit::kAbsolute;
    }
  }

  bool known() const { return field_.has_value(); }
  std::int64_t stamp_ns() const { return stamp_ns_; }

  std::int64_t Of(const std::uint8_t* point) const {
    constexpr double kCertainlyNs = 1e12;  // as seconds, 30000 years
    if (!field_) return stamp_ns_;
    if (unit_ == Unit::kNanoseconds) return stamp_ns_ + field_->Of<std::int64_t>(point);
    const auto value = field_->Of<double>(point);
    if (!std::isfinite(value)) throw std::runtime_error("point cloud: a point's time is not a number");
    if (unit_ == Unit::kSeconds) return stamp_ns_ + NsFromSeconds(value);
    return offset_ns_ + (value > kCertainlyNs ? static_cast<std::int64_t>(value) : NsFromSeconds(value));
  }

 private:
  enum class Unit { kSeconds, kNanoseconds, kAbsolute } unit_ = Unit::kSeconds;
  std::optional<Field> field_;
  std::int64_t offset_ns_, stamp_ns_;
};

void CheckSize(const PointCloud2& cloud) {
  if (cloud.is_bigendian != 0) throw std::runtime_error("point cloud is big-endian, expected little-endian");
  const std::size_t row = std::size_t{cloud.width} * cloud.point_step;
  const std::size_t all = cloud.height == 0 ? 0 : std::size_t{cloud.row_step} * (cloud.height - 1) + row;
  if ((cloud.height > 1 && cloud.row_step < row) || cloud.data.size() < all) {
    throw std::runtime_error("point cloud of " + std::to_string(cloud.width) + "x" + std::to_string(cloud.height) +
                             " points has " + std::to_string(cloud.data.size()) + " bytes, expected " +
                             std::to_string(all));
  }
}

/// Spreads the points over a turn that ends now, by their azimuth.
void SpreadOverTurn(double turn_s, std::vector<LidarPoint>* points) {
  constexpr double kTurn = 2 * M_PI;
  if (points->empty()) return;
  const auto azimuth = [](const LidarPoint& p) { return std::atan2(p.p_lidar.y(), p.p_lidar.x()); };
  // Beams differ a little in azimuth and the last firings may overlap the first: steps are taken as the shorter way
  // round.
  std::vector<double> turned(points->size());
  double angle = 0, last = azimuth(points->front());
  for (std::size_t i = 0; i < points->size(); ++i) {
    const double now = azimuth((*points)[i]);
    angle += std::remainder(now - last, kTurn);
    last = now;
    turned[i] = angle;
  }
  const double whole = std::copysign(kTurn, angle), end = angle;
  for (std::size_t i = 0; i < points->size(); ++i) {
    (*points)[i].t_ns += NsFromSeconds(turn_s * (turned[i] - end) / whole);
  }
}

}  // namespace

LidarSweep ToLidarSweep(const PointCloud2& cloud, double turn_s, std::int64_t time_offset_ns) {
  CheckSize(cloud);
  const Field x = Coordinate(cloud, "x"), y = Coordinate(cloud, "y"), z = Coordinate(cloud, "z");
  const std::initializer_list<std::uint8_t> integers = {PointField::UINT8, PointField::UINT16, PointField::UINT32,
                                                        PointField::INT8,  PointField::INT16,  PointField::INT32};
  auto ring = Find(cloud, "ring", integers);
  if (!ring) ring = Find(cloud, "line", integers);
  const PointTime time(cloud, time_offset_ns);
  LidarSweep sweep;
  sweep.points.reserve(std::size_t{cloud.width} * cloud.height);
  for (std::uint32_t row = 0; row < cloud.height; ++row) {
    const std::uint8_t* point = cloud.data.data() + std::size_t{row} * cloud.row_step;
    for (std::uint32_t column = 0; column < cloud.width; ++column, point += cloud.point_step) {
      LidarPoint read;
      read.p_lidar = {x.Of<float>(point), y.Of<float>(point), z.Of<float>(point)};
      if (!read.p_lidar.allFinite() || read.p_lidar.isZero()) continue;
      read.ring = ring ? ring->Of<int>(point) : cloud.height > 1 ? static_cast<int>(row) : -1;
      read.t_ns = time.Of(point);
      sweep.points.push_back(read);
    }
  }
  if (!time.known() && turn_s > 0) SpreadOverTurn(turn_s, &sweep.points);
  sweep.end_ns = sweep.points.empty() ? time.stamp_ns() : sweep.points.front().t_ns;
  for (const LidarPoint& point : sweep.points) sweep.end_ns = std::max(sweep.end_ns, point.t_ns);
  return sweep;
}

}  // namespace devo
