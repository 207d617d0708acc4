// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/events_misfit.h"

#include <limits>

#include <gtest/gtest.h>

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 33'000'000;

/// After so many images in quick succession, all of this square; they begin at `begin`.
void Note(int images, double square, EventsMisfit* misfit, std::int64_t begin_ns = kPeriod_ns, bool believed = true) {
  for (int k = 0; k < images; ++k) misfit->Note(begin_ns + k * kPeriod_ns, square, believed);
}

TEST(EventsMisfit, IsNoneWhereEventsErrAsIsStatedOrLess) {
  EventsMisfit misfit;
  EXPECT_EQ(misfit.TimesAt(kPeriod_ns), 1);
  Note(30, 6, &misfit);
  EXPECT_NEAR(misfit.TimesAt(30 * kPeriod_ns), 1, 1e-9);
  Note(30, 0.5, &misfit, 31 * kPeriod_ns);
  EXPECT_EQ(misfit.TimesAt(60 * kPeriod_ns), 1);
}

TEST(EventsMisfit, GrowsWithinAFewImagesToWhatTheySayAndFadesMoreSlowly) {
  EventsMisfit misfit;
  Note(5, 1, &misfit);
  Note(4, 60, &misfit, 6 * kPeriod_ns);
  const double grown = misfit.TimesAt(9 * kPeriod_ns);
  EXPECT_GT(grown, 8);
  EXPECT_LT(grown, 10);
  Note(4, 1, &misfit, 10 * kPeriod_ns);
  EXPECT_GT(misfit.TimesAt(13 * kPeriod_ns), 5);
  Note(60, 1, &misfit, 14 * kPeriod_ns);
  EXPECT_EQ(misfit.TimesAt(73 * kPeriod_ns), 1);
}

TEST(EventsMisfit, ImagesThatMayBeWrongThemselvesSayAtMostThatEventsAreRight) {
  EventsMisfit misfit;
  Note(30, 300, &misfit, kPeriod_ns, false);
  EXPECT_NEAR(misfit.TimesAt(30 * kPeriod_ns), 1, 1e-9);
  Note(4, 60, &misfit, 31 * kPeriod_ns);
  const double grown = misfit.TimesAt(34 * kPeriod_ns);
  Note(10, 300, &misfit, 35 * kPeriod_ns, false);
  EXPECT_LT(misfit.TimesAt(44 * kPeriod_ns), 0.6 * grown);
}

TEST(EventsMisfit, OneImageAlignedToAWrongPlaceSaysNoMoreThanOneThatIsFarOff) {
  EventsMisfit misfit;
  Note(2, 1e9, &misfit);
  EXPECT_LT(misfit.TimesAt(2 * kPeriod_ns), 70);
}

TEST(EventsMisfit, ImagesThatComeSeldomSayNothingAndWhatWasSaidFadesWithoutThem) {
  EventsMisfit seldom;
  for (int k = 1; k <= 10; ++k) seldom.Note(k * 200'000'000, 300, true);
  EXPECT_EQ(seldom.TimesAt(10 * 200'000'000LL), 1);
  EventsMisfit ended;
  Note(10, 300, &ended);
  EXPECT_GT(ended.TimesAt(11 * kPeriod_ns), 40) << "the next is not due yet";
  EXPECT_LT(ended.TimesAt(10 * kPeriod_ns + 1'000'000'000), 7);
  ended.Note(10 * kPeriod_ns + 3'000'000'000, 300, true);
  EXPECT_LT(ended.TimesAt(10 * kPeriod_ns + 3'000'000'000), 1.1);
}

TEST(EventsMisfit, ImagesOutOfOrderOrWithoutAFiniteSquareSayNothing) {
  EventsMisfit misfit;
  Note(10, 60, &misfit);
  const double times = misfit.TimesAt(10 * kPeriod_ns);
  misfit.Note(5 * kPeriod_ns, 1e9, true);
  misfit.Note(10 * kPeriod_ns, 1e9, true);
  misfit.Note(11 * kPeriod_ns, std::numeric_limits<double>::quiet_NaN(), true);
  EXPECT_EQ(misfit.TimesAt(10 * kPeriod_ns), times);
}

}  // namespace
}  // namespace devo
