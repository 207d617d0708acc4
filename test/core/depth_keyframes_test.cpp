// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/depth_keyframes.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

#include "depth_scene.h"

namespace devo {
namespace {

Rig DepthRig() {
  Rig rig;
  rig.depth_camera = DepthSceneCamera();
  rig.T_event_depth = Exp((Vector6d() << 0.05, -0.02, 0.01, 0.02, 0.05, -0.03).finished());
  return rig;
}

DepthImage ImageAt(const Rigid3& T_world_event, double sigma_m = 0.003, DepthScene scene = DepthScene::kRoom) {
  static unsigned seed = 0;
  return {0, DepthSeen(T_world_event * DepthRig().T_event_depth, sigma_m, scene, ++seed)};
}

DepthKeyframes::View ViewAt(const Rigid3& T_world_event) {
  DepthKeyframes::View view;
  view.T_world_event = T_world_event;
  view.trusted = true;
  return view;
}

Rigid3 Turned(double angle_rad) { return Rigid3::Rotation(ExpSO3({0, angle_rad, 0})); }

TEST(DepthKeyframes, ThePoseOfTheEventCameraIsFoundBesideItsPrediction) {
  DepthKeyframes keyframes(DepthRig());
  EXPECT_FALSE(keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()))) << "there is nothing to align the first to";
  const Rigid3 truth = Exp((Vector6d() << 0.02, 0.01, -0.03, 0.01, -0.02, 0.01).finished());
  const auto pose = keyframes.Align(ImageAt(truth), ViewAt(Rigid3::Translation({0.01, 0, 0})));
  ASSERT_TRUE(pose);
  EXPECT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 2e-3);
  EXPECT_GT(pose->information.diagonal().minCoeff(), 1e4);
  EXPECT_EQ(keyframes.size(), 1U);
}

TEST(DepthKeyframes, AContradictionIsConfirmedWhereAlignmentsFromBothSidesEndAtOnePlace) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
  DepthKeyframes::View view = ViewAt(Rigid3::Translation({0.03, 0.01, 0}));
  view.covariance = std::pow(0.001, 2) * Matrix6d::Identity();
  const auto contradicts = keyframes.Align(ImageAt(Rigid3()), view);
  ASSERT_TRUE(contradicts);
  EXPECT_TRUE(contradicts->confirmed);
  view.T_world_event = Rigid3();
  const auto agrees = keyframes.Align(ImageAt(Rigid3()), view);
  ASSERT_TRUE(agrees);
  EXPECT_FALSE(agrees->confirmed) << "there is nothing to confirm";
}

TEST(DepthKeyframes, APoseThatAgreesIsConfirmedAsWellWhereTrackingAsksForIt) {
  MappingOptions options;
  options.ideas.doubt_things = false;  // the corner that shows the way is one
  DepthKeyframes keyframes(DepthRig(), options);
  keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
  DepthKeyframes::View view = ViewAt(Rigid3::Translation({0.01, 0.005, 0}));
  view.covariance = std::pow(0.02, 2) * Matrix6d::Identity();
  const auto unasked = keyframes.Align(ImageAt(Rigid3()), view);
  ASSERT_TRUE(unasked);
  EXPECT_FALSE(unasked->confirmed);
  view.doubtful_from = 0;
  const auto asked = keyframes.Align(ImageAt(Rigid3()), view);
  ASSERT_TRUE(asked);
  EXPECT_TRUE(asked->confirmed);
}

DepthKeyframes::View SureViewAt(const Rigid3& T_world_event) {
  DepthKeyframes::View view = ViewAt(T_world_event);
  view.covariance = std::pow(0.003, 2) * Matrix6d::Identity();
  return view;
}

TEST(DepthKeyframes, AThingThatMovesByItselfDoesNotMoveTheCamera) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kBoxBeforeWall), SureViewAt(Rigid3()));
  const DepthKeyframes::View view = SureViewAt(Rigid3());
  const auto pose = keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kBoxPushed), view);
  ASSERT_TRUE(pose);
  EXPECT_FALSE(pose->KnowsAllDirections()) << "only the box showed how far the camera went to the side";
  EXPECT_FALSE(pose->confirmed);
  EXPECT_LT(Log(Corrected(Rigid3(), view.covariance, *pose)).norm(), 2e-3);
  EXPECT_EQ(keyframes.without_things(), 1U);
}

TEST(DepthKeyframes, AThingThatStandsTellsOfTheCameraAsLongAsEventsAgree) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3(), 0, DepthScene::kBoxBeforeWall), SureViewAt(Rigid3()));
  const Rigid3 truth = Rigid3::Translation({0.04, 0, 0});
  const auto pose = keyframes.Align(ImageAt(truth, 0, DepthScene::kBoxBeforeWall),
                                    SureViewAt(truth * Rigid3::Translation({0.003, 0, 0})));
  ASSERT_TRUE(pose);
  EXPECT_TRUE(pose->KnowsAllDirections());
  EXPECT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 2e-3);
  EXPECT_EQ(keyframes.without_things(), 0U);
}

TEST(DepthKeyframes, ALostCameraIsFoundByTheOneThingInViewAsWell) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3(), 0, DepthScene::kBoxBeforeWall), SureViewAt(Rigid3()));
  DepthKeyframes::View view = SureViewAt(Rigid3::Translation({0.02, 0, 0}));
  view.lost = true;
  const auto pose = keyframes.Align(ImageAt(Rigid3(), 0, DepthScene::kBoxBeforeWall), view);
  ASSERT_TRUE(pose);
  EXPECT_TRUE(pose->confirmed);
  EXPECT_LT(Log(pose->T_world_event).norm(), 2e-3);
}

TEST(DepthKeyframes, APoseThatIsDecimetresOffIsFoundAndConfirmed) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
  const Rigid3 truth = Turned(-0.1) * Rigid3::Translation({0.05, 0.02, 0});
  DepthKeyframes::View view = ViewAt(truth * Exp((Vector6d() << 0.05, 0.02, 0.15, 0.01, 0.02, 0.02).finished()));
  view.covariance = std::pow(0.01, 2) * Matrix6d::Identity();
  const auto pose = keyframes.Align(ImageAt(truth), view);
  ASSERT_TRUE(pose);
  EXPECT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 5e-3);
  EXPECT_TRUE(pose->confirmed);
}

TEST(DepthKeyframes, APoseOfALostCameraIsFoundHoweverSureItsFalseOneIs) {
  const Rigid3 truth = Turned(-0.1) * Rigid3::Translation({0.05, 0.02, 0});
  const Rigid3 half_a_metre_off = truth * Rigid3::Translation({0.3, 0.1, 0.35});
  const Rigid3 anywhere = truth * Rigid3::Rotation(ExpSO3({0, 2, 0.5})) * Rigid3::Translation({3, 0, 1});
  for (const bool turn_known : {true, false}) {
    DepthKeyframes keyframes(DepthRig());
    keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kFurnishedRoom), ViewAt(Rigid3()));
    DepthKeyframes::View view = ViewAt(turn_known ? half_a_metre_off : anywhere);
    view.trusted = false;
    view.lost = true;
    view.turn_known = turn_known;
    view.covariance = std::pow(turn_known ? 0.2 : 0.01, 2) * Matrix6d::Identity();
    DepthImage image = ImageAt(truth, 0.003, DepthScene::kFurnishedRoom);
    image.t_ns = 1'000'000'000;
    const auto pose = keyframes.Align(image, view);
    ASSERT_TRUE(pose) << turn_known;
    EXPECT_TRUE(pose->confirmed) << turn_known;
    EXPECT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 5e-3) << turn_known;
  }
}

TEST(DepthKeyframes, ALostCameraIsSearchedForAgainAfterTimeWentBack) {
  DepthKeyframes keyframes(DepthRig());
  DepthKeyframes::View lost = ViewAt(Rigid3::Translation({0.3, 0.1, 0.35}));
  lost.trusted = false;
  lost.lost = lost.turn_known = true;
  lost.covariance = std::pow(0.2, 2) * Matrix6d::Identity();
  for (const std::int64_t t_s : {10, 1}) {
    keyframes.Clear();
    keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kFurnishedRoom), ViewAt(Rigid3()));
    DepthImage image = ImageAt(Rigid3(), 0.003, DepthScene::kFurnishedRoom);
    image.t_ns = t_s * 1'000'000'000;
    EXPECT_TRUE(keyframes.Align(image, lost)) << t_s;
  }
}

TEST(DepthKeyframes, OfALostCameraNothingIsSaidThatIsNotConfirmed) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kWall), ViewAt(Rigid3()));
  DepthKeyframes::View view = ViewAt(Rigid3());
  view.covariance = Matrix6d::Identity();
  for (const bool lost : {false, true}) {
    view.lost = lost;
    EXPECT_EQ(keyframes.Align(ImageAt(Rigid3(), 0.003, DepthScene::kWall), view).has_value(), !lost);
  }
}

TEST(DepthKeyframes, AViewThatReturnsMeetsItsFirstKeyframeAndDoesNotDrift) {
  DepthKeyframes keyframes(DepthRig());
  // Tracking is 2 mm farther off with each step; each new keyframe takes that over.
  const auto off = [](int step) { return Rigid3::Translation({0.002 * step, 0, 0}); };
  int step = 0;
  for (const double angle : {0.0, 0.15, 0.3, 0.45, 0.6, 0.45, 0.3, 0.15}) {
    keyframes.Align(ImageAt(Turned(angle)), ViewAt(Turned(angle) * off(step++)));
  }
  EXPECT_GT(keyframes.size(), 1U);
  const std::size_t before = keyframes.size();
  const auto pose = keyframes.Align(ImageAt(Rigid3()), ViewAt(off(step)));
  ASSERT_TRUE(pose);
  EXPECT_LT(Log(pose->T_world_event).norm(), 3e-3);
  EXPECT_EQ(keyframes.size(), before);
}

TEST(DepthKeyframes, AKeyframeIsKeptWhereItsDepthSaysAsFarAsTrackingIsUnsure) {
  const Rigid3 truth = Turned(0.3), tracked = truth * Rigid3::Translation({0.01, 0, 0});
  for (const bool unsure : {false, true}) {
    DepthKeyframes keyframes(DepthRig());
    keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
    DepthKeyframes::View view = ViewAt(tracked);
    if (unsure) view.covariance = std::pow(0.05, 2) * Matrix6d::Identity();
    keyframes.Align(ImageAt(truth), view);
    ASSERT_EQ(keyframes.size(), 2U);
    const auto pose = keyframes.Align(ImageAt(truth), ViewAt(truth));
    ASSERT_TRUE(pose);
    const double from_truth = Log(truth.inverse() * pose->T_world_event).norm();
    if (unsure) {
      EXPECT_LT(from_truth, 4e-3);
    } else {
      EXPECT_NEAR(from_truth, 0.01, 1e-3);
    }
  }
}

TEST(DepthKeyframes, AViewNearItsKeyframeIsKnownBetterThanOneFartherOff) {
  const auto information_at = [](double angle_rad) {
    DepthKeyframes keyframes(DepthRig());
    keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
    const auto pose = keyframes.Align(ImageAt(Turned(angle_rad)), ViewAt(Turned(angle_rad)));
    EXPECT_EQ(keyframes.size(), 1U);
    return pose.value().information.trace();
  };
  EXPECT_GT(information_at(0.01), 2 * information_at(0.15));
}

TEST(DepthKeyframes, ADepthCameraIsBelievedByWhatItsImagesLeaveUnlessThatIsNotLearnt) {
  const auto last_of_ten = [](bool learn) {
    MappingOptions options;
    options.ideas.learn_depth_errors = learn;
    DepthKeyframes keyframes(DepthRig(), options);
    std::optional<DepthPose> pose;
    for (int k = 0; k <= 10; ++k) pose = keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
    return pose.value();
  };
  const DepthPose learnt = last_of_ten(true), usual = last_of_ten(false);
  EXPECT_GT(learnt.information.trace(), 2 * usual.information.trace()) << "images with nothing but noise";
  EXPECT_LT(learnt.shared_share, usual.shared_share - 0.2);
}

TEST(DepthKeyframes, ToTheFirstMapsImageOthersAreAlignedWithItsUncertaintyUntilOneTakesThePlaceOfAStandIn) {
  const Rigid3 next = Exp((Vector6d() << 0.02, 0.01, -0.03, 0.01, -0.02, 0.01).finished());
  for (const bool stand_in : {false, true}) {
    DepthKeyframes keyframes(DepthRig());
    keyframes.KeepFirst(ImageAt(Rigid3()), ViewAt(Rigid3()), stand_in);
    DepthKeyframes::View view = ViewAt(next);
    view.covariance = 1e-6 * Matrix6d::Identity();
    const auto to_first = keyframes.Align(ImageAt(next), view);
    ASSERT_TRUE(to_first);
    EXPECT_LT(Log(next.inverse() * to_first->T_world_event).norm(), 2e-3);
    constexpr double kFirst_m = 5e-3;
    EXPECT_LT(to_first->information.diagonal().maxCoeff(), 1 / (kFirst_m * kFirst_m));
    EXPECT_EQ(keyframes.size(), 1U);
    const auto again = keyframes.Align(ImageAt(next), view);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->information.diagonal().minCoeff() > 1 / (kFirst_m * kFirst_m), stand_in);
  }
}

TEST(DepthKeyframes, AWallTellsNothingOfTheDirectionsAlongIt) {
  for (const DepthScene scene : {DepthScene::kWall, DepthScene::kRoom}) {
    DepthKeyframes keyframes(DepthRig());
    keyframes.Align(ImageAt(Rigid3(), 0.002, scene), ViewAt(Rigid3()));
    const auto pose = keyframes.Align(ImageAt(Rigid3::Translation({0.01, 0, 0.01}), 0.002, scene), ViewAt(Rigid3()));
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->KnowsAllDirections(), scene == DepthScene::kRoom);
    EXPECT_NEAR(pose->T_world_event.translation().z(), 0.01, 2e-3) << "towards it";
    if (scene == DepthScene::kRoom) continue;
    const auto values = Eigen::SelfAdjointEigenSolver<Matrix6d>(pose->information).eigenvalues();
    EXPECT_LT(std::abs(values(2)), 1e-6 * values(5)) << "two shifts and a turn";
    EXPECT_GT(values(3), 1e4);
  }
}

TEST(DepthKeyframes, AnImageOfAnUncertainPoseIsNotKept) {
  DepthKeyframes keyframes(DepthRig());
  DepthKeyframes::View view = ViewAt(Rigid3());
  view.trusted = false;
  EXPECT_FALSE(keyframes.Align(ImageAt(Rigid3()), view));
  EXPECT_EQ(keyframes.size(), 0U);
}

TEST(DepthKeyframes, ReadingsOutsideTheRangeOfMeasurementsDoNotSayThatTheCameraStands) {
  MappingOptions options;
  options.max_depth_m = 4;
  const Rigid3 truth = Rigid3::Translation({0.03, 0.01, -0.02});
  // What many a driver writes where nothing came back moves with the camera, and fills most of this image.
  const auto with_ghost = [](DepthImage image) {
    for (int y = 0; y < image.depth_m.rows; ++y) {
      for (int x = 0; x < image.depth_m.cols / 2; ++x) image.depth_m(y, x) = y < 120 ? 8 : 7;
    }
    return image;
  };
  DepthKeyframes keyframes(DepthRig(), options);
  keyframes.Align(with_ghost(ImageAt(Rigid3())), ViewAt(Rigid3()));
  const auto pose = keyframes.Align(with_ghost(ImageAt(truth)), ViewAt(Rigid3::Translation({0.01, 0, 0})));
  ASSERT_TRUE(pose);
  EXPECT_LT(Log(truth.inverse() * pose->T_world_event).norm(), 5e-3);

  options.max_depth_m = 0.2;
  keyframes.SetOptions(options);
  EXPECT_FALSE(keyframes.Align(with_ghost(ImageAt(truth)), ViewAt(truth))) << "nothing is a measurement any more";
}

TEST(DepthKeyframes, AKeyframeOfAnotherChapterIsNotMet) {
  DepthKeyframes keyframes(DepthRig());
  keyframes.Align(ImageAt(Rigid3()), ViewAt(Rigid3()));
  DepthKeyframes::View view = ViewAt(Rigid3());
  view.chapter = 1;
  EXPECT_FALSE(keyframes.Align(ImageAt(Rigid3()), view));
}

TEST(DepthKeyframes, WhereTheDepthCameraBeginsToSeeOtherwiseItIsFollowedFromThere) {
  DepthKeyframes keyframes(DepthRig());
  const Rigid3 otherwise = Exp((Vector6d() << -0.014, 0, 0, 0, 0.015, 0).finished());
  double worst = 0;
  int held_back = 0;
  for (int i = 0; i < 20; ++i) {
    const Rigid3 truth = Rigid3::Translation({0.002 * i, 0, 0});
    DepthImage image = ImageAt(i < 10 ? truth : truth * otherwise);
    image.t_ns = 33'000'000 * i;
    const auto pose = keyframes.Align(image, ViewAt(truth));
    if (!pose) ++held_back;
    if (pose) worst = std::max(worst, Log(truth.inverse() * pose->T_world_event).norm());
  }
  EXPECT_EQ(keyframes.jumps(), 1U);
  EXPECT_EQ(held_back, 3) << "the first, the doubtful one and the new keyframe";
  EXPECT_LT(worst, 4e-3);
}

TEST(DepthKeyframes, WhatADelayDoesIsTheDerivativeOfTheStatedPose) {
  Vector6d at_keyframe, now;
  at_keyframe << 0.3, 0.1, -0.2, 0.2, -0.1, 0.3;
  now << -0.2, 0.4, 0.1, -0.3, 0.2, 0.1;
  const Rigid3 T_key = Rigid3(), T_now = Exp((Vector6d() << 0.03, 0.02, -0.02, 0.01, 0.02, -0.02).finished());
  // Images are late by this: what they show happened when the camera was elsewhere.
  const double late_s = 0.01;
  DepthKeyframes keyframes(DepthRig());
  DepthKeyframes::View view = ViewAt(T_key);
  view.velocity_event = at_keyframe;
  keyframes.Align(ImageAt(T_key * Exp(at_keyframe * late_s), 0), view);
  view = ViewAt(T_now);
  view.velocity_event = now;
  const auto pose = keyframes.Align(ImageAt(T_now * Exp(now * late_s), 0), view);
  ASSERT_TRUE(pose);
  const Vector6d seen = Log(T_now.inverse() * pose->T_world_event);
  EXPECT_LT((seen - late_s * pose->per_delay).norm(), 1e-3) << seen.transpose();
  EXPECT_GT(seen.norm(), 5e-3);
}

}  // namespace
}  // namespace devo
