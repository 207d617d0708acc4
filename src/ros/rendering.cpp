// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/rendering.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include <sensor_msgs/image_encodings.h>
#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "devo/ros/conversions.h"

namespace devo {
namespace {

struct Range {
  double nearest_m = 0.5, farthest_m = 5;
};

/// Where most of the depths lie, so that colours spread over the scene at hand.
Range RangeOf(std::vector<float> depths_m) {
  Range range;
  if (depths_m.size() < 10) return range;
  const auto at = [&](double share) {
    const auto index = static_cast<std::ptrdiff_t>(share * static_cast<double>(depths_m.size() - 1));
    std::nth_element(depths_m.begin(), depths_m.begin() + index, depths_m.end());
    return static_cast<double>(depths_m[static_cast<std::size_t>(index)]);
  };
  range.nearest_m = at(0.02);
  range.farthest_m = std::max(at(0.98), 1.05 * range.nearest_m);
  return range;
}

/// One round of the colour wheel from red to blue, as a table.
const std::array<cv::Vec3b, 256>& Colours() {
  static const std::array<cv::Vec3b, 256> table = [] {
    cv::Mat1b ramp(1, 256);
    for (int i = 0; i < 256; ++i) ramp(0, i) = static_cast<std::uint8_t>(i);
    cv::Mat3b colours;
    cv::applyColorMap(ramp, colours, cv::COLORMAP_JET);
    std::array<cv::Vec3b, 256> result;
    for (int i = 0; i < 256; ++i) result[static_cast<std::size_t>(i)] = colours(0, i);
    return result;
  }();
  return table;
}

cv::Mat3b DimmedGrey(const cv::Mat1b& image, double share) {
  cv::Mat1b dimmed;
  image.convertTo(dimmed, CV_8U, share);
  cv::Mat3b colour;
  cv::cvtColor(dimmed, colour, cv::COLOR_GRAY2BGR);
  return colour;
}

}  // namespace

cv::Vec3b DepthColour(double depth_m, double nearest_m, double farthest_m) {
  const double share = (1 / depth_m - 1 / farthest_m) / (1 / nearest_m - 1 / farthest_m);
  return Colours()[static_cast<std::size_t>(std::lround(255 * std::clamp(share, 0.0, 1.0)))];
}

cv::Mat3b RenderReprojection(const Surface& surface, const LocalMap& map, const Rigid3& T_event_ref,
                             const Camera& camera) {
  cv::Mat3b picture = DimmedGrey(surface.image, 0.7);
  std::vector<std::pair<cv::Point, float>> shown;
  std::vector<float> depths_m;
  for (const MapPoint& point : map.points) {
    const Eigen::Vector3d p = T_event_ref * point.p_ref.cast<double>();
    const auto u = camera.Project(p);
    if (!u || !camera.Contains(*u)) continue;
    shown.emplace_back(cv::Point(cvRound(u->x()), cvRound(u->y())), static_cast<float>(p.z()));
    depths_m.push_back(static_cast<float>(p.z()));
  }
  const Range range = RangeOf(depths_m);
  for (const auto& [u, depth_m] : shown) picture(u) = DepthColour(depth_m, range.nearest_m, range.farthest_m);
  return picture;
}

cv::Mat3b RenderDepthOverlay(const Surface& surface, const DepthImage& depth, const cv::Mat2f& rays,
                             const Rigid3& T_event_depth, const Camera& camera) {
  const cv::Size size(camera.width(), camera.height());
  cv::Mat1f nearest(size, 0.F);
  const int rows = std::min(rays.rows, depth.depth_m.rows), cols = std::min(rays.cols, depth.depth_m.cols);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) {
      const float z = depth.depth_m(y, x);
      const cv::Vec2f& ray = rays(y, x);
      if (!(z > 0) || std::isnan(ray[0])) continue;
      const Eigen::Vector3d p = T_event_depth * Eigen::Vector3d(z * ray[0], z * ray[1], z);
      const auto u = camera.Project(p);
      if (!u || !camera.Contains(*u)) continue;
      float& there = nearest(cvRound(u->y()), cvRound(u->x()));
      if (there == 0 || p.z() < there) there = static_cast<float>(p.z());
    }
  }
  std::vector<float> depths_m;
  std::copy_if(nearest.begin(), nearest.end(), std::back_inserter(depths_m), [](float z) { return z > 0; });
  const Range range = RangeOf(std::move(depths_m));
  cv::Mat3b picture(size, cv::Vec3b(0, 0, 0));
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      if (nearest(y, x) > 0) picture(y, x) = 0.6 * DepthColour(nearest(y, x), range.nearest_m, range.farthest_m);
    }
  }
  // A depth image of fewer pixels than the event image leaves gaps between its readings.
  cv::Mat3b closed;
  cv::morphologyEx(picture, closed, cv::MORPH_CLOSE, cv::Mat::ones(3, 3, CV_8U));
  for (const EdgePoint& edge : surface.edges) {
    const cv::Point u(cvRound(edge.x), cvRound(edge.y));
    if (u.inside(cv::Rect(cv::Point(0, 0), size))) closed(u) = cv::Vec3b(255, 255, 255);
  }
  return closed;
}

sensor_msgs::ImagePtr ToImageMsg(const cv::Mat& image, std::int64_t t_ns, const std::string& frame_id) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = ToRosTime(t_ns);
  message->header.frame_id = frame_id;
  message->height = static_cast<std::uint32_t>(image.rows);
  message->width = static_cast<std::uint32_t>(image.cols);
  message->encoding = image.channels() == 3 ? sensor_msgs::image_encodings::BGR8 : sensor_msgs::image_encodings::MONO8;
  message->step = static_cast<std::uint32_t>(image.cols * image.elemSize());
  message->data.resize(static_cast<std::size_t>(message->step) * message->height);
  for (int y = 0; y < image.rows; ++y) {
    std::memcpy(&message->data[static_cast<std::size_t>(y) * message->step], image.ptr(y), message->step);
  }
  return message;
}

sensor_msgs::PointCloud2Ptr ToPointCloudMsg(const std::vector<MapPoint>& points, const Rigid3& T, std::int64_t t_ns,
                                            const std::string& frame_id) {
  auto message = boost::make_shared<sensor_msgs::PointCloud2>();
  message->header.stamp = ToRosTime(t_ns);
  message->header.frame_id = frame_id;
  message->height = 1;
  message->width = static_cast<std::uint32_t>(points.size());
  message->is_dense = 1;
  std::uint32_t offset = 0;
  for (const char* name : {"x", "y", "z", "intensity"}) {
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = offset;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    message->fields.push_back(field);
    offset += 4;
  }
  message->point_step = offset;
  message->row_step = offset * message->width;
  message->data.resize(message->row_step);
  const Eigen::Matrix3f R = T.rotation().toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T.translation().cast<float>();
  std::uint8_t* to = message->data.data();
  for (const MapPoint& point : points) {
    const Eigen::Vector3f p = R * point.p_ref + t;
    const float values[4] = {p.x(), p.y(), p.z(), static_cast<float>(point.reference)};
    std::memcpy(to, values, sizeof(values));
    to += sizeof(values);
  }
  return message;
}

}  // namespace devo
