// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_continuity.h"

#include <random>

#include <gtest/gtest.h>

namespace devo {
namespace {

using Verdict = DepthContinuity::Verdict;

constexpr double kStep_s = 1.0 / 30;
const Vector6d kVelocity = (Vector6d() << 0.1, -0.2, 0.1, 0.3, 0.2, -0.1).finished();
/// As a Kinect's when it corrects itself: a wall leans by a degree.
const Rigid3 kJump = Exp((Vector6d() << -0.014, 0, 0, 0, 0.015, 0).finished());

/// A camera that moves steadily and is tracked, and seen by depth, within `sigma` (m and rad).
class DepthContinuityTest : public ::testing::Test {
 protected:
  Rigid3 Truth() const { return Exp(kVelocity * (kStep_s * step_)); }

  Verdict Next(const Rigid3& tracked_beside = Rigid3(), const Rigid3& seen_beside = Rigid3()) {
    ++step_;
    return continuity_.Judge({static_cast<std::int64_t>(1e9 * kStep_s * step_), Noisy(Truth() * tracked_beside),
                              Noisy(Truth() * seen_beside), Matrix6d::Identity() / (kSigma * kSigma)});
  }

  void Begin(int steps = 10) {
    for (int i = 0; i < steps; ++i) EXPECT_EQ(Next(), Verdict::kSteady);
  }

 private:
  static constexpr double kSigma = 5e-4;

  Rigid3 Noisy(const Rigid3& pose) {
    std::normal_distribution<double> noise(0, kSigma);
    return pose * Exp(Vector6d::NullaryExpr([&] { return noise(random_); }));
  }

  DepthContinuity continuity_;
  int step_ = 0;
  std::mt19937 random_{1};
};

TEST_F(DepthContinuityTest, AJumpIsCertainWithTheImageAfterItAndOnce) {
  Begin();
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kJumped);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kSteady);
}

TEST_F(DepthContinuityTest, NoiseIsNoJump) { Begin(500); }

TEST_F(DepthContinuityTest, AMotionThatTrackingMissesIsHeldBackForOneImageAndIsNoJump) {
  Begin();
  Rigid3 beside = kJump;
  EXPECT_EQ(Next(Rigid3(), beside), Verdict::kDoubtful);
  for (int i = 0; i < 5; ++i) {
    beside = beside * kJump;
    EXPECT_EQ(Next(Rigid3(), beside), Verdict::kSteady);
  }
}

TEST_F(DepthContinuityTest, ASlipOfTheTrackingIsNoJump) {
  Begin();
  for (int i = 0; i < 5; ++i) EXPECT_EQ(Next(kJump), Verdict::kSteady) << "depth is what brings it back";
}

TEST_F(DepthContinuityTest, BeforeTheVelocityIsKnownNothingIsAJump) {
  Begin(1);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kSteady);
}

TEST_F(DepthContinuityTest, AJumpIsNoticedAsSoonAsTheVelocityIsKnown) {
  Begin(2);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kJumped);
}

TEST_F(DepthContinuityTest, AJumpIsNoticedWhilePosesAreStillToBeFound) {
  for (const double off : {0.012, -0.012, 0.006, 0.0, 0.0}) Next(Exp(Vector6d::Constant(off)));
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kJumped);
}

TEST_F(DepthContinuityTest, AJumpIsCertainThoughTheNextImageDiffersMoreThanUsual) {
  Begin();
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Exp(Vector6d::Constant(0.0025)), kJump), Verdict::kJumped) << "but by far less than the jump";
}

TEST_F(DepthContinuityTest, ABeginningWithPoorPosesDoesNotHideAJump) {
  for (int i = 0; i < 4; ++i) Next(Exp(Vector6d::Constant(i % 2 ? 0.02 : -0.02)));
  for (int i = 0; i < 8; ++i) Next();
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kJumped);
}

TEST_F(DepthContinuityTest, SlipsOfTheTrackingDoNotHideAJump) {
  Begin(20);
  for (int i = 0; i < 3; ++i) {
    Next(Exp(Vector6d::Constant(0.05)));
    Next();
    Begin(5);
  }
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kDoubtful);
  EXPECT_EQ(Next(Rigid3(), kJump), Verdict::kJumped);
}

}  // namespace
}  // namespace devo
