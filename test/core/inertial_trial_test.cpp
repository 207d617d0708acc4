// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/inertial_trial.h"

#include <cmath>
#include <functional>
#include <utility>

#include <gtest/gtest.h>

#include "devo/core/time.h"

namespace devo {
namespace {

using Eigen::Vector3d;

constexpr std::int64_t kPeriod_ns = 10'000'000;

/// A camera that swings about two axes, by up to 1 rad/s, and what a gyroscope reads of it.
class Swing {
 public:
  using Reader = std::function<Vector3d(const Vector3d& turn)>;

  explicit Swing(Reader read) : read_(std::move(read)) {}

  /// Poses that are trusted, at 100 Hz.
  void Go(double seconds, double times_its_errors, bool moves = true, bool trusted = true) {
    for (int k = 0; k < std::lround(seconds * 100); ++k) {
      t_ns_ += kPeriod_ns;
      const double phase = 2 * M_PI * SecondsFromNs(t_ns_);
      const Vector3d turn = moves ? Vector3d(std::sin(phase), std::cos(phase), 0) : Vector3d::Zero();
      T_world_event_ = T_world_event_ * Rigid3(Eigen::Quaterniond(ExpSO3(0.01 * turn)), Vector3d::Zero());
      readings_.Add({t_ns_, read_(turn), {0, 0, 9.8}, Vector3d::Zero()});
      const bool used = trial_.Judge({t_ns_, T_world_event_, trusted, moves}, times_its_errors, readings_);
      changes_ += used != readings_.used() ? 1 : 0;
      readings_.SetUsed(used);
    }
  }

  bool used() const { return readings_.used(); }
  int changes() const { return changes_; }

 private:
  Reader read_;
  InertialTrial trial_;
  InertialBuffer readings_;
  Rigid3 T_world_event_;
  std::int64_t t_ns_ = 0;
  int changes_ = 0;
};

Vector3d AsItIs(const Vector3d& turn) { return turn; }
Vector3d Reversed(const Vector3d& turn) { return -turn; }
Vector3d OnOtherAxes(const Vector3d& turn) { return {turn.y(), turn.z(), turn.x()}; }
Vector3d Nothing(const Vector3d& /*turn*/) { return Vector3d::Zero(); }

TEST(InertialTrial, LeavesOutASensorThatFitsALittleBadlyInItsFirstSecondsOnly) {
  Swing swing(Nothing);
  swing.Go(0.2, 1);
  EXPECT_TRUE(swing.used());
  swing.Go(0.2, 4);
  EXPECT_FALSE(swing.used());
  EXPECT_EQ(swing.changes(), 1);

  Swing later(Nothing);
  later.Go(2.5, 1);
  later.Go(0.2, 4);
  EXPECT_TRUE(later.used()) << "poses may err for a moment";
  later.Go(0.2, 16);
  EXPECT_FALSE(later.used());
}

TEST(InertialTrial, DoesNotCountAStandstillAmongTheFirstSeconds) {
  Swing swing(Nothing);
  swing.Go(10, 1, false);
  swing.Go(0.2, 4);
  EXPECT_FALSE(swing.used());
}

TEST(InertialTrial, DoesNotCountAMotionBeforeTheSensorWasReadAmongTheFirstSeconds) {
  Swing swing(Nothing);
  swing.Go(10, 0);
  swing.Go(0.2, 4);
  EXPECT_FALSE(swing.used());
}

TEST(InertialTrial, KnowsASensorThatReadsTheTurnsBeforeTheFirstSecondsAreOver) {
  Swing swing(AsItIs);
  swing.Go(1, 1);
  swing.Go(0.2, 4);
  EXPECT_TRUE(swing.used());
}

TEST(InertialTrial, TakesASensorBackThatReadsTheTurns) {
  Swing swing([](const Vector3d& turn) -> Vector3d { return 1.1 * turn + Vector3d(0.05, 0, 0); });
  swing.Go(0.2, 20);
  EXPECT_FALSE(swing.used());
  swing.Go(2, 0);
  EXPECT_TRUE(swing.used());
  EXPECT_EQ(swing.changes(), 2);
}

TEST(InertialTrial, DoesNotTakeASensorBackWhereItReadsOtherTurnsOrPosesAreNotToBeTrusted) {
  for (const auto& read : {Reversed, OnOtherAxes, Nothing}) {
    Swing swing(read);
    swing.Go(0.2, 20);
    swing.Go(10, 0);
    EXPECT_FALSE(swing.used());
  }
  Swing distrusted(AsItIs);
  distrusted.Go(0.2, 20, true, false);
  distrusted.Go(10, 0, true, false);
  EXPECT_FALSE(distrusted.used());
}

}  // namespace
}  // namespace devo
