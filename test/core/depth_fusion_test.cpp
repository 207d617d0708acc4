// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_fusion.h"

#include <cmath>

#include <gtest/gtest.h>
#include <Eigen/LU>

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 33'000'000;

DepthPose PoseAt(std::int64_t t_ns, const Rigid3& T_world_event, double sigma = 1e-3) {
  DepthPose pose;
  pose.t_ns = t_ns;
  pose.T_world_event = T_world_event;
  pose.information = Matrix6d::Identity() / (sigma * sigma);
  return pose;
}

DepthFusion::Estimate EstimateAt(const Rigid3& T_world_event, double sigma = 1e-3) {
  return {T_world_event, sigma * sigma * Matrix6d::Identity()};
}

/// That says nothing of where along x the camera is.
DepthPose OpenAlongX(DepthPose pose) {
  pose.information(0, 0) = 0;
  return pose;
}

Vector6d SmallStep() { return (Vector6d() << 1e-3, -5e-4, 8e-4, 3e-4, 5e-4, -2e-4).finished(); }

TEST(DepthFusion, MovesThePoseByTheShareThatTheTwoCertaintiesSay) {
  const Rigid3 T = Exp((Vector6d() << 1, 2, 3, 0.3, -0.2, 0.5).finished());
  DepthFusion fusion;
  const auto half = fusion.Correct(PoseAt(kPeriod_ns, T * Exp(SmallStep())), EstimateAt(T));
  ASSERT_TRUE(half);
  EXPECT_LT((half->moved - 0.5 * SmallStep()).norm(), 1e-6);
  DepthFusion sure;
  const auto little = sure.Correct(PoseAt(kPeriod_ns, T * Exp(SmallStep())), EstimateAt(T, 1e-4));
  ASSERT_TRUE(little);
  EXPECT_LT(little->moved.norm(), 0.02 * SmallStep().norm());
}

TEST(DepthFusion, TakesWhatDiffersMoreThanUsualForAnErrorOfDepthAsWellUnlessSomethingElseSaysWhich) {
  const Rigid3 T = Exp((Vector6d() << 1, 2, 3, 0.3, -0.2, 0.5).finished());
  // Of two that are known alike: a normalised square of 4, up to which depth is as good as stated, and of 12.
  const Vector6d usual = 2 * std::sqrt(2.0) * 0.99e-3 * SmallStep().normalized(), unusual = std::sqrt(3.0) * usual;
  const auto share = [&T](const Vector6d& residual, bool guided, bool doubtful) {
    DepthFusion::Estimate estimate = EstimateAt(T);
    estimate.guided = guided;
    estimate.doubtful = doubtful;
    const auto correction = DepthFusion().Correct(PoseAt(kPeriod_ns, T * Exp(residual)), estimate);
    return correction ? correction->moved.norm() / residual.norm() : 0;
  };
  EXPECT_NEAR(share(usual, false, false), 0.5, 0.01);
  EXPECT_NEAR(share(unusual, false, false), 0.5 / 3, 0.01);
  EXPECT_NEAR(share(unusual, true, false), 0.5, 0.01);
  EXPECT_NEAR(share(unusual, false, true), 0.5, 0.01);
}

TEST(DepthFusion, HasNotAgreedAtTheBeginningOfTimeBeforeAnyImage) {
  DepthFusion fusion;
  EXPECT_FALSE(fusion.AgreedWithin(1, 10'000'000));
  EXPECT_EQ(fusion.VarianceScale(10'000'000, false), fusion.VarianceScale(1'000'000'000'000, false));
}

TEST(DepthFusion, BelievesTheThirdInARowThatContradictsAlike) {
  for (const bool guided : {false, true}) {
    DepthFusion::Estimate estimate = EstimateAt(Rigid3());
    estimate.guided = guided;
    const auto residual_at = [](int k) -> Vector6d { return (50 + 0.5 * k) * SmallStep(); };  // it drifts
    DepthFusion fusion;
    for (int k = 1; k <= 2; ++k) EXPECT_FALSE(fusion.Correct(PoseAt(k * kPeriod_ns, Exp(residual_at(k))), estimate));
    const auto correction = fusion.Correct(PoseAt(3 * kPeriod_ns, Exp(residual_at(3))), estimate);
    ASSERT_TRUE(correction);
    EXPECT_GT(correction->moved.norm(), 0.9 * residual_at(3).norm());
    EXPECT_EQ(fusion.contradictions(), 0);
  }
}

TEST(DepthFusion, BelievesAContradictionThatIsConfirmedAtOnce) {
  DepthPose pose = PoseAt(kPeriod_ns, Exp(50 * SmallStep()));
  EXPECT_FALSE(DepthFusion().Correct(pose, EstimateAt(Rigid3())));
  pose.confirmed = true;
  DepthFusion fusion;
  const auto correction = fusion.Correct(pose, EstimateAt(Rigid3()));
  ASSERT_TRUE(correction);
  EXPECT_GT(correction->moved.norm(), 0.9 * 50 * SmallStep().norm());
  EXPECT_EQ(fusion.contradictions(), 0);
}

TEST(DepthFusion, SaysByHowMuchAPoseThatItReplacesIsWorseThanStatedAndHowManyInARow) {
  DepthFusion fusion;
  const auto told = [&](int k, double times, bool confirmed) {
    DepthPose pose = PoseAt(k * kPeriod_ns, Exp(times * SmallStep()));
    pose.confirmed = confirmed;
    const auto correction = fusion.Correct(pose, EstimateAt(Rigid3()));
    return correction ? correction->widened : 0;
  };
  EXPECT_EQ(told(1, 1, false), 1);
  EXPECT_EQ(fusion.replacements(), 0);
  const double widened = told(2, 50, true);
  EXPECT_NEAR(widened, (50 * SmallStep()).squaredNorm() / 2e-6 / 16, 0.02 * widened);
  EXPECT_EQ(fusion.replacements(), 1);
  EXPECT_GT(told(3, 50, true), 1);
  EXPECT_EQ(fusion.replacements(), 2);
  EXPECT_EQ(told(4, -50, false), 0) << "not believed";
  EXPECT_EQ(fusion.replacements(), 0);
}

TEST(DepthFusion, BelievesNoneOfThoseThatContradictEachOtherToo) {
  DepthFusion fusion;
  for (int k = 1; k <= 12; ++k) {
    const double times = k % 3 == 0 ? -50 : 50;
    EXPECT_FALSE(fusion.Correct(PoseAt(k * kPeriod_ns, Exp(times * SmallStep())), EstimateAt(Rigid3())));
  }
  EXPECT_EQ(fusion.contradictions(), 12);
  // Nor those with one between them that agrees.
  for (int k = 13; k <= 24; ++k) {
    const bool agrees = k % 3 == 0;
    const Rigid3 T_world_event = agrees ? Rigid3() : Exp(50 * SmallStep());
    EXPECT_EQ(fusion.Correct(PoseAt(k * kPeriod_ns, T_world_event), EstimateAt(Rigid3())).has_value(), agrees) << k;
  }
}

TEST(DepthFusion, SeesMotionSinceATimeInTwoImagesOfThen) {
  const Rigid3 near = Exp(5 * SmallStep()), far = Exp(10 * SmallStep());
  DepthFusion fusion;
  fusion.Correct(PoseAt(1 * kPeriod_ns, far), EstimateAt(Rigid3()));
  fusion.Correct(PoseAt(3 * kPeriod_ns, Rigid3()), EstimateAt(Rigid3()));
  EXPECT_FALSE(fusion.SawMotionSince(2 * kPeriod_ns)) << "one image of then, whatever the one before shows";
  fusion.Correct(PoseAt(4 * kPeriod_ns, Exp(SmallStep())), EstimateAt(Rigid3()));
  EXPECT_FALSE(fusion.SawMotionSince(2 * kPeriod_ns)) << "within noise";
  fusion.Correct(OpenAlongX(PoseAt(5 * kPeriod_ns, Rigid3::Translation({0.1, 0, 0}))), EstimateAt(Rigid3()));
  EXPECT_FALSE(fusion.SawMotionSince(2 * kPeriod_ns)) << "in a direction that an image leaves open";
  fusion.Correct(PoseAt(6 * kPeriod_ns, near), EstimateAt(Rigid3()));
  EXPECT_TRUE(fusion.SawMotionSince(2 * kPeriod_ns));
  EXPECT_FALSE(fusion.SawMotionSince(5 * kPeriod_ns));
  fusion.Reset();
  EXPECT_FALSE(fusion.SawMotionSince(0));
}

TEST(DepthFusion, SeesMotionInTheDirectionsThatItKnowsWhereItLeavesOneOpen) {
  DepthFusion fusion;
  for (int k = 1; k <= 2; ++k) {
    fusion.Correct(OpenAlongX(PoseAt(k * kPeriod_ns, Rigid3::Translation({0, 0.01 * k, 0}))), EstimateAt(Rigid3()));
  }
  EXPECT_TRUE(fusion.SawMotionSince(0));
}

TEST(DepthFusion, TellsAnAgreementInAllDirectionsFromOneInPart) {
  DepthFusion fusion;
  EXPECT_FALSE(fusion.AgreedInPartWithin(1, kPeriod_ns));
  fusion.Correct(OpenAlongX(PoseAt(100 * kPeriod_ns, Rigid3())), EstimateAt(Rigid3()));
  EXPECT_TRUE(fusion.AgreedInPartWithin(0.1, 102 * kPeriod_ns));
  EXPECT_FALSE(fusion.AgreedInPartWithin(0.1, 110 * kPeriod_ns));
  EXPECT_FALSE(fusion.AgreedWithin(0.1, 102 * kPeriod_ns));
}

TEST(DepthFusion, TakesLittleMotionForASensorThatWarmsUp) {
  DepthFusion fusion;
  fusion.Correct(PoseAt(1 * kPeriod_ns, Rigid3(), 1e-5), EstimateAt(Rigid3()));
  fusion.Correct(PoseAt(2 * kPeriod_ns, Exp(2 * SmallStep()), 1e-5), EstimateAt(Rigid3()));
  EXPECT_FALSE(fusion.SawMotionSince(0));
}

TEST(DepthFusion, DoesNotMoveAlongDirectionsThatDepthLeavesOpen) {
  DepthPose pose = PoseAt(kPeriod_ns, Exp(SmallStep()));
  pose.information(0, 0) = 0;
  DepthFusion fusion;
  const auto correction = fusion.Correct(pose, EstimateAt(Rigid3()));
  ASSERT_TRUE(correction);
  EXPECT_LT(std::abs(correction->moved(0)), 1e-6);
  EXPECT_GT(std::abs(correction->moved(1)), 1e-4);
}

TEST(DepthFusion, AnImageThatLeavesADirectionOpenTellsNothingOfDelaysAndIsNeitherBelievedNorBlamed) {
  DepthFusion fusion;
  for (int k = 1; k <= 20; ++k) {
    DepthPose pose = PoseAt(k * kPeriod_ns, Exp((k % 2 ? 1 : -1) * SmallStep()));
    pose.per_delay = (k % 2 ? 1 : -1) * Vector6d::Constant(0.5);
    pose.information(0, 0) = 0;
    ASSERT_TRUE(fusion.Correct(pose, EstimateAt(Rigid3())));
  }
  EXPECT_EQ(fusion.delay().Get(0), 0);
  EXPECT_EQ(fusion.found_ns(), 0);
  DepthPose far = PoseAt(30 * kPeriod_ns, Exp(100 * SmallStep()));
  far.information(0, 0) = 0;
  EXPECT_FALSE(fusion.Correct(far, EstimateAt(Rigid3())));
  EXPECT_EQ(fusion.contradictions(), 0);
}

TEST(DepthFusion, AnImageThatLeavesADirectionOpenCorrectsADoubtfulPoseInTheOthers) {
  DepthFusion::Estimate estimate = EstimateAt(Rigid3());
  DepthPose far = PoseAt(kPeriod_ns, Exp(100 * SmallStep()));
  far.information(0, 0) = 0;
  EXPECT_FALSE(DepthFusion().Correct(far, estimate));
  estimate.doubtful = true;
  DepthFusion fusion;
  const auto correction = fusion.Correct(far, estimate);
  ASSERT_TRUE(correction);
  EXPECT_LT(correction->moved(0) / (100 * SmallStep()(0)), 1e-3);
  EXPECT_GT(correction->moved(1) / (100 * SmallStep()(1)), 0.9);
  EXPECT_EQ(fusion.found_ns(), 0);
  // One that knows all directions replaces such a pose, when there are more of them.
  EXPECT_FALSE(DepthFusion().Correct(PoseAt(kPeriod_ns, Exp(100 * SmallStep())), estimate));
}

TEST(DepthFusion, ImagesThatShareTheirErrorCountForLessTheSoonerTheyCome) {
  const auto moved = [](double shared_share, std::int64_t period_ns) {
    DepthFusion fusion;
    DepthFusion::Estimate estimate = EstimateAt(Rigid3());
    estimate.guided = true;
    DepthPose pose = PoseAt(0, Rigid3());
    pose.shared_share = shared_share;
    fusion.Correct(pose, estimate);
    pose.t_ns = period_ns;
    pose.T_world_event = Exp(SmallStep());
    return fusion.Correct(pose, estimate)->moved.norm() / SmallStep().norm();
  };
  EXPECT_NEAR(moved(0, 50'000'000), 0.5, 1e-3) << "noise is another in each image";
  EXPECT_NEAR(moved(1, 50'000'000), 1.0 / 11, 1e-3) << "ten images in the half second that errors last";
  EXPECT_NEAR(moved(0.5, 50'000'000), 1.0 / 6, 1e-3);
  EXPECT_NEAR(moved(1, 500'000'000), 0.5, 1e-3);
}

TEST(DepthFusion, StatesLargerErrorsTheLongerNoDepthHasAgreedUnlessAnInertialSensorGuides) {
  DepthFusion fusion;
  fusion.Correct(PoseAt(kPeriod_ns, Rigid3()), EstimateAt(Rigid3()));
  const auto growth = [&fusion](int periods, bool guided = false) {
    return fusion.VarianceScale((1 + periods) * kPeriod_ns, guided) / fusion.VarianceScale(kPeriod_ns, guided);
  };
  EXPECT_EQ(growth(0), 1);
  EXPECT_GT(growth(30), 1.5);
  EXPECT_EQ(growth(30, true), 1) << "what is stated grows by itself as far as the sensor lets it";
  EXPECT_EQ(growth(1000), growth(100)) << "bounded, however long it is missing";
  const double never = DepthFusion().VarianceScale(1000 * kPeriod_ns, false);
  EXPECT_NEAR(never, fusion.VarianceScale(1000 * kPeriod_ns, false), 1e-12)
      << "none has agreed yet: as after a long gap";
  EXPECT_EQ(fusion.VarianceScale(0, false), fusion.VarianceScale(kPeriod_ns, false)) << "of a pose before the image";
}

TEST(DepthFusion, StatesSmallerErrorsOfGuidedPosesTheMoreSeldomDepthComes) {
  const auto stated = [](std::int64_t period_ns) {
    DepthFusion fusion;
    // Such say nothing of how events and depth come apart.
    for (int k = 1; k <= 200; ++k) fusion.Correct(OpenAlongX(PoseAt(k * period_ns, Rigid3())), EstimateAt(Rigid3()));
    return fusion.VarianceScale(200 * period_ns, true);
  };
  EXPECT_NEAR(stated(33'000'000) / stated(200'000'000), 1, 1e-9) << "what many images err alike is in their weight";
  EXPECT_NEAR(stated(200'000'000) / stated(1'000'000'000), std::pow(5, 0.2), 0.02);
  EXPECT_EQ(stated(1'000'000'000), stated(3'000'000'000)) << "a gap is no rate";
}

TEST(DepthFusion, StatesLargerErrorsWhereEventsAndDepthComeApartMore) {
  const auto scale = [](double step) {
    DepthFusion fusion;
    for (int k = 1; k < 100; ++k) {
      const Rigid3 T_world_event = Exp((k % 2 ? step : -step) * SmallStep());
      fusion.Correct(PoseAt(k * kPeriod_ns, T_world_event), EstimateAt(Rigid3()));
    }
    return fusion.VarianceScale(100 * kPeriod_ns, true);
  };
  EXPECT_GT(scale(2), 1.5 * scale(1));
  EXPECT_LT(scale(2), 2.5 * scale(1)) << "few moments: half of what they say, as a power";
}

TEST(DepthFusion, BoundsAPoseByTheLastImageThatAgreedLessAndLessAndNotWhereItLeftADirectionOpen) {
  DepthFusion fusion;
  EXPECT_EQ(fusion.BoundAt(kPeriod_ns).norm(), 0) << "no image yet";
  DepthPose along_a_wall = PoseAt(kPeriod_ns, Rigid3());
  along_a_wall.information(0, 0) = along_a_wall.information(4, 4) = 0;
  ASSERT_TRUE(fusion.Correct(along_a_wall, EstimateAt(Rigid3())));
  const Vector6d soon = fusion.BoundAt(kPeriod_ns + 50'000'000).diagonal();
  const Vector6d known = (Vector6d() << 0, 1, 1, 1, 0, 1).finished();
  EXPECT_LT((soon - known / (0.05 * 0.05)).norm(), 1e-6) << "a metre and a radian per second";
  const Vector6d later = fusion.BoundAt(kPeriod_ns + 500'000'000).diagonal();
  EXPECT_LT((later - 0.01 * soon).norm(), 1e-6);
  // One that contradicts bounds nothing.
  ASSERT_FALSE(fusion.Correct(PoseAt(17 * kPeriod_ns, Exp(100 * SmallStep())), EstimateAt(Rigid3())));
  EXPECT_NEAR(fusion.BoundAt(kPeriod_ns + 500'000'000)(1, 1), later(1), 1e-6);
}

TEST(DepthFusion, ImagesThatFollowEachOtherSoonCountForLess) {
  DepthFusion fusion;
  const double first = fusion.Correct(PoseAt(kPeriod_ns, Rigid3()), EstimateAt(Rigid3()))->information(0, 0);
  const double soon = fusion.Correct(PoseAt(2 * kPeriod_ns, Rigid3()), EstimateAt(Rigid3()))->information(0, 0);
  const double late = fusion.Correct(PoseAt(20 * kPeriod_ns, Rigid3()), EstimateAt(Rigid3()))->information(0, 0);
  EXPECT_LT(soon, 0.5 * first);
  EXPECT_NEAR(late, first, 1e-6 * first);
}

TEST(DepthFusion, ContradictionsAreCountedInARowAndMoveNothing) {
  const Rigid3 elsewhere = Rigid3::Translation({0.05, 0, 0});
  DepthFusion fusion;
  EXPECT_FALSE(fusion.Correct(PoseAt(1 * kPeriod_ns, elsewhere), EstimateAt(Rigid3())));
  EXPECT_FALSE(fusion.Correct(PoseAt(2 * kPeriod_ns, elsewhere * elsewhere), EstimateAt(Rigid3())));
  EXPECT_EQ(fusion.contradictions(), 2);
  EXPECT_EQ(fusion.found_ns(), 0);
  EXPECT_NEAR(fusion.velocity_event().x(), 0.05 / 0.033, 1e-6);
  EXPECT_TRUE(fusion.Correct(PoseAt(3 * kPeriod_ns, Rigid3()), EstimateAt(Rigid3())));
  EXPECT_EQ(fusion.contradictions(), 0);
  EXPECT_EQ(fusion.found_ns(), 3 * kPeriod_ns);
}

TEST(DepthFusion, LearnsByHowMuchDepthImagesAreLate) {
  const double late_s = 0.015;
  DepthFusion fusion;
  for (int k = 1; k <= 200; ++k) {
    const double t_s = 0.033 * k;
    const Vector6d velocity = std::cos(3 * t_s) * (Vector6d() << 0.4, 0.1, -0.2, 0.3, -0.5, 0.1).finished();
    DepthPose pose = PoseAt(k * kPeriod_ns, Exp((late_s - fusion.delay().Get(0)) * velocity));
    pose.per_delay = velocity;
    EXPECT_TRUE(fusion.Correct(pose, EstimateAt(Rigid3()))) << k;
  }
  EXPECT_NEAR(fusion.delay().Get(0), late_s, 1e-3);
}

TEST(DepthFusion, LearnsNoDelayFromAPoseThatWasFalse) {
  const Vector6d velocity = (Vector6d() << 0.4, 0.1, -0.2, 1.5, -1, 0.1).finished();
  DepthPose pose = PoseAt(kPeriod_ns, Exp(0.08 * velocity));
  pose.per_delay = velocity;
  pose.confirmed = true;
  DepthFusion fusion;
  const auto correction = fusion.Correct(pose, EstimateAt(Rigid3()));
  ASSERT_TRUE(correction);
  EXPECT_GT(correction->widened, 1);
  EXPECT_EQ(fusion.delay().Get(0), 0);
}

TEST(DepthFusion, LearnsAClearDelayFromTheFirstImagesAndDoesNotMoveThePoseForIt) {
  const double late_s = 0.01;
  DepthFusion fusion;
  double moved_rad = 0;
  for (int k = 1; k <= 3; ++k) {
    const Vector6d velocity = (k % 2 ? 1 : -1) * (Vector6d() << 0.4, 0.1, -0.2, 1.5, -1, 0.1).finished();
    DepthPose pose = PoseAt(6 * k * kPeriod_ns, Exp((late_s - fusion.delay().Get(0)) * velocity));
    pose.per_delay = velocity;
    const auto correction = fusion.Correct(pose, EstimateAt(Rigid3()));
    ASSERT_TRUE(correction) << k;
    moved_rad = std::max(moved_rad, correction->moved.tail<3>().norm());
  }
  EXPECT_NEAR(fusion.delay().Get(0), late_s, 5e-4);
  EXPECT_LT(moved_rad, 0.1 * late_s * 1.8);
}

}  // namespace
}  // namespace devo
