// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/lone_crests.h"

#include <vector>

#include <gtest/gtest.h>

namespace devo {
namespace {

const cv::Size kImage(60, 40);

EdgePoint CrestAt(float x, float y) {
  EdgePoint crest;
  crest.x = x;
  crest.y = y;
  return crest;
}

/// `count` crests that go on, one per pixel, by `step_y` px each.
std::vector<EdgePoint> Line(int count, float x, float y, float step_y = 0) {
  std::vector<EdgePoint> line;
  for (int i = 0; i < count; ++i)
    line.push_back(CrestAt(x + static_cast<float>(i), y + step_y * static_cast<float>(i)));
  return line;
}

std::vector<EdgePoint> Left(std::vector<EdgePoint> crests) {
  DropLoneCrests(kImage, &crests);
  return crests;
}

TEST(LoneCrests, ThatAreFewTogetherAreDroppedAndEdgesThatGoOnStayInTheirOrder) {
  std::vector<EdgePoint> crests = Line(4, 3.2F, 5.4F);
  const std::vector<EdgePoint> edge = Line(12, 20.3F, 10.1F, 0.7F);
  crests.insert(crests.end(), edge.begin(), edge.end());
  crests.push_back(CrestAt(50, 35));
  const auto left = Left(crests);
  ASSERT_EQ(left.size(), edge.size());
  for (std::size_t i = 0; i < edge.size(); ++i) EXPECT_EQ(left[i].x, edge[i].x) << i;
}

TEST(LoneCrests, OfSeveralPiecesThatMeetAreOneEdge) {
  // The last one found joins both arms: they had been two groups of five until then.
  std::vector<EdgePoint> crests = Line(5, 10, 20);
  for (const EdgePoint& crest : Line(5, 16, 20)) crests.push_back(crest);
  EXPECT_TRUE(Left(crests).empty());
  crests.push_back(CrestAt(15, 21));
  EXPECT_EQ(Left(crests).size(), 11U);
}

TEST(LoneCrests, AtTheImagesBordersAreLookedAtWithinIt) {
  const auto width = static_cast<float>(kImage.width), height = static_cast<float>(kImage.height);
  EXPECT_EQ(Left(Line(10, 0, 0)).size(), 10U);
  EXPECT_EQ(Left(Line(10, width - 10, height - 1)).size(), 10U);
  // One row's end does not go on in the next row.
  std::vector<EdgePoint> wrapped = Line(5, width - 5, 10);
  for (const EdgePoint& crest : Line(5, 0, 11)) wrapped.push_back(crest);
  EXPECT_TRUE(Left(wrapped).empty());
}

TEST(LoneCrests, BetweenTwoPixelsAreTogetherAsThoseOnThem) { EXPECT_EQ(Left(Line(9, 10.5F, 20.5F)).size(), 9U); }

TEST(LoneCrests, OfNoneAreNone) { EXPECT_TRUE(Left({}).empty()); }

}  // namespace
}  // namespace devo
