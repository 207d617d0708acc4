// SPDX-License-Identifier: BSD-3-Clause
//
// PointCloud2 as the drivers of LiDARs fill it, to a sweep.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <set>
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

constexpr double kTurn = 2 * M_PI;

/// Where each ring begins, and the end, where the points come ring by ring; else the cloud is one piece.
std::vector<std::size_t> BoundsOfRings(const std::vector<LidarPoint>& points) {
  std::vector<std::size_t> bounds = {0};
  std::set<int> rings = {points.front().ring};
  bool returns = false;
  for (std::size_t i = 1; i < points.size() && !returns; ++i) {
    if (points[i].ring == points[i - 1].ring) continue;
    // Beams that see little leave long runs of one ring among firings, too, but firings come back to every ring.
    returns = !rings.insert(points[i].ring).second;
    bounds.push_back(i);
  }
  if (returns || 4 * (bounds.size() - 1) >= points.size()) bounds.resize(1);
  bounds.push_back(points.size());
  return bounds;
}

/// Of points that come firing by firing: angle to the last, in the direction of turning (before it: negative).
std::vector<double> AnglesByFiring(const std::vector<double>& azimuths) {
  // Beams differ a little in azimuth and the last firings may overlap the first: steps are taken as the shorter way
  // round.
  std::vector<double> angles(azimuths.size());
  for (std::size_t i = 1; i < azimuths.size(); ++i)
    angles[i] = angles[i - 1] + std::remainder(azimuths[i] - azimuths[i - 1], kTurn);
  const double end = angles.back(), direction = std::copysign(1, end);
  for (double& angle : angles) angle = direction * (angle - end);
  return angles;
}

/// 1: the azimuth grows along the rings, -1: it falls.
double DirectionOfRings(const std::vector<double>& azimuths, const std::vector<std::size_t>& bounds) {
  // Steps are counted, not added up: one over a gap may be more than half a turn and look as if it went back.
  int ahead = 0;
  for (std::size_t ring = 0; ring + 1 < bounds.size(); ++ring) {
    for (std::size_t i = bounds[ring] + 1; i < bounds[ring + 1]; ++i) {
      const double step = std::remainder(azimuths[i] - azimuths[i - 1], kTurn);
      ahead += (step > 0 ? 1 : 0) - (step < 0 ? 1 : 0);
    }
  }
  return ahead < 0 ? -1 : 1;
}

/// Of points that come ring by ring, each over the same turn: angle to its end, in the direction of turning.
std::vector<double> AnglesByRing(const std::vector<double>& azimuths, const std::vector<std::size_t>& bounds) {
  constexpr double kJitter = kTurn / 36;  // by which the azimuth may fall back along a ring
  const double direction = DirectionOfRings(azimuths, bounds);
  const auto ahead = [&](std::size_t from, std::size_t to, double least) {
    const double angle = direction * std::remainder(azimuths[to] - azimuths[from], kTurn);
    return angle < least ? angle + kTurn : angle;
  };
  std::vector<double> angles(azimuths.size());
  std::size_t longest = 0;
  double seen = 0;  // by the ring that sees most of the turn
  for (std::size_t ring = 0; ring + 1 < bounds.size(); ++ring) {
    const std::size_t last = bounds[ring + 1] - 1;
    for (std::size_t i = bounds[ring] + 1; i <= last; ++i) angles[i] = angles[i - 1] + ahead(i - 1, i, -kJitter);
    if (angles[last] > seen) seen = angles[last], longest = ring;
  }
  double end = seen;
  for (std::size_t ring = 0; ring + 1 < bounds.size(); ++ring) {
    double begin = ahead(bounds[longest], bounds[ring], 0);
    // A ring may begin a little before that ring: a turn earlier, where it then juts out less.
    if (begin + angles[bounds[ring + 1] - 1] - seen > kTurn - begin) begin -= kTurn;
    for (std::size_t i = bounds[ring]; i < bounds[ring + 1]; ++i) end = std::max(end, angles[i] += begin);
  }
  for (double& angle : angles) angle -= end;
  return angles;
}

/// Spreads the points over a turn that ends now, by their azimuth.
void SpreadOverTurn(double turn_s, std::vector<LidarPoint>* points) {
  if (points->empty()) return;
  std::vector<double> azimuths;
  azimuths.reserve(points->size());
  for (const LidarPoint& point : *points) azimuths.push_back(std::atan2(point.p_lidar.y(), point.p_lidar.x()));
  const std::vector<std::size_t> bounds = BoundsOfRings(*points);
  const auto angles = bounds.size() > 2 ? AnglesByRing(azimuths, bounds) : AnglesByFiring(azimuths);
  for (std::size_t i = 0; i < points->size(); ++i) (*points)[i].t_ns += NsFromSeconds(turn_s * angles[i] / kTurn);
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
