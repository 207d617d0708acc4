// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_filter.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <string>

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "devo/core/time.h"
#include "most_probable.h"

namespace devo {
namespace {

constexpr std::int64_t kPeriod_ns = 10'000'000;

Vector6d Twist() {
  Vector6d twist;
  twist << 0.4, -0.2, 0.1, 0.3, -0.5, 0.2;
  return twist;
}

Rigid3 TrueAt(std::int64_t t_ns) { return Exp(Twist() * SecondsFromNs(t_ns)); }

/// Knows a motion of constant velocity from 100 poses, each measured to a tenth of a millimetre and milliradian.
MotionFilter Moving() {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, TrueAt(0));
  for (int k = 1; k <= 100; ++k) filter.Update(k * kPeriod_ns, TrueAt(k * kPeriod_ns), 1e8 * Matrix6d::Identity());
  return filter;
}

TEST(MotionFilter, StartsAtRest) {
  MotionFilter filter{TrackingOptions()};
  EXPECT_FALSE(filter.started());
  filter.Start(5, TrueAt(7));
  EXPECT_TRUE(filter.started());
  const auto prediction = filter.Predict(5 + kPeriod_ns);
  EXPECT_EQ(prediction.velocity_event, Vector6d(Vector6d::Zero()));
  EXPECT_LT(Log(TrueAt(7).inverse() * prediction.T_world_event).norm(), 1e-12);
}

TEST(MotionFilter, LearnsAConstantVelocity) {
  const MotionFilter filter = Moving();
  const std::int64_t next_ns = filter.time_ns() + kPeriod_ns;
  const auto prediction = filter.Predict(next_ns);
  EXPECT_LT((prediction.velocity_event - Twist()).norm(), 0.005);
  EXPECT_LT(Log(TrueAt(next_ns).inverse() * prediction.T_world_event).norm(), 1e-4);
}

TEST(MotionFilter, PredictsWithACovarianceThatGrowsWithTime) {
  const MotionFilter filter = Moving();
  Matrix6d before = filter.pose_covariance();
  for (const int periods : {1, 2, 5, 10, 30}) {
    const Matrix6d after = filter.Predict(filter.time_ns() + periods * kPeriod_ns).covariance;
    for (int i = 0; i < 6; ++i) EXPECT_GT(after(i, i), before(i, i)) << periods << " periods, direction " << i;
    before = after;
  }
}

/// How far a camera may be from where it is predicted to be, 0.1 s after it moved as `pose_at` says for two seconds.
double SpreadAfter(const std::function<Rigid3(std::int64_t)>& pose_at, bool calm_motion = true) {
  TrackingOptions options;
  options.ideas.calm_motion = calm_motion;
  MotionFilter filter{options};
  filter.Start(0, pose_at(0));
  for (int k = 1; k <= 200; ++k) filter.Update(k * kPeriod_ns, pose_at(k * kPeriod_ns), 1e6 * Matrix6d::Identity());
  return std::sqrt(filter.Predict(210 * kPeriod_ns).covariance.topLeftCorner<3, 3>().trace());
}

/// A quarter of a second forth, as long back.
std::function<Rigid3(std::int64_t)> Shaken(double amplitude) {
  return [amplitude](std::int64_t t_ns) {
    return Exp(amplitude * std::sin(2 * M_PI * 2 * SecondsFromNs(t_ns)) * Twist());
  };
}

TEST(MotionFilter, PredictsACalmMotionMoreSurelyThanALivelyOne) {
  const auto lively = Shaken(0.03);
  EXPECT_LT(SpreadAfter(TrueAt), 0.4 * SpreadAfter(lively));
  EXPECT_LT(SpreadAfter(TrueAt), 0.4 * SpreadAfter(TrueAt, false));
  EXPECT_NEAR(SpreadAfter(lively), SpreadAfter(lively, false), 0.1 * SpreadAfter(lively));
}

TEST(MotionFilter, PredictsAMotionThatIsLivelierThanOptionsSayLessSurely) {
  EXPECT_GT(SpreadAfter(Shaken(0.3)), 1.5 * SpreadAfter(Shaken(0.3), false));
}

TEST(MotionFilter, LagsLessBehindAMotionThatIsLivelierThanOptionsSay) {
  const auto lag = [](bool calm_motion) {
    TrackingOptions options;
    options.ideas.calm_motion = calm_motion;
    MotionFilter filter{options};
    const auto pose_at = Shaken(0.3);
    filter.Start(0, pose_at(0));
    double worst = 0;
    for (int k = 1; k <= 200; ++k) {
      filter.Update(k * kPeriod_ns, {pose_at(k * kPeriod_ns), 3e4 * Matrix6d::Identity(), Vector6d::Zero(), 0, 1});
      if (k > 100) worst = std::max(worst, Log(filter.pose().inverse() * pose_at(k * kPeriod_ns)).norm());
    }
    return worst;
  };
  EXPECT_LT(lag(true), 0.7 * lag(false));
}

TEST(MotionFilter, FollowsAMotionThatTurnsRoundAfterItWasCalm) {
  const auto turned_at = [](std::int64_t t_ns) {
    return t_ns <= 100 * kPeriod_ns ? TrueAt(t_ns) : TrueAt(100 * kPeriod_ns) * TrueAt(100 * kPeriod_ns - t_ns);
  };
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, turned_at(0));
  for (int k = 1; k <= 105; ++k) filter.Update(k * kPeriod_ns, turned_at(k * kPeriod_ns), 1e8 * Matrix6d::Identity());
  EXPECT_LT((filter.velocity_event() + Twist()).norm(), 0.05) << "50 ms after it";
}

TEST(MotionFilter, PredictsWithoutChangingItself) {
  const MotionFilter filter = Moving();
  const auto first = filter.Predict(filter.time_ns() + kPeriod_ns);
  filter.Predict(filter.time_ns() + 100 * kPeriod_ns);
  EXPECT_EQ(filter.Predict(filter.time_ns() + kPeriod_ns).covariance, first.covariance);
}

TEST(MotionFilter, AddsTheInformationOfAMeasurementToThatOfThePrediction) {
  MotionFilter filter = Moving();
  const std::int64_t t_ns = filter.time_ns() + kPeriod_ns;
  const auto prediction = filter.Predict(t_ns);
  Matrix6d information = Matrix6d::Zero();
  information.diagonal() << 1e6, 0, 1e5, 1e6, 0, 1e7;
  filter.Update(t_ns, prediction.T_world_event, information);
  const Matrix6d expected = (prediction.covariance.inverse() + information).inverse();
  EXPECT_LT((filter.pose_covariance() - expected).norm(), 1e-6 * expected.norm());
}

TEST(MotionFilter, TakesAPoseWithoutInformationForWhatItIsThePrediction) {
  MotionFilter filter = Moving();
  const std::int64_t t_ns = filter.time_ns() + kPeriod_ns;
  const auto prediction = filter.Predict(t_ns);
  filter.Update(t_ns, prediction.T_world_event, Matrix6d::Zero());
  EXPECT_LT((filter.pose_covariance() - prediction.covariance).norm(), 1e-6 * prediction.covariance.norm());
  EXPECT_LT((filter.Predict(t_ns).velocity_event - prediction.velocity_event).norm(), 1e-9);
}

TEST(MotionFilter, HasThePoseThatItWasUpdatedWith) {
  MotionFilter filter = Moving();
  const std::int64_t t_ns = filter.time_ns() + kPeriod_ns;
  const Rigid3 measured = TrueAt(t_ns) * Exp(0.001 * Vector6d::Ones());
  filter.Update(t_ns, measured, 1e4 * Matrix6d::Identity());
  EXPECT_EQ(filter.time_ns(), t_ns);
  EXPECT_LT(Log(measured.inverse() * filter.pose()).norm(), 1e-12);
}

TEST(MotionFilter, KeepsItsCovarianceSymmetricAndPositiveOverManyPartialUpdates) {
  MotionFilter filter = Moving();
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int k = 101; k <= 1100; ++k) {
    // One direction is measured at a time, another one in every step.
    const Vector6d direction = Vector6d::NullaryExpr([&] { return normal(random); }).normalized();
    filter.Update(k * kPeriod_ns, filter.Predict(k * kPeriod_ns).T_world_event,
                  1e7 * direction * direction.transpose());
  }
  const Matrix6d P = filter.pose_covariance();
  EXPECT_EQ(P, Matrix6d(P.transpose()));
  EXPECT_GT(P.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0);
}

/// Of alignments that all err alike by `off`, each to a millimetre and milliradian: what the filter makes of it after a
/// second, where `shared` times that variance is known to be shared.
MotionFilter AlignedWith(const Vector6d& off, double shared) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, TrueAt(0), Twist());
  const Matrix6d information = 1e6 * Matrix6d::Identity();
  for (int k = 1; k <= 100; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    const auto predicted = filter.Predict(t_ns);
    const Rigid3 found = MostProbable(predicted, TrueAt(t_ns) * Exp(off), information);
    filter.Update(t_ns, MotionFilter::LikelihoodOf(predicted, found, information, shared, 1));
  }
  return filter;
}

TEST(MotionFilter, IsNotMadeCertainByAlignmentsThatErrAlike) {
  const double alike = AlignedWith(Vector6d::Zero(), 4).pose_covariance().trace();
  const double apart = AlignedWith(Vector6d::Zero(), 0).pose_covariance().trace();
  EXPECT_GT(alike, 5 * apart);
  EXPECT_LT(alike, 6 * 5e-6) << "nor less certain than by one of them";
}

TEST(MotionFilter, TakesWhatAlignmentsErrAlikeForNoVelocityOnceThePoseIsKnown) {
  const Vector6d off = 2e-3 * Vector6d::Ones();
  const auto error_of_velocity = [&off](double shared) {
    MotionFilter filter = AlignedWith(off, shared);
    filter.Update(filter.time_ns(), TrueAt(filter.time_ns()), 1e8 * Matrix6d::Identity());
    EXPECT_LT(Log(TrueAt(filter.time_ns()).inverse() * filter.pose()).norm(), 0.1 * off.norm());
    return (filter.velocity_event() - Twist()).norm();
  };
  EXPECT_LT(error_of_velocity(4), 0.5 * error_of_velocity(0));
}

TEST(MotionFilter, ExpectsTheNextAlignmentWhereTheOnesBeforeErred) {
  const Vector6d off = 2e-3 * Vector6d::Ones();
  MotionFilter filter = AlignedWith(off, 4);
  filter.Update(filter.time_ns(), TrueAt(filter.time_ns()), 1e8 * Matrix6d::Identity());
  const auto next = filter.Predict(filter.time_ns() + kPeriod_ns);
  const Rigid3 truth = TrueAt(filter.time_ns() + kPeriod_ns);
  EXPECT_LT(Log((truth * Exp(off)).inverse() * next.T_world_aligned).norm(), 0.4 * off.norm());
  EXPECT_LT(Log(truth.inverse() * next.T_world_event).norm(), 0.2 * off.norm());
  const auto later = filter.Predict(filter.time_ns() + 100 * kPeriod_ns);
  EXPECT_LT(Log(later.T_world_event.inverse() * later.T_world_aligned).norm(), 1e-6) << "it does not last";
}

TEST(MotionFilter, HasErrorsOfTheSizeThatItStates) {
  // Normalised squared errors of 6 directions have the mean 6 when the covariance is right; the motion is calmer than
  // the filter assumes, so fewer are allowed, more are not.
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, TrueAt(0));
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0, 1e-3);
  const Matrix6d measured_information = 1e6 * Matrix6d::Identity();
  double sum = 0;
  const int count = 500;
  for (int k = 1; k <= count; ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    const auto prediction = filter.Predict(t_ns);
    const Vector6d off = Vector6d::NullaryExpr([&] { return noise(random); });
    filter.Update(t_ns, MostProbable(prediction, TrueAt(t_ns) * Exp(off), measured_information), measured_information);
    const Vector6d error = Log(TrueAt(t_ns).inverse() * filter.pose());
    sum += error.dot(filter.pose_covariance().inverse() * error);
  }
  EXPECT_LT(sum / count, 7);
  EXPECT_GT(sum / count, 2);
}

// A swinging and turning camera with an inertial sensor beside it, in a world where -y is up.
const Eigen::Vector3d kGravity(0.2, 9.8, -0.3), kTurnBias(0.03, -0.02, 0.01), kPushBias(0.1, -0.15, 0.05);
const Eigen::Vector3d kLever(0.05, -0.02, 0.08);

Rigid3 SwingAt(double t) {
  return {ExpSO3({0.3 * std::sin(2 * t), 0.5 * std::sin(1.3 * t), 0.2 * std::cos(1.7 * t)}),
          {0.3 * std::sin(2.1 * t), 0.1 * std::cos(3 * t), 0.2 * std::sin(1.1 * t)}};
}

/// [v; omega], of and in the camera's frame.
Vector6d SwingVelocityAt(double t) {
  constexpr double h = 1e-4;
  return Log(SwingAt(t - h).inverse() * SwingAt(t + h)) / (2 * h);
}

InertialMean ReadAt(double t) {
  constexpr double h = 1e-4;
  const auto place = [](double s) { return SwingAt(s) * kLever; };
  const Eigen::Quaterniond R = SwingAt(t).rotation();
  const Eigen::Vector3d acceleration = (place(t + h) - 2 * place(t) + place(t - h)) / (h * h);
  return {SwingVelocityAt(t).tail<3>() + kTurnBias,
          Eigen::Vector3d(R.conjugate() * (acceleration - kGravity) + kPushBias), kLever};
}

using Reader = std::function<InertialMean(double)>;

struct PoseNoise {
  double sigma = 2e-5;  ///< m and rad
  double variance_scale = 1;
};

/// Poses to a fiftieth of a millimetre and milliradian, stated five times as cautiously, as the alignment does whose
/// edges err alike; or with other noise. With what the inertial sensor `read` between them for `seconds`, or without
/// it. Poses come `delay_s` late.
void Swing(double seconds, const Reader& read, double delay_s, MotionFilter* filter, const PoseNoise& of_poses = {}) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, of_poses.sigma);
  const std::int64_t first = filter->time_ns() / kPeriod_ns + 1;
  for (std::int64_t k = first; k < first + static_cast<int>(100 * seconds); ++k) {
    const std::int64_t t_ns = k * kPeriod_ns;
    if (read) filter->Advance(t_ns, read(SecondsFromNs(t_ns - kPeriod_ns / 2) - filter->state().delay_s));
    const auto predicted = filter->Predict(t_ns);
    const Vector6d off = Vector6d::NullaryExpr([&] { return noise(random); });
    const Matrix6d information = 1e8 * Matrix6d::Identity(), prior = predicted.aligned_covariance.inverse();
    const Vector6d measured =
        Log(predicted.T_world_aligned.inverse() * SwingAt(SecondsFromNs(t_ns) - delay_s) * Exp(off));
    const Rigid3 T_world_aligned =
        predicted.T_world_aligned * Exp(Vector6d((prior + information).inverse() * information * measured));
    filter->Update(t_ns,
                   MotionFilter::LikelihoodOf(predicted, T_world_aligned, information, 0, of_poses.variance_scale));
  }
}

MotionFilter SwingingWith(const Reader& read, double seconds, double delay_s = 0) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, SwingAt(0));
  Swing(seconds, read, delay_s, &filter);
  return filter;
}

MotionFilter Swinging(double seconds, bool inertial, double delay_s = 0) {
  return SwingingWith(inertial ? Reader(ReadAt) : Reader(), seconds, delay_s);
}

/// Of a filter that has followed the swing since its begin.
double Error(const MotionFilter& filter) {
  return Log(SwingAt(SecondsFromNs(filter.time_ns())).inverse() * filter.pose()).norm();
}

/// The largest in several seconds.
double WorstError(const Reader& read) {
  MotionFilter filter = SwingingWith(read, 0.01);
  double worst = 0;
  for (int k = 0; k < 100; ++k) {
    Swing(0.05, read, 0, &filter);
    worst = std::max(worst, Error(filter));
  }
  return worst;
}

InertialMean Turned(InertialMean read, const Eigen::Matrix3d& by) {
  read.angular_velocity = by * read.angular_velocity;
  *read.linear_acceleration = by * *read.linear_acceleration;
  return read;
}

InertialMean WithAxesSwapped(double t) {
  Eigen::Matrix3d swap;
  swap << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  return Turned(ReadAt(t), swap);
}

InertialMean InUnitsOfGravity(double t) {
  InertialMean read = ReadAt(t);
  *read.linear_acceleration /= 9.81;
  return read;
}

InertialMean WithTurnsReversed(double t) {
  InertialMean read = ReadAt(t);
  read.angular_velocity *= -1;
  return read;
}

InertialMean InDegrees(double t) {
  InertialMean read = ReadAt(t);
  read.angular_velocity *= 180 / M_PI;
  return read;
}

/// Shaken: what is read in 10 ms errs by this much. `known`: its noise is.
Reader Shaken(double turn_sigma_rad_s, double push_sigma_m_s2, bool known) {
  const auto random = std::make_shared<std::mt19937>(5);
  return [=](double t) {
    std::normal_distribution<double> normal;
    InertialMean read = ReadAt(t);
    read.angular_velocity += turn_sigma_rad_s * Eigen::Vector3d::NullaryExpr([&] { return normal(*random); });
    *read.linear_acceleration += push_sigma_m_s2 * Eigen::Vector3d::NullaryExpr([&] { return normal(*random); });
    const double period_s = SecondsFromNs(kPeriod_ns);
    if (known) read.noise = {std::pow(turn_sigma_rad_s, 2) * period_s, std::pow(push_sigma_m_s2, 2) * period_s};
    return read;
  };
}

/// By the inertial sensor alone, for one period.
void Lead(MotionFilter* filter) {
  filter->Advance(filter->time_ns() + kPeriod_ns, ReadAt(SecondsFromNs(filter->time_ns() + kPeriod_ns / 2)));
}

double ErrorAfterGap_m(MotionFilter filter, bool inertial) {
  const std::int64_t end_ns = filter.time_ns() + 30 * kPeriod_ns;
  while (filter.time_ns() < end_ns) {
    if (inertial) {
      Lead(&filter);
    } else {
      filter.Coast(filter.time_ns() + kPeriod_ns);
    }
  }
  return (filter.pose().translation() - SwingAt(SecondsFromNs(end_ns)).translation()).norm();
}

/// Started with a velocity that is 0.2 m/s off and taken for certain to 0.02 m/s, led by the inertial sensor for half a
/// second, and told then where it is: what is left of that error.
double VelocityErrorOnceThePoseIsKnown(const std::function<void(MotionFilter*)>& widen) {
  MotionFilter filter = Swinging(5, true);
  const double begin_s = SecondsFromNs(filter.time_ns());
  Vector6d velocity = SwingVelocityAt(begin_s);
  velocity.head<3>() += Eigen::Vector3d(0.2, 0, 0);
  filter.Start(filter.time_ns(), SwingAt(begin_s), velocity, 0.02);
  for (int k = 0; k < 50; ++k) Lead(&filter);
  const double now_s = SecondsFromNs(filter.time_ns());
  widen(&filter);
  filter.Update(filter.time_ns(), SwingAt(now_s), 1e6 * Matrix6d::Identity());
  return (filter.velocity_event() - SwingVelocityAt(now_s)).head<3>().norm();
}

TEST(MotionFilter, MendsTheVelocityThatLedItAstrayWhereAllThatIsStatedIsWidened) {
  EXPECT_LT(VelocityErrorOnceThePoseIsKnown([](MotionFilter* filter) { filter->Widen(100); }), 0.05);
  EXPECT_GT(VelocityErrorOnceThePoseIsKnown([](MotionFilter* filter) { filter->WidenPose(100); }), 0.15);
}

TEST(MotionFilter, LearnsGravityAndBiasesWhileItMoves) {
  const MotionFilter filter = Swinging(20, true);
  EXPECT_LT((filter.state().gyroscope_bias - kTurnBias).norm(), 0.002);
  EXPECT_LT((filter.state().gravity_world - kGravity).norm(), 0.05);
  EXPECT_LT((filter.state().accelerometer_bias - kPushBias).norm(), 0.05);
}

/// Scales of the gyroscope 2 % too high, mounted 1.5 degrees askew.
InertialMean ReadAskewAt(double t) {
  const Eigen::Matrix3d mounting = ExpSO3({0.015, -0.02, 0.01}).toRotationMatrix();
  InertialMean read = Turned(ReadAt(t), mounting);
  read.angular_velocity *= 1.02;
  return read;
}

TEST(MotionFilter, LearnsScaleAndMountingOfAGyroscope) {
  const MotionFilter filter = SwingingWith(ReadAskewAt, 20);
  const Eigen::Matrix3d mounting = ExpSO3({0.015, -0.02, 0.01}).toRotationMatrix();
  EXPECT_LT((filter.state().gyroscope_error - (1.02 * mounting - Eigen::Matrix3d::Identity())).norm(), 0.004);
  EXPECT_LT((filter.state().Mounting() - mounting).norm(), 0.003);
}

TEST(MotionFilter, LearnsWhereTheSensorIs) {
  const Eigen::Vector3d off(0.02, -0.015, 0.01);
  const auto read = [&off](double t) {
    InertialMean mean = ReadAt(t);
    mean.p_event_imu -= off;
    return mean;
  };
  EXPECT_LT((SwingingWith(read, 60).state().lever_error_m - off).norm(), 0.4 * off.norm());
}

TEST(MotionFilter, LearnsTheScaleOfAnAccelerometer) {
  const auto read = [](double t) {
    InertialMean mean = ReadAt(t);
    *mean.linear_acceleration *= 1.03;
    return mean;
  };
  EXPECT_NEAR(SwingingWith(read, 20).state().accelerometer_scale_error, 0.03, 0.01);
}

TEST(MotionFilter, IsLedAsWellByASensorThatIsAskewAsByOneThatIsNotOnceItKnowsIt) {
  const double error_m = ErrorAfterGap_m(Swinging(10, true), true);
  MotionFilter filter = SwingingWith(ReadAskewAt, 10);
  const std::int64_t end_ns = filter.time_ns() + 30 * kPeriod_ns;
  while (filter.time_ns() < end_ns) {
    filter.Advance(filter.time_ns() + kPeriod_ns, ReadAskewAt(SecondsFromNs(filter.time_ns() + kPeriod_ns / 2)));
  }
  EXPECT_LT((filter.pose().translation() - SwingAt(SecondsFromNs(end_ns)).translation()).norm(), error_m + 0.005);
}

TEST(MotionFilter, LearnsByHowMuchPosesAreLateOrEarly) {
  EXPECT_NEAR(Swinging(10, true).state().delay_s, 0, 5e-4);
  EXPECT_NEAR(Swinging(10, true, 0.008).state().delay_s, 0.008, 1e-3);
  EXPECT_NEAR(Swinging(10, true, -0.005).state().delay_s, -0.005, 1e-3);
}

TEST(MotionFilter, KeepsADelayOfZeroWhereNoneIsAllowed) {
  TrackingOptions options;
  options.max_delay_s = 0;
  MotionFilter filter(options);
  filter.Start(0, SwingAt(-0.005));
  for (int k = 1; k < 100; ++k) {
    filter.Advance(k * kPeriod_ns, ReadAt(SecondsFromNs(k * kPeriod_ns - kPeriod_ns / 2)));
    filter.Update(k * kPeriod_ns, SwingAt(SecondsFromNs(k * kPeriod_ns) - 0.005), 1e8 * Matrix6d::Identity());
  }
  EXPECT_EQ(filter.state().delay_s, 0);
}

TEST(MotionFilter, FindsItsWayThroughThreeTenthsOfASecondWithAnInertialSensor) {
  EXPECT_LT(ErrorAfterGap_m(Swinging(5, true), true), 0.004);
  EXPECT_GT(ErrorAfterGap_m(Swinging(5, false), false), 0.02);
}

TEST(MotionFilter, HasErrorsOfTheSizeThatItStatesWithAnInertialSensor) {
  double sum = 0;
  int count = 0;
  for (double seconds = 1; seconds < 6; seconds += 0.5, ++count) {
    const MotionFilter filter = Swinging(seconds, true);
    const Vector6d error = Log(SwingAt(SecondsFromNs(filter.time_ns())).inverse() * filter.pose());
    sum += error.dot(filter.pose_covariance().inverse() * error);
  }
  EXPECT_LT(sum / count, 9);  // 6 directions; sensor and poses here are better than the filter assumes
  EXPECT_GT(sum / count, 0.05);
}

TEST(MotionFilter, GivesAnInertialSensorThatFitsItsFullSay) {
  const InertialFit fit = Swinging(10, true).inertial_fit();
  EXPECT_EQ(fit.gyroscope, 1);
  EXPECT_EQ(fit.accelerometer, 1);
  EXPECT_NEAR(fit.force_m_s2, 9.8, 1);
  EXPECT_EQ(Complaint(fit), "");
  EXPECT_EQ(Swinging(1, false).inertial_fit().gyroscope, 0);
}

TEST(MotionFilter, DoesNotBlameAnInertialSensorForTheNoiseOfPosesWhereThatIsKnown) {
  const auto fit = [](const Reader& read, const PoseNoise& noise) {
    MotionFilter filter = SwingingWith(read, 0.01);
    Swing(5, read, 0, &filter, noise);
    return filter.inertial_fit().gyroscope;
  };
  // Three times the noise of the other tests.
  EXPECT_TRUE(FitsNotAtAll(fit(ReadAt, {6e-5, 1})));
  EXPECT_FALSE(FitsBadly(fit(ReadAt, {6e-5, 9})));
  EXPECT_TRUE(FitsNotAtAll(fit(WithTurnsReversed, {6e-5, 9})));
}

TEST(MotionFilter, IsNotLedAstrayByAnInertialSensorThatContradictsThePoses) {
  const double without = WorstError(nullptr);
  EXPECT_LT(WorstError(WithAxesSwapped), 4 * without);
  EXPECT_LT(WorstError(WithTurnsReversed), 4 * without);
  EXPECT_LT(WorstError(InUnitsOfGravity), 4 * without);
}

TEST(MotionFilter, SaysThatTheGyroscopeDoesNotFitWhereItsAxesAreWrong) {
  for (const Reader& read : {Reader(WithAxesSwapped), Reader(WithTurnsReversed)}) {
    const MotionFilter filter = SwingingWith(read, 5);
    EXPECT_TRUE(FitsNotAtAll(filter.inertial_fit().gyroscope)) << filter.inertial_fit().gyroscope;
    EXPECT_NE(Complaint(filter.inertial_fit()).find("the gyroscope does not fit"), std::string::npos);
  }
}

TEST(MotionFilter, SaysThatTheGyroscopeDoesNotFitWhereItReadsDegrees) {
  MotionFilter filter = SwingingWith(ReadAt, 0.01);
  Swing(0.5, InDegrees, 0, &filter);
  EXPECT_TRUE(FitsNotAtAll(filter.inertial_fit().gyroscope)) << filter.inertial_fit().gyroscope;
}

TEST(MotionFilter, TakesTheNoiseOfAShakenSensorForNoDelay) {
  EXPECT_NEAR(SwingingWith(Shaken(0.03, 0.5, true), 10).state().delay_s, 0, 1e-3);
  EXPECT_NEAR(SwingingWith(Shaken(0.03, 0.5, true), 10, 0.008).state().delay_s, 0.008, 2e-3);
}

TEST(MotionFilter, TrustsAGyroscopeLessTheMoreItIsShaken) {
  EXPECT_GT(SwingingWith(Shaken(0.001, 0.02, true), 2).gyroscope_trust(), 0.9);
  EXPECT_LT(SwingingWith(Shaken(0.03, 0.5, true), 2).gyroscope_trust(), 0.3);
}

TEST(MotionFilter, LeavesOutAnAccelerometerWhoseForceCannotBeGravity) {
  const MotionFilter filter = SwingingWith(InUnitsOfGravity, 5);
  EXPECT_FALSE(filter.knows_gravity());
  EXPECT_TRUE(filter.state().accelerometer_bias.isZero());
  EXPECT_NEAR(filter.inertial_fit().force_m_s2, 1, 0.1);
  EXPECT_NE(Complaint(filter.inertial_fit()).find("check its unit"), std::string::npos);
  EXPECT_LT((filter.state().gyroscope_bias - kTurnBias).norm(), 0.002);  // the gyroscope stays
}

TEST(MotionFilter, TakesAnInertialSensorBackWhenItFitsAgain) {
  MotionFilter filter = SwingingWith(WithTurnsReversed, 2);
  EXPECT_TRUE(FitsNotAtAll(filter.inertial_fit().gyroscope));
  Swing(10, ReadAt, 0, &filter);
  EXPECT_EQ(Complaint(filter.inertial_fit()), "");
}

TEST(MotionFilter, ForgetsAnInertialSensorButNotTheMotion) {
  MotionFilter filter = Swinging(3, true);
  const MotionState before = filter.state();
  const Matrix6d covariance = filter.pose_covariance();
  ASSERT_FALSE(before.gyroscope_bias.isZero());
  filter.ForgetInertial();
  EXPECT_TRUE(filter.state().gyroscope_bias.isZero());
  EXPECT_TRUE(filter.state().gyroscope_error.isZero());
  EXPECT_FALSE(filter.knows_gravity());
  EXPECT_EQ(filter.inertial_fit().gyroscope, 0);
  EXPECT_EQ(filter.state().delay_s, 0);
  EXPECT_GT(filter.delay_variance_s2(), 0);
  EXPECT_EQ(filter.state().velocity, before.velocity);
  EXPECT_EQ(filter.pose_covariance(), covariance);
  // And learns it anew.
  Swing(5, ReadAt, 0, &filter);
  EXPECT_EQ(Complaint(filter.inertial_fit()), "");
  EXPECT_LT((filter.state().gyroscope_bias - kTurnBias).norm(), 0.002);
}

TEST(MotionFilter, TakesABlowForNoMotion) {
  MotionFilter filter = Swinging(3, true);
  const std::int64_t next_ns = filter.time_ns() + kPeriod_ns;
  InertialMean blow = ReadAt(SecondsFromNs(filter.time_ns() + kPeriod_ns / 2));
  *blow.linear_acceleration += Eigen::Vector3d(150, 0, 0);
  MotionFilter struck = filter;
  struck.Advance(next_ns, blow);
  const double gained_m_s =
      (struck.Predict(next_ns).velocity_event - filter.Predict(next_ns).velocity_event).head<3>().norm();
  EXPECT_LT(gained_m_s, 0.2 * 150 * SecondsFromNs(kPeriod_ns));
}

TEST(MotionFilter, NeedsNoAccelerometerBesideAGyroscope) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, SwingAt(0));
  InertialMean turning = ReadAt(0.005);
  turning.angular_velocity = {0.8, -0.4, 0.3};
  turning.linear_acceleration.reset();
  filter.Advance(kPeriod_ns, turning);
  const Eigen::Vector3d turned = LogSO3(SwingAt(0).rotation().conjugate() * filter.pose().rotation());
  EXPECT_LT((turned - 0.01 * turning.angular_velocity).norm(), 0.1 * 0.01 * turning.angular_velocity.norm());
  EXPECT_TRUE(filter.state().gravity_world.isZero());
  EXPECT_EQ(filter.time_ns(), kPeriod_ns);
}

TEST(MotionFilter, KeepsItsCovarianceSymmetricAndPositiveOverManyReadings) {
  const Matrix6d P = Swinging(20, true).pose_covariance();
  EXPECT_LT((P - P.transpose()).norm(), 1e-12 * P.norm());
  EXPECT_GT(P.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0);
}

TEST(MotionFilter, LearnsItsBiasesAtRest) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, TrueAt(0));
  const InertialMean rest{kTurnBias, Eigen::Vector3d(-kGravity), Eigen::Vector3d::Zero()};
  for (int k = 1; k <= 100; ++k) filter.HoldStill(k * kPeriod_ns, rest);
  EXPECT_LT((filter.state().gyroscope_bias - kTurnBias).norm(), 0.002);
  EXPECT_LT(Log(TrueAt(0).inverse() * filter.pose()).norm(), 1e-12);
  EXPECT_EQ(filter.Predict(filter.time_ns()).velocity_event, Vector6d(Vector6d::Zero()));
}

TEST(MotionFilter, IsTheSurerOfTheMotionAfterARestTheSteadierItsReadingsWere) {
  const Eigen::Vector3d force(0.5, -9.6, 1.5);
  std::vector<double> variances;
  for (const double scatter : {0.0, 0.5, 1.0, 5.0}) {  // of the errors in motion
    MotionFilter filter{TrackingOptions()};
    filter.Start(0, Rigid3());
    filter.LearnGravity(force, 0.3);
    const InertialMean reading{{0.01, 0, 0}, force, Eigen::Vector3d::Zero()};
    for (int k = 1; k <= 30; ++k) filter.HoldStill(k * kPeriod_ns, reading, InertialScatter{0.005 * scatter, 0});
    for (int k = 31; k <= 80; ++k) filter.Advance(k * kPeriod_ns, reading);
    variances.push_back(filter.velocity_covariance()(0, 0));
  }
  EXPECT_LT(variances[0], 0.9 * variances[1]);
  EXPECT_LT(variances[1], 0.9 * variances[2]);
  EXPECT_EQ(variances[2], variances[3]);
}

TEST(MotionFilter, GoesOnAlikeInAnotherWorld) {
  const Eigen::Vector3d force(0.5, -9.6, 1.5);
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, Rigid3());
  filter.LearnGravity(force, 0.3);
  for (int k = 1; k <= 30; ++k) filter.HoldStill(k * kPeriod_ns, InertialMean{{0.01, 0, 0}, force, {0.05, 0, 0}});
  MotionFilter other = filter;
  const Rigid3 T_other_event = Exp(Twist());
  other.Anchor(T_other_event);
  EXPECT_LT(Log(T_other_event.inverse() * other.pose()).norm(), 1e-12);
  for (int k = 31; k <= 60; ++k) {
    const InertialMean pushed{{0.21, 0.1, 0}, force + Eigen::Vector3d(1, 0, 0.5), {0.05, 0, 0}};
    filter.Advance(k * kPeriod_ns, pushed);
    other.Advance(k * kPeriod_ns, pushed);
  }
  EXPECT_GT(filter.pose().translation().norm(), 0.03);
  EXPECT_LT(Log(filter.pose().inverse() * (T_other_event.inverse() * other.pose())).norm(), 2e-3);
  EXPECT_LT((filter.velocity_covariance() - other.velocity_covariance()).norm(),
            0.05 * filter.velocity_covariance().norm());
}

TEST(MotionFilter, HeldStillHasNoVelocityAndKeepsItsPose) {
  MotionFilter filter = Moving();
  const Rigid3 before = filter.pose();
  const Matrix6d covariance = filter.pose_covariance();
  filter.HoldStill(filter.time_ns() + 5 * kPeriod_ns);
  EXPECT_LT(Log(before.inverse() * filter.pose()).norm(), 1e-12);
  EXPECT_EQ(filter.pose_covariance(), covariance);
  const auto prediction = filter.Predict(filter.time_ns() + kPeriod_ns);
  EXPECT_EQ(prediction.velocity_event, Vector6d(Vector6d::Zero()));
  EXPECT_LT(Log(before.inverse() * prediction.T_world_event).norm(), 1e-12);
}

TEST(MotionFilter, TakesAShiftFoundAfterARestForWhereItCameToStandAndNotForAVelocity) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, Rigid3());
  const Vector6d slow = 0.03 * Vector6d::Unit(0);
  const Matrix6d information = 1e8 * Matrix6d::Identity();  // 0.1 mm
  for (int k = 1; k <= 50; ++k) filter.Update(k * kPeriod_ns, Exp(0.01 * k * slow), information);
  const double before = filter.pose_covariance()(0, 0);
  for (int k = 51; k <= 100; ++k) filter.HoldStill(k * kPeriod_ns);
  EXPECT_GT(filter.Predict(101 * kPeriod_ns).covariance(0, 0), before + std::pow(0.03 * slow.norm(), 2));
  // It crept on for a millimetre.
  filter.Update(101 * kPeriod_ns, filter.pose() * Exp(0.001 * Vector6d::Unit(0)), information);
  EXPECT_LT(filter.velocity_event().norm(), 0.005);
}

TEST(MotionFilter, DoesNotKnowFromAGyroscopesFirstReadingAfterARestWhereItCameToStand) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, Rigid3());
  const double turn_rad_s = 0.3;
  const Vector6d turning = turn_rad_s * Vector6d::Unit(4);
  const InertialMean still{Eigen::Vector3d::Zero(), std::nullopt, Eigen::Vector3d::Zero()};
  for (int k = 1; k <= 50; ++k) {
    filter.Update(k * kPeriod_ns, Exp(0.01 * k * turning), 1e8 * Matrix6d::Identity());
  }
  for (int k = 51; k <= 100; ++k) filter.HoldStill(k * kPeriod_ns, still);
  const double by_gyroscope_alone = filter.Predict(101 * kPeriod_ns).covariance(4, 4);
  filter.Advance(101 * kPeriod_ns, still);
  EXPECT_GT(filter.pose_covariance()(4, 4), std::pow(0.02 * turn_rad_s, 2));
  EXPECT_GT(filter.pose_covariance()(4, 4), 0.8 * by_gyroscope_alone);
}

TEST(MotionFilter, LetsBiasesWanderInALongRestAsInMotion) {
  MotionFilter filter{TrackingOptions()};
  filter.Start(0, Rigid3());
  InertialMean reading{{0.01, 0, 0}, std::nullopt, Eigen::Vector3d::Zero()};
  int k = 0;
  for (; k < 6000; ++k) filter.HoldStill((k + 1) * kPeriod_ns, reading);
  // As the sensor warms: by three times what its bias wanders in ten seconds.
  reading.angular_velocity.x() += 0.005;
  for (; k < 7000; ++k) filter.HoldStill((k + 1) * kPeriod_ns, reading);
  EXPECT_NEAR(filter.state().gyroscope_bias.x(), reading.angular_velocity.x(), 0.001);
}

TEST(MotionFilter, MayGoOnAsBeforeAfterAMomentOfRest) {
  MotionFilter filter = Moving();
  const Eigen::Vector3d v = filter.velocity_event().head<3>();
  const auto variance = [&] { return v.dot(filter.velocity_covariance().topLeftCorner<3, 3>() * v) / v.squaredNorm(); };
  filter.HoldStill(filter.time_ns() + kPeriod_ns);
  EXPECT_GT(variance(), 0.8 * v.squaredNorm());
  for (int k = 0; k < 50; ++k) filter.HoldStill(filter.time_ns() + kPeriod_ns);
  EXPECT_LT(variance(), 0.01 * v.squaredNorm());
}

TEST(MotionFilter, KnowsNoMoreOfGravityAndTheSensorForHavingCoastedLong) {
  MotionFilter filter = Swinging(2, true);
  const auto constants = [&filter] {
    // Of gravity and all that does not change with time, as far as the state tells it.
    return std::make_pair(filter.delay_variance_s2(), filter.knows_acceleration());
  };
  const auto before = constants();
  for (int k = 0; k < 500; ++k) filter.Coast(filter.time_ns() + kPeriod_ns);
  EXPECT_GE(constants().first, before.first);
  EXPECT_EQ(constants().second, before.second);
  const Matrix6d P = filter.pose_covariance();
  EXPECT_LE(P.diagonal().maxCoeff(), 1 + 1e-9);
  EXPECT_GT(P.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0);
}

TEST(MotionFilter, CoastsOnAndSlowsDown) {
  MotionFilter filter = Moving();
  const Rigid3 before = filter.pose();
  const Matrix6d covariance = filter.pose_covariance();
  for (int k = 0; k < 10; ++k) filter.Coast(filter.time_ns() + kPeriod_ns);
  const auto now = filter.Predict(filter.time_ns());
  const double slower = now.velocity_event.norm() / Twist().norm();
  EXPECT_GT(slower, 0.7);
  EXPECT_LT(slower, 0.95);
  // A tenth of a second: between what the last speed and what the first would have given.
  const double moved = Log(before.inverse() * filter.pose()).norm() / (0.1 * Twist().norm());
  EXPECT_GT(moved, slower);
  EXPECT_LT(moved, 1);
  EXPECT_GT(filter.pose_covariance().trace(), covariance.trace());
}

TEST(MotionFilter, GoesThroughAGapInOneCallAsInMany) {
  MotionFilter speeding_up = Moving();
  for (int k = 1; k <= 10; ++k) {
    const std::int64_t t_ns = speeding_up.time_ns() + kPeriod_ns;
    speeding_up.Update(t_ns, speeding_up.pose() * Exp((0.01 + 0.001 * k) * Twist()), 1e8 * Matrix6d::Identity());
  }
  for (const bool coasting : {true, false}) {
    MotionFilter at_once = speeding_up, in_steps = speeding_up;
    const auto go_to = [coasting](std::int64_t t_ns, MotionFilter* filter) {
      coasting ? filter->Coast(t_ns) : filter->GoOn(t_ns);
    };
    const std::int64_t end_ns = speeding_up.time_ns() + 60 * kPeriod_ns;
    go_to(end_ns, &at_once);
    while (in_steps.time_ns() < end_ns) go_to(in_steps.time_ns() + kPeriod_ns, &in_steps);
    EXPECT_EQ(at_once.time_ns(), end_ns);
    EXPECT_LT(Log(in_steps.pose().inverse() * at_once.pose()).norm(), 5e-3) << coasting;
  }
}

TEST(MotionFilter, StopsAndStaysFiniteWhenItCoastsForAMinute) {
  MotionFilter filter = Moving();
  for (int k = 0; k < 6000; ++k) filter.Coast(filter.time_ns() + kPeriod_ns);
  const auto prediction = filter.Predict(filter.time_ns() + kPeriod_ns);
  EXPECT_LT(prediction.velocity_event.norm(), 1e-6);
  EXPECT_TRUE(prediction.T_world_event.IsFinite());
  EXPECT_TRUE(prediction.covariance.allFinite());
  EXPECT_LT(prediction.covariance.diagonal().maxCoeff(), 10);
}

}  // namespace
}  // namespace devo
