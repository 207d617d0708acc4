// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/median.h"

#include <gtest/gtest.h>

namespace devo {
namespace {

TEST(Median, IsTheMiddleOneWhateverTheOrderAndOfAnEvenNumberTheLargerOfBoth) {
  EXPECT_EQ(Median<int>({7}), 7);
  EXPECT_EQ(Median<int>({9, 1, 5}), 5);
  EXPECT_EQ(Median<double>({4, 1, 3, 2}), 3);
}

}  // namespace
}  // namespace devo
