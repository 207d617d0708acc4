// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/lone_crests.h"

#include <algorithm>
#include <cstdint>

#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

namespace devo {
namespace {

// Ridges between two pixels are common, and rounding halves to even would tear neighbours apart.
cv::Point PixelOf(const EdgePoint& crest) { return {cvFloor(crest.x + 0.5F), cvFloor(crest.y + 0.5F)}; }

}  // namespace

void DropLoneCrests(cv::Size image, std::vector<EdgePoint>* crests) {
  const cv::Rect inside(cv::Point(), image);
  cv::Mat1b has_crest(image, std::uint8_t{0});
  for (const EdgePoint& crest : *crests) {
    if (inside.contains(PixelOf(crest))) has_crest(PixelOf(crest)) = 1;
  }
  cv::Mat1i group_at;
  std::vector<int> size(static_cast<std::size_t>(cv::connectedComponents(has_crest, group_at)), 0);
  for (const EdgePoint& crest : *crests) {
    if (inside.contains(PixelOf(crest))) ++size[static_cast<std::size_t>(group_at(PixelOf(crest)))];
  }
  const auto is_lone = [&](const EdgePoint& crest) {
    const cv::Point at = PixelOf(crest);
    return !inside.contains(at) || size[static_cast<std::size_t>(group_at(at))] < kLeastCrestsTogether;
  };
  crests->erase(std::remove_if(crests->begin(), crests->end(), is_lone), crests->end());
}

}  // namespace devo
