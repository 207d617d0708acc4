// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/lone_crests.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include <opencv2/core/mat.hpp>

namespace devo {
namespace {

constexpr int kLeastTogether = 9;  // crests, each a neighbour of another

/// Which crests lie together (union-find).
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count), size_(count, 1) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }

  void Join(std::size_t i, std::size_t j) {
    const std::size_t a = RootOf(i), b = RootOf(j);
    if (a == b) return;
    parent_[a] = b;
    size_[b] += size_[a];
  }

  int SizeOf(std::size_t i) { return size_[RootOf(i)]; }

 private:
  std::size_t RootOf(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  std::vector<std::size_t> parent_;
  std::vector<int> size_;
};

}  // namespace

void DropLoneCrests(cv::Size image, std::vector<EdgePoint>* crests) {
  constexpr std::int32_t kNone = -1;
  const cv::Rect inside(cv::Point(), image);
  cv::Mat1i crest_at(image, kNone);
  Groups groups(crests->size());
  for (std::size_t i = 0; i < crests->size(); ++i) {
    // Ridges between two pixels are common, and rounding halves to even would tear neighbours apart.
    const cv::Point at(cvFloor((*crests)[i].x + 0.5F), cvFloor((*crests)[i].y + 0.5F));
    if (!inside.contains(at)) continue;
    for (int y = std::max(at.y - 1, 0); y <= std::min(at.y + 1, image.height - 1); ++y) {
      for (int x = std::max(at.x - 1, 0); x <= std::min(at.x + 1, image.width - 1); ++x) {
        if (crest_at(y, x) != kNone) groups.Join(i, static_cast<std::size_t>(crest_at(y, x)));
      }
    }
    crest_at(at) = static_cast<std::int32_t>(i);
  }
  std::size_t left = 0;
  for (std::size_t i = 0; i < crests->size(); ++i) {
    if (groups.SizeOf(i) >= kLeastTogether) (*crests)[left++] = (*crests)[i];
  }
  crests->resize(left);
}

}  // namespace devo
