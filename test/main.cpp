// SPDX-License-Identifier: BSD-3-Clause
//
// One main for every layer's tests: whether catkin links one of gtest's own depends on its version.
#include <gmock/gmock.h>

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  return RUN_ALL_TESTS();
}
