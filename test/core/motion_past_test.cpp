// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_past.h"

#include <cmath>

#include <gtest/gtest.h>

#include "devo/core/depth_image.h"
#include "devo/core/time.h"
#include "most_probable.h"

namespace devo {
namespace {

using Kind = MotionPast::Kind;

constexpr std::int64_t kPeriod_ns = 10'000'000;
const Vector6d kTwist = (Vector6d() << 0.4, -0.2, 0.1, 0.3, -0.5, 0.2).finished();
const Vector6d kOff = (Vector6d() << 2e-3, -1e-3, 3e-3, 1e-3, 2e-3, -1e-3).finished();

Rigid3 TrueAt(std::int64_t t_ns) { return Exp(kTwist * SecondsFromNs(t_ns)); }

/// A filter, and its past, as tracking uses the two.
struct Track {
  MotionFilter motion{TrackingOptions()};
  MotionPast past;
  PoseHistory history;
  InertialBuffer inertial;

  Track() { motion.Start(0, Rigid3(), kTwist); }

  std::int64_t next_ns() const { return motion.time_ns() + kPeriod_ns; }

  /// What alignments say that err by `sigma` (m and rad) each by itself, by `shared` times that variance alike, and
  /// find the camera at `off` of where it is.
  void Measure(double sigma = 1e-3, double shared = 0, const Vector6d& off = Vector6d::Zero()) {
    const std::int64_t t_ns = next_ns();
    const MotionFilter before = motion;
    MotionPast::Step step{t_ns};
    Read(t_ns, kTwist.tail<3>());
    if (const auto read = inertial_led ? ReadSince(motion, t_ns, inertial) : std::nullopt) {
      motion.Advance(t_ns, *read);
      step.inertial = true;
    }
    const Matrix6d information = Matrix6d::Identity() / (sigma * sigma);
    const auto predicted = motion.Predict(t_ns);
    const Rigid3 found = MostProbable(predicted, TrueAt(t_ns) * Exp(off), information);
    step.measured = MotionFilter::LikelihoodOf(predicted, found, information, shared, 1);
    motion.Update(t_ns, *step.measured);
    Note(before, step);
  }

  /// In a surface that shows a standstill; the sensor says what it is `turning`, rad/s.
  void Rest(const Eigen::Vector3d& turning) {
    const MotionFilter before = motion;
    const std::int64_t t_ns = next_ns();
    Read(t_ns, turning);
    motion.HoldStill(t_ns, ReadSince(motion, t_ns, inertial));
    Note(before, {t_ns, Kind::kStill, false, std::nullopt});
  }

  void Unseen(Kind kind) {
    const MotionFilter before = motion;
    const std::int64_t t_ns = next_ns();
    if (kind == Kind::kStill) motion.HoldStill(t_ns);
    if (kind == Kind::kCoasting) motion.Coast(t_ns);
    if (kind == Kind::kMoving) motion.GoOn(t_ns);
    Note(before, {t_ns, kind, false, std::nullopt});
  }

  /// At a time: the camera is at `moved` of where it is thought to be, to a tenth of a millimetre.
  void Tell(std::int64_t t_ns, const Vector6d& moved, MotionPast::Since measured = MotionPast::Since::kPlaces) {
    auto then = past.At(t_ns, motion, inertial);
    ASSERT_TRUE(then);
    if (measured == MotionPast::Since::kMotion) then->WidenPose(1e4);
    then->Update(t_ns, then->pose() * Exp(moved), 1e8 * Matrix6d::Identity());
    motion = past.Again(*then, inertial, &history, measured);
  }

  bool inertial_led = false;

 private:
  /// A gyroscope alone, in the period until `t_ns`.
  void Read(std::int64_t t_ns, const Eigen::Vector3d& angular_velocity) {
    for (std::int64_t t = t_ns - kPeriod_ns + 2'000'000; t <= t_ns; t += 2'000'000) {
      ImuSample sample;
      sample.t_ns = t;
      sample.angular_velocity = angular_velocity;
      sample.linear_acceleration.setConstant(std::nan(""));
      inertial.Add(sample);
    }
  }

  void Note(const MotionFilter& before, const MotionPast::Step& step) {
    past.Note(before, step);
    history.Add(motion.time_ns(), motion.pose());
  }
};

void ExpectAlike(const MotionFilter& a, const MotionFilter& b, double tolerance = 1e-9) {
  EXPECT_EQ(a.time_ns(), b.time_ns());
  EXPECT_LT(Log(a.pose().inverse() * b.pose()).norm(), tolerance);
  EXPECT_LT((a.velocity_event() - b.velocity_event()).norm(), 10 * tolerance);
  EXPECT_LT((a.pose_covariance() - b.pose_covariance()).norm(), tolerance * a.pose_covariance().norm());
}

TEST(MotionPast, HasTheFilterOfThen) {
  Track track;
  for (int k = 0; k < 4; ++k) track.Measure();
  const MotionFilter then = track.motion;
  track.Measure();
  ExpectAlike(*track.past.At(then.time_ns(), track.motion, track.inertial), then);
  ExpectAlike(*track.past.At(track.motion.time_ns(), track.motion, track.inertial), track.motion);
  const std::int64_t between_ns = then.time_ns() + kPeriod_ns / 3;
  const auto between = track.past.At(between_ns, track.motion, track.inertial);
  ASSERT_TRUE(between);
  EXPECT_EQ(between->time_ns(), between_ns);
  EXPECT_LT(Log(then.Predict(between_ns).T_world_event.inverse() * between->pose()).norm(), 1e-9);
}

TEST(MotionPast, GoesOnWithOtherOptions) {
  Track track;
  for (int k = 0; k < 4; ++k) track.Measure();
  const std::int64_t then_ns = track.motion.time_ns() - kPeriod_ns / 2;
  const auto spread = [&] {
    const auto then = track.past.At(then_ns, track.motion, track.inertial);
    return then->Predict(then_ns + 10 * kPeriod_ns).covariance.trace();
  };
  const double before = spread();
  TrackingOptions lively;
  lively.acceleration_m_s2 *= 10;
  track.past.SetOptions(lively);
  EXPECT_GT(spread(), 2 * before);
}

TEST(MotionPast, KnowsNothingOfTheTimeBeforeItNorAfterNow) {
  Track track;
  for (int k = 0; k < 4; ++k) track.Measure();
  EXPECT_TRUE(track.past.At(0, track.motion, track.inertial));
  EXPECT_FALSE(track.past.At(-1, track.motion, track.inertial));
  EXPECT_FALSE(track.past.At(track.motion.time_ns() + 1, track.motion, track.inertial));
  const int steps = static_cast<int>(kMaxDepthLatency_s / SecondsFromNs(kPeriod_ns));
  for (int k = 0; k < steps; ++k) track.Measure();
  EXPECT_FALSE(track.past.At(0, track.motion, track.inertial)) << "depth is not as late as that";
  track.past.Clear();
  EXPECT_FALSE(track.past.At(track.motion.time_ns() - 1, track.motion, track.inertial));
}

TEST(MotionPast, GoesTheSameWayAgainWhereNothingIsTold) {
  for (const bool inertial : {false, true}) {
    Track track;
    track.inertial_led = inertial;
    for (int k = 0; k < 10; ++k) track.Measure();
    for (const Kind kind : {Kind::kMoving, Kind::kCoasting, Kind::kStill}) track.Unseen(kind);
    const MotionFilter now = track.motion;
    const auto then = track.past.At(5 * kPeriod_ns, now, track.inertial);
    ASSERT_TRUE(then);
    ExpectAlike(track.past.Again(*then, track.inertial, &track.history), now, 1e-7);
    EXPECT_LT(Log(TrueAt(8 * kPeriod_ns).inverse() * track.history.At(8 * kPeriod_ns).value()).norm(), 1e-4);
    EXPECT_EQ(track.history.last_time_ns(), now.time_ns());
  }
}

TEST(MotionPast, LeadsOnFromWhereARestEnded) {
  Track track;
  for (int k = 0; k < 10; ++k) track.Rest(Eigen::Vector3d::Zero());
  const MotionFilter rested = track.motion;
  for (int k = 0; k < 4; ++k) track.Rest(kTwist.tail<3>());
  const MotionFilter held = track.motion;
  EXPECT_LT(Log(rested.pose().inverse() * held.pose()).norm(), 1e-12);
  MotionFilter led = rested;
  while (led.time_ns() < held.time_ns()) {
    const std::int64_t t_ns = led.time_ns() + kPeriod_ns;
    led.Advance(t_ns, *ReadSince(led, t_ns, track.inertial));
  }
  const auto moving = track.past.AgainInMotion(rested.time_ns(), track.inertial, &track.history);
  ASSERT_TRUE(moving);
  ExpectAlike(*moving, led);
  EXPECT_NEAR(RotationAngle(held.pose().inverse() * moving->pose()), 0.04 * kTwist.tail<3>().norm(), 2e-3);
  EXPECT_LT(Log(track.history.At(held.time_ns())->inverse() * moving->pose()).norm(), 1e-9);
  EXPECT_LT(Log(track.history.At(rested.time_ns())->inverse() * rested.pose()).norm(), 1e-9);
  // What is told late from now on meets that motion.
  EXPECT_GT(RotationAngle(rested.pose().inverse() *
                          track.past.At(held.time_ns() - kPeriod_ns, *moving, track.inertial)->pose()),
            0.01);
}

TEST(MotionPast, LeadsThroughAGapThatTheSensorReadInOneStepAsInMany) {
  InertialBuffer inertial;
  const Eigen::Vector3d turn(0, 0, 3), push(1, 0, 9.81);
  for (std::int64_t t_ns = 0; t_ns <= 600'000'000; t_ns += 5'000'000) {
    inertial.Add({t_ns, turn, push, Eigen::Vector3d::Zero()});
  }
  MotionFilter at_once{TrackingOptions()};
  at_once.Start(0, Rigid3(), (Vector6d() << 0, 0, 0, turn).finished());
  at_once.LearnGravity({0, 0, 9.81}, 1);
  MotionFilter in_steps = at_once;
  while (in_steps.time_ns() < 500'000'000) {
    ASSERT_TRUE(AdvanceTo(in_steps.time_ns() + kPeriod_ns, inertial, &in_steps));
  }
  ASSERT_TRUE(AdvanceTo(500'000'000, inertial, &at_once));
  EXPECT_LT(Log(in_steps.pose().inverse() * at_once.pose()).norm(), 0.01);
  const MotionFilter before = at_once;
  EXPECT_FALSE(AdvanceTo(900'000'000, inertial, &at_once));
  ExpectAlike(at_once, before);
}

TEST(MotionPast, LeadsOnFromNoRestThatIsOverOrThatTheSensorDidNotRead) {
  Track over;
  over.Rest(Eigen::Vector3d::Zero());
  over.Measure();
  EXPECT_FALSE(over.past.AgainInMotion(0, over.inertial, &over.history));
  Track unread;
  unread.Unseen(Kind::kStill);
  EXPECT_FALSE(unread.past.AgainInMotion(0, unread.inertial, &unread.history));
}

TEST(MotionPast, WhatIsToldLateIsAsIfItWereToldInTimeWhereNothingWasMeasuredSince) {
  for (const Kind kind : {Kind::kMoving, Kind::kCoasting, Kind::kStill}) {
    Track late, in_time;
    for (int k = 0; k < 10; ++k) {
      late.Measure();
      in_time.Measure();
    }
    const std::int64_t then_ns = late.motion.time_ns();
    in_time.Tell(then_ns, kOff);
    for (int k = 0; k < 5; ++k) {
      late.Unseen(kind);
      in_time.Unseen(kind);
    }
    late.Tell(then_ns, kOff);
    ExpectAlike(late.motion, in_time.motion);
    for (int k = 0; k <= 5; ++k) {
      const std::int64_t t_ns = then_ns + k * kPeriod_ns;
      EXPECT_LT(Log(late.history.At(t_ns)->inverse() * in_time.history.At(t_ns).value()).norm(), 1e-9) << k;
    }
  }
}

TEST(MotionPast, WhatIsToldLateHoldsAgainstLaterAlignmentsThatErrAlike) {
  const auto left_after_being_told = [](double shared) {
    Track track;
    for (int k = 0; k < 20; ++k) track.Measure(1e-3, shared, kOff);
    const std::int64_t then_ns = 15 * kPeriod_ns;
    track.Tell(then_ns, Log(track.past.At(then_ns, track.motion, track.inertial)->pose().inverse() * TrueAt(then_ns)));
    return Log(TrueAt(track.motion.time_ns()).inverse() * track.motion.pose()).norm() / kOff.norm();
  };
  EXPECT_LT(left_after_being_told(10), 0.3);
  EXPECT_GT(left_after_being_told(0), 0.6) << "each by itself, they take it back";
}

TEST(MotionPast, APoseThatWasFalseMovesWhatWasFoundFromItAndNotTheVelocity) {
  const Vector6d false_by = 50 * kOff;
  const auto told = [&](MotionPast::Since measured) {
    Track track;
    for (int k = 0; k < 20; ++k) track.Measure(1e-3, 0, false_by);
    const std::int64_t then_ns = 17 * kPeriod_ns;
    track.Tell(then_ns, -false_by, measured);
    return track.motion;
  };
  const MotionFilter moved = told(MotionPast::Since::kMotion), pulled_back = told(MotionPast::Since::kPlaces);
  const auto pose_error = [](const MotionFilter& motion) {
    return Log(TrueAt(motion.time_ns()).inverse() * motion.pose()).norm();
  };
  EXPECT_LT(pose_error(moved), 0.05 * false_by.norm());
  EXPECT_LT((moved.velocity_event() - kTwist).norm(), 0.2 * kTwist.norm());
  EXPECT_GT(pose_error(pulled_back), 0.3 * false_by.norm()) << "else there is nothing to be gained";
}

TEST(MotionPast, LatePosesTellTheVelocityToo) {
  Track track;
  Vector6d wrong = Vector6d::Zero();
  wrong(0) = 0.1;
  track.motion.Start(0, Rigid3(), kTwist + wrong);
  for (int k = 1; k <= 30; ++k) {
    track.Unseen(Kind::kMoving);
    const std::int64_t then_ns = (k - 4) * kPeriod_ns;
    if (k < 9 || k % 3) continue;
    const auto then = track.past.At(then_ns, track.motion, track.inertial);
    ASSERT_TRUE(then) << k;
    track.Tell(then_ns, Log(then->pose().inverse() * TrueAt(then_ns)));
  }
  EXPECT_LT((track.motion.velocity_event() - kTwist).norm(), 0.3 * wrong.norm());
  EXPECT_LT(Log(TrueAt(track.motion.time_ns()).inverse() * track.motion.pose()).norm(), 3e-3);
}

TEST(MotionFilter, IsToldTheSameByALikelihoodWhateverItPredicts) {
  Track track;
  for (int k = 0; k < 10; ++k) track.Measure();
  const std::int64_t t_ns = track.next_ns();
  const Matrix6d information = 1e6 * Matrix6d::Identity();
  const auto predicted = track.motion.Predict(t_ns);
  const Rigid3 measured = predicted.T_world_aligned * Exp(kOff);
  const auto most_probable = [&](const MotionFilter::Prediction& prior) {
    return MostProbable(prior, measured, information);
  };
  const auto said = MotionFilter::LikelihoodOf(predicted, most_probable(predicted), information, 0, 1);
  MotionFilter same = track.motion, told = track.motion;
  same.Update(t_ns, said);
  told.Update(t_ns, most_probable(predicted), information);
  ExpectAlike(same, told, 1e-8);

  MotionFilter other = track.motion;
  other.Update(other.time_ns(), other.pose() * Exp(-3 * kOff), 1e8 * Matrix6d::Identity());
  const auto expected = most_probable(other.Predict(t_ns));
  other.Update(t_ns, said);
  EXPECT_LT(Log(expected.inverse() * other.pose()).norm(), 0.01 * kOff.norm());
}

}  // namespace
}  // namespace devo
