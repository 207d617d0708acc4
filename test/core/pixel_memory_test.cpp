// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/pixel_memory.h"

#include <gtest/gtest.h>

#include "firing.h"

namespace devo {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(PixelMemory, KnowsTheShareOfOnAmongThePixelsThatFiredShortlyBefore) {
  PixelMemory memory(20, 20, 10000);
  for (int x = 0; x < 10; ++x) Fire(0, x, 3, false, &memory);
  for (int x = 0; x < 4; ++x) Fire(100 * kMs, x, 5, x > 0, &memory);
  EXPECT_DOUBLE_EQ(memory.ShareOfOn(101 * kMs), 0.75);
}

TEST(PixelMemory, TakesHalfOfTheEventsForOnWhereNoneFiredShortlyBefore) {
  PixelMemory memory(20, 20, 10000);
  Fire(0, 3, 3, true, &memory);
  memory.ForgetLongAgo(100 * kMs);
  EXPECT_EQ(memory.ShareOfOn(100 * kMs), 0.5);
}

TEST(PixelMemory, AsksToForgetLessOftenWhereTheWindowIsLong) {
  PixelMemory brief(20, 20, 10000), lasting(20, 20, 100000);
  brief.Begin(kMs);
  lasting.Begin(kMs);
  EXPECT_GT(brief.next_forgetting_ns() - kMs, 10 * kMs);
  EXPECT_GT(lasting.next_forgetting_ns() - kMs, 100 * kMs);
}

}  // namespace
}  // namespace devo
