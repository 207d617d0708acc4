// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/motion_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "devo/core/delay.h"
#include "devo/core/inertial_measurement.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// Accelerations of hands and small vehicles keep their direction about this long.
constexpr double kManeuver_s = 0.15;
// Without events a motion is taken to go on about this long.
constexpr double kCoast_s = 0.5;
constexpr double kStartSigma_m = 1e-3, kStartSigma_rad = 1e-3;
// As accelerations are: hands turn a camera more than they shift it, in the image.
constexpr double kStartTurn_rad_s = 1;
constexpr double kStillSpeed_m_s = 0.01, kStillTurn_rad_s = 0.01;
// A camera that is found to stand has come to rest within this time, unseen. Or it does not stand, and moves on as
// before: the longer it seems to, the less likely.
constexpr double kBraking_s = 0.05, kMistaken_s = 0.1;

// Consumer parts: bias up to degrees per second when cold, scales right to a hundredth or two, a mounting known to half
// a degree per axis and a place known to two centimetres, as by a ruler. The noise is what is left beside these:
// vibration.
constexpr double kGravity_m_s2 = 9.81;
constexpr double kGyroscopeBias_rad_s = 0.05, kGyroscopeSigma_rad_s = 0.005, kGyroscopeShare = 0.003;
constexpr double kGyroscopeScale = 0.007, kGyroscopeCross = 0.003, kMounting_rad = 0.01, kLever_m = 0.02;
constexpr double kAccelerometerBias_m_s2 = 0.5, kAccelerometerSigma_m_s2 = 0.3, kAccelerometerShare = 0.01;
constexpr double kAccelerometerScale = 0.02;
constexpr double kLeastErrorShare = 0.2;  // of a steady sensor at rest: what it reads then holds for a while only
constexpr double kGyroscopeWalk_rad_s = 5e-4, kAccelerometerWalk_m_s2 = 5e-3;  // in one second
// Variances of scale, mounting and place, over those at the start, that a second adds for each time that the sensor
// fits worse than a good one.
constexpr double kMisfitWalk = 1e-3;
constexpr double kUsualSpan_s = 0.01;     // of what is read between two poses
constexpr double kKnownGravity_m_s2 = 1;  // its standard deviation, where accelerations are to be told from it
// Of the mean of the first readings: the camera may be moving, and change its velocity by so much.
constexpr double kGravitySpeed_m_s = 1, kMinGravitySigma_m_s2 = 0.5, kMaxGravitySigma_m_s2 = 4;
// Beyond it, what was read does not fit the motion (a blow, an axis at its limit) and counts for less. Where that goes
// on, it is the sensor that does not fit (another unit): the poses would not show that, as they are not moved by it.
constexpr double kMaxNormalisedSquare = 16;

// How far poses move what an inertial sensor predicted, squared, over what is expected: stated cautiously on both
// sides, it is 0.02 with a sensor that fits, at most a few tenths for a moment where events err alike. An error of the
// sensor counts in it as its square over that of the noise it is taken to have, whatever the noise of the poses, which
// is how that noise is found.
constexpr double kFittingSquare = 0.1;
// Depth states its errors as they are, and mends those of the alignments before it: that says little of the sensor.
constexpr double kFittingSquareOfDepth = 2;
// That of a sensor that fits seems so many times larger for a moment, in fast motion and in the dark.
constexpr double kTolerated = 2;
// It grows within a few poses, so that a sensor that is all wrong does not take the first ones with it, and fades
// slower than motions turn round, where nothing is seen of it.
constexpr double kMisfitGrows_s = 0.15, kMisfitFades_s = 0.3, kMaxMisfit = 1e6;
// One pose may be false, several in a row are not.
constexpr double kMaxTimes = 40;
constexpr double kForceSpan_s = 0.5, kShowsMisfit_s = 2;

// Alignments err alike for about this long: as long as an edge takes to be met from elsewhere, at another speed.
constexpr double kShared_s = 0.1;
constexpr double kMaxShared_m = 0.02;  // in directions that alignments leave open, also in radians

// Of a full step. What surfaces err alike lasts for tenths of a second, but a delay shows as it does only while the
// rotation speeds up alike.
constexpr double kDelayStep = 0.6;
// What a delay is told by is averaged over no time beside a quiet sensor, over a few readings beside a noisy one: not
// over a whole swing.
constexpr double kLongestSteady_s = 0.06;

using State = MotionState;

/// Of a sensor's variance, by how many times larger its errors' squares are than a good one's: gently at first.
double Widening(double misfit) { return std::max(1.0, misfit * misfit / (misfit + kTolerated)); }

/// Over `span_s`, errors of the sensor were so many `times` as large as those it is taken to have, squared.
void NoteMisfit(double times, double span_s, double* misfit) {
  if (span_s <= 0 || !std::isfinite(times)) return;
  const double now = std::min(times, kMaxTimes) * Widening(*misfit);
  const double share = 1 - std::exp(-span_s / (now > *misfit ? kMisfitGrows_s : kMisfitFades_s));
  *misfit = std::min(kMaxMisfit, *misfit + share * (now - *misfit));
}

/// A reading with this normalised square, if that is too large for a motion, says that the sensor does not fit.
void NoteRefused(double square, double span_s, double* misfit, double* shown) {
  if (square < kMaxNormalisedSquare || FitsNotAtAll(std::sqrt(Widening(*misfit)))) return;
  NoteMisfit(square / kMaxNormalisedSquare, span_s, misfit);
  *shown = std::max(*shown, *misfit);
}

/// Of a sensor's errors in motion: scale, mounting and vibration make none at rest.
double ErrorShareAtRest(const std::optional<InertialScatter>& scatter) {
  if (!scatter) return 1;
  return std::clamp(
      std::max(scatter->turn_rad_s / kGyroscopeSigma_rad_s, scatter->force_m_s2 / kAccelerometerSigma_m_s2),
      kLeastErrorShare, 1.0);
}

/// Of the gyroscope's error by columns. It and the accelerometer are mounted as one: what is askew makes the error
/// antisymmetric.
Eigen::Matrix<double, 9, 9> MakeGyroscopeErrorVariance() {
  Eigen::Matrix<double, 9, 9> variance = Eigen::Matrix<double, 9, 9>::Zero();
  const double askew = kMounting_rad * kMounting_rad, cross = kGyroscopeCross * kGyroscopeCross;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const int ij = i + 3 * j, ji = j + 3 * i;
      variance(ij, ij) = i == j ? kGyroscopeScale * kGyroscopeScale : askew + cross;
      if (i != j) variance(ij, ji) = -askew;
    }
  }
  return variance;
}

/// At the start.
const Eigen::Matrix<double, 9, 9>& GyroscopeErrorVariance() {
  static const Eigen::Matrix<double, 9, 9> variance = MakeGyroscopeErrorVariance();
  return variance;
}

Vector6d Both(double translation, double rotation) {
  Vector6d v;
  v << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return v;
}

/// Of gyroscope and, where there is one, accelerometer below it.
struct StackedMeasurement {
  Eigen::Matrix<double, Eigen::Dynamic, State::kSize, 0, 6, State::kSize> H_after, H_before;
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1> residual, variance;
};

/// Standard deviations of a turn, rad, and of a change of velocity, m/s.
StackedMeasurement Stacked(const InertialMean& inertial, const State& before, const State& after, double dt_s,
                           double turn_sigma, double push_sigma) {
  const int n = inertial.linear_acceleration ? 6 : 3;
  StackedMeasurement stacked;
  stacked.H_after.resize(n, State::kSize);
  stacked.H_before.resize(n, State::kSize);
  stacked.residual.resize(n);
  stacked.variance.resize(n);
  const auto add = [&](int row, const InertialMeasurement& m, double sigma) {
    stacked.H_after.middleRows<3>(row) = m.H_after;
    stacked.H_before.middleRows<3>(row) = m.H_before;
    stacked.residual.segment<3>(row) = m.residual;
    stacked.variance.segment<3>(row).setConstant(sigma * sigma);
  };
  add(0, MeasuredTurn(inertial, before, after, dt_s), turn_sigma);
  if (n == 6) add(3, MeasuredPush(inertial, before, after, dt_s), push_sigma);
  return stacked;
}

}  // namespace

void MotionFilter::Reset() {
  started_ = false;
  state_ = {};
  ForgetInertial();
}

void MotionFilter::ForgetInertial() {
  MotionState motion;
  motion.T_world_event = state_.T_world_event;
  motion.velocity = state_.velocity;
  motion.acceleration = state_.acceleration;
  motion.shared_error = state_.shared_error;
  state_ = motion;
  turn_misfit_ = push_misfit_ = turn_misfit_shown_ = push_misfit_shown_ = 0;
  force_m_s2_ = read_turn_s_ = read_push_s_ = 0;
  read_ns_.reset();
  noise_ = {};
  constexpr int kFixed = State::kSize - State::kChanging;
  P_.bottomRows<kFixed>().setZero();
  P_.rightCols<kFixed>().setZero();
  P_.diagonal().segment<3>(State::kGyroscopeBias).setConstant(std::pow(kGyroscopeBias_rad_s, 2));
  P_.diagonal().segment<3>(State::kAccelerometerBias).setConstant(std::pow(kAccelerometerBias_m_s2, 2));
  P_(State::kDelay, State::kDelay) = options_.max_delay_s > 0 ? std::pow(kDelaySigma_s, 2) : 0;
  P_.block<9, 9>(State::kGyroscopeError, State::kGyroscopeError) = GyroscopeErrorVariance();
  P_.diagonal().segment<3>(State::kLeverError).setConstant(kLever_m * kLever_m);
  P_(State::kAccelerometerScale, State::kAccelerometerScale) = kAccelerometerScale * kAccelerometerScale;
}

void MotionFilter::Start(std::int64_t t_ns, const Rigid3& T_world_event, const Vector6d& velocity_event,
                         double speed_sigma_m_s) {
  if (!started_) {
    P_.setZero();
    ForgetInertial();
  }
  started_ = true;
  t_ns_ = t_ns;
  state_.velocity = velocity_event;
  state_.StopSpeedingUp();
  SetPoseAsAtStart(T_world_event);
  SetMotion(Both(speed_sigma_m_s, kStartTurn_rad_s));
}

void MotionFilter::SetPoseAsAtStart(const Rigid3& T_world_event) {
  state_.T_world_event = T_world_event;
  state_.shared_error.setZero();
  shared_variance_.setZero();
  for (const int i : {State::kRho, State::kSharedError}) {
    P_.middleRows<6>(i).setZero();
    P_.middleCols<6>(i).setZero();
  }
  P_.diagonal().head<6>() = Both(kStartSigma_m, kStartSigma_rad).cwiseAbs2();
  before_rest_.setZero();
}

void MotionFilter::Anchor(const Rigid3& T_world_event) {
  const Eigen::Matrix3d R = (T_world_event.rotation() * state_.T_world_event.rotation().conjugate()).toRotationMatrix();
  state_.gravity_world = (R * state_.gravity_world).eval();
  P_.middleRows<3>(State::kGravity) = (R * P_.middleRows<3>(State::kGravity)).eval();
  P_.middleCols<3>(State::kGravity) = (P_.middleCols<3>(State::kGravity) * R.transpose()).eval();
  SetPoseAsAtStart(T_world_event);
}

void MotionFilter::SetMotion(const Vector6d& sigma_velocity) {
  P_.middleRows<12>(State::kV).setZero();
  P_.middleCols<12>(State::kV).setZero();
  P_.diagonal().segment<6>(State::kV) = sigma_velocity.cwiseAbs2();
  P_.diagonal().segment<6>(State::kA) = LivelyVariance();
  manoeuvre_.Reset();
}

Vector6d MotionFilter::LivelyVariance() const {
  return Both(options_.acceleration_m_s2, options_.angular_acceleration_rad_s2).cwiseAbs2();
}

void MotionFilter::AddJerk(double dt_s) {
  // Singer: the acceleration's variance is stationary, its density follows from the time it takes to fade.
  const Vector6d q = 2 / kManeuver_s * manoeuvre_.variance_share() * LivelyVariance();
  const double d = dt_s, d2 = d * d, d3 = d2 * d, d4 = d3 * d, d5 = d4 * d;
  for (int i = 0; i < 6; ++i) {
    const int v = i + State::kV, a = i + State::kA;
    P_(i, i) += q[i] * d5 / 20;
    P_(i, v) += q[i] * d4 / 8;
    P_(v, i) += q[i] * d4 / 8;
    P_(i, a) += q[i] * d3 / 6;
    P_(a, i) += q[i] * d3 / 6;
    P_(v, v) += q[i] * d3 / 3;
    P_(v, a) += q[i] * d2 / 2;
    P_(a, v) += q[i] * d2 / 2;
    P_(a, a) += q[i] * d;
  }
}

void MotionFilter::LetInertialWander(double dt_s) {
  // What a sensor that does not fit has said of gravity and biases is as wrong as it is.
  const double turn = Widening(turn_misfit_), push = Widening(push_misfit_);
  for (int i = 0; i < 3; ++i) {
    P_(State::kGyroscopeBias + i, State::kGyroscopeBias + i) += turn * std::pow(kGyroscopeWalk_rad_s, 2) * dt_s;
    P_(State::kAccelerometerBias + i, State::kAccelerometerBias + i) +=
        push * std::pow(kAccelerometerWalk_m_s2, 2) * dt_s;
    P_(State::kGravity + i, State::kGravity + i) +=
        (std::max(turn, push) - 1) * std::pow(kAccelerometerWalk_m_s2, 2) * dt_s;
  }
  P_.block<9, 9>(State::kGyroscopeError, State::kGyroscopeError) +=
      (turn - 1) * dt_s * kMisfitWalk * GyroscopeErrorVariance();
  P_.diagonal().segment<3>(State::kLeverError).array() += (push - 1) * dt_s * kMisfitWalk * kLever_m * kLever_m;
  P_(State::kAccelerometerScale, State::kAccelerometerScale) +=
      (push - 1) * dt_s * kMisfitWalk * kAccelerometerScale * kAccelerometerScale;
  if (options_.max_delay_s > 0) P_(State::kDelay, State::kDelay) += std::pow(kDelayWalk_s, 2) * dt_s;
}

void MotionFilter::LeaveRest() {
  // Where exactly it stood the first events after a rest tell: without this they would seem to tell of a velocity.
  P_.topLeftCorner<6, 6>() += kBraking_s * kBraking_s * std::exchange(before_rest_, Matrix6d::Zero());
}

MotionFilter::Change MotionFilter::Propagate(double dt_s) {
  LeaveRest();
  const double fade = std::exp(-dt_s / kManeuver_s), shared_fade = std::exp(-dt_s / kShared_s);
  const Vector6d step = state_.velocity * dt_s + state_.acceleration * (0.5 * dt_s * dt_s);
  Change F = Change::Identity();
  F.block<6, 6>(0, 0) = Adjoint(Exp(-step));
  F.block<6, 6>(0, State::kV) = dt_s * Matrix6d::Identity();
  F.block<6, 6>(0, State::kA) = 0.5 * dt_s * dt_s * Matrix6d::Identity();
  F.block<6, 6>(State::kV, State::kA) = dt_s * Matrix6d::Identity();
  F.block<6, 6>(State::kA, State::kA) = fade * Matrix6d::Identity();
  F.block<6, 6>(State::kSharedError, State::kSharedError) = shared_fade * Matrix6d::Identity();
  constexpr int kFixed = State::kSize - State::kChanging;
  P_.topLeftCorner<State::kChanging, State::kChanging>() =
      (F * P_.topLeftCorner<State::kChanging, State::kChanging>() * F.transpose()).eval();
  P_.topRightCorner<State::kChanging, kFixed>() = (F * P_.topRightCorner<State::kChanging, kFixed>()).eval();
  P_.bottomLeftCorner<kFixed, State::kChanging>() = P_.topRightCorner<State::kChanging, kFixed>().transpose();
  AddJerk(dt_s);
  P_.block<6, 6>(State::kSharedError, State::kSharedError) += (1 - shared_fade * shared_fade) * shared_variance_;
  LetInertialWander(dt_s);
  state_.T_world_event = state_.T_world_event * Exp(step);
  state_.velocity += state_.acceleration * dt_s;
  state_.acceleration *= fade;
  state_.shared_error *= shared_fade;
  return F;
}

void MotionFilter::PropagateTo(std::int64_t t_ns) {
  for (; t_ns - t_ns_ > kLongestStep_ns; t_ns_ += kStep_ns) Propagate(SecondsFromNs(kStep_ns));
  Propagate(SecondsFromNs(t_ns - t_ns_));
  t_ns_ = t_ns;
}

MotionFilter::Prediction MotionFilter::Predict(std::int64_t t_ns) const {
  MotionFilter ahead = *this;
  ahead.PropagateTo(t_ns);
  return ahead.Now(ahead.state_.velocity);
}

MotionFilter::Prediction MotionFilter::AtRest() const { return Now(Vector6d::Zero()); }

MotionFilter::Prediction MotionFilter::Now(const Vector6d& velocity_event) const {
  return {state_.T_world_event,       velocity_event,
          velocity_covariance(),      PriorCovariance(Shown::kPose),
          Predicted(Shown::kAligned), PriorCovariance(Shown::kAligned)};
}

Rigid3 MotionFilter::Predicted(Shown shown) const {
  return shown == Shown::kAligned ? state_.T_world_event * Exp(state_.shared_error) : state_.T_world_event;
}

MotionFilter::Columns MotionFilter::CovarianceWith(Shown shown) const {
  Columns covariance = P_.leftCols<6>();
  if (shown == Shown::kAligned) covariance += P_.middleCols<6>(State::kSharedError);
  return covariance;
}

Matrix6d MotionFilter::CovarianceOf(Shown shown) const {
  const Columns with = CovarianceWith(shown);
  Matrix6d covariance = with.topRows<6>();
  if (shown == Shown::kAligned) covariance += with.middleRows<6>(State::kSharedError);
  return covariance;
}

Matrix6d MotionFilter::PriorCovariance(Shown shown) const {
  // As if the delay were known: not knowing it would let go of rotation, which the gyroscope knows best.
  Matrix6d covariance = CovarianceOf(shown);
  const Vector6d with_delay = CovarianceWith(shown).row(State::kDelay);
  if (P_(State::kDelay, State::kDelay) > 0)
    covariance -= with_delay * with_delay.transpose() / P_(State::kDelay, State::kDelay);
  return covariance;
}

void MotionFilter::Update(std::int64_t t_ns, const Rigid3& T_world_event, const Matrix6d& information,
                          double variance_scale) {
  Condition(t_ns, Shown::kPose, T_world_event, information, variance_scale);
}

void MotionFilter::Condition(std::int64_t t_ns, Shown shown, const Rigid3& T_world_measured,
                             const Matrix6d& information, double variance_scale) {
  if (t_ns != t_ns_) PropagateTo(t_ns);
  const Matrix6d P_shown = CovarianceOf(shown);
  const Matrix6d I = Matrix6d::Identity();
  const Matrix6d P_shown_inverse = P_shown.ldlt().solve(I);
  // Conditioning on what was measured: the state follows it as far as it is correlated with it.
  const Columns gain = CovarianceWith(shown) * P_shown_inverse;
  const Vector6d moved = Log(Predicted(shown).inverse() * T_world_measured);
  NoteFit(moved, shown, information, variance_scale);
  state_.Correct(gain * moved);
  const Matrix6d P_shown_after = (P_shown_inverse + information).ldlt().solve(I);
  const Matrix drop = gain * (P_shown - P_shown_after) * gain.transpose();
  P_ -= drop;
  state_.delay_s = StepDelay(state_.delay_s, kDelayStep * gain.row(State::kDelay).dot(moved), options_.max_delay_s);
  P_(State::kDelay, State::kDelay) += (1 - DropOfStep(kDelayStep)) * drop(State::kDelay, State::kDelay);
  NoteManoeuvre(moved, P_shown - P_shown_after);
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

MotionFilter::Likelihood MotionFilter::LikelihoodOf(const Prediction& predicted, const Rigid3& T_world_aligned,
                                                    const Matrix6d& information, double shared, double variance_scale) {
  // Where both together are least, one rises as the other falls.
  const Vector6d to_predicted = Log(T_world_aligned.inverse() * predicted.T_world_aligned);
  const Vector6d gradient = predicted.aligned_covariance.ldlt().solve(to_predicted);
  return {T_world_aligned, information, gradient, shared, variance_scale};
}

void MotionFilter::Update(std::int64_t t_ns, const Likelihood& measured) {
  GoOn(t_ns);
  const Matrix6d I = Matrix6d::Identity();
  const Vector6d to_predicted = Log(measured.T_world_aligned.inverse() * Predicted(Shown::kAligned));
  const Matrix6d prior = PriorCovariance(Shown::kAligned).ldlt().solve(I);
  const Vector6d moved = (prior + measured.information).ldlt().solve(prior * to_predicted - measured.gradient);
  Condition(t_ns, Shown::kAligned, measured.T_world_aligned * Exp(moved), measured.information,
            measured.variance_scale);
  shared_variance_.setZero();
  if (measured.shared <= 0) return;
  shared_variance_ = (measured.information / measured.shared + I / (kMaxShared_m * kMaxShared_m)).ldlt().solve(I);
}

void MotionFilter::WidenPose(double times) { P_.topLeftCorner<6, 6>() *= times; }

void MotionFilter::NoteManoeuvre(const Vector6d& moved, const Matrix6d& expected) {
  // An inertial sensor tells of accelerations before poses do.
  if (!options_.ideas.calm_motion || (read_ns_ && t_ns_ - *read_ns_ < kMaxImuGap_ns)) return;
  const double since_s = SecondsFromNs(t_ns_ - std::exchange(manoeuvre_ns_, t_ns_));
  const double before = manoeuvre_.variance_share();
  const Vector6d found = state_.acceleration.cwiseAbs2().cwiseQuotient(LivelyVariance());
  manoeuvre_.Note(since_s, NormalisedSquare(moved, expected) / 6,
                  std::max(found.head<3>().mean(), found.tail<3>().mean()));
  // So much more is possible than was when the acceleration was found.
  P_.diagonal().segment<6>(State::kA) += std::max(0.0, manoeuvre_.variance_share() - before) * LivelyVariance();
}

void MotionFilter::NoteFit(const Vector6d& moved, Shown shown, const Matrix6d& information, double variance_scale) {
  turn_misfit_shown_ *= std::exp(-read_turn_s_ / kShowsMisfit_s);
  push_misfit_shown_ *= std::exp(-read_push_s_ / kShowsMisfit_s);
  // Noisy poses look like a bad sensor. But as long as it leads them, a bad one is why they match badly.
  const double noise = 1 + (std::sqrt(std::max(1.0, variance_scale)) - 1) * (1 - gyroscope_trust());
  const double fitting = shown == Shown::kAligned ? kFittingSquare : kFittingSquareOfDepth;
  const auto note = [noise, fitting](const Eigen::Vector3d& by, const Eigen::Matrix3d& expected, double* read_s,
                                     double* misfit) {
    const double square = by.dot(expected.ldlt().solve(by)) / (3 * noise);
    NoteMisfit(square / fitting, std::exchange(*read_s, 0), misfit);
  };
  if (read_turn_s_ <= 0) return;
  const Matrix6d I = Matrix6d::Identity(), prior = PriorCovariance(shown);
  const Matrix6d expected = prior - (prior.ldlt().solve(I) + information).ldlt().solve(I);
  note(moved.tail<3>(), expected.bottomRightCorner<3, 3>(), &read_turn_s_, &turn_misfit_);
  note(moved.head<3>(), expected.topLeftCorner<3, 3>(), &read_push_s_, &push_misfit_);
  turn_misfit_shown_ = std::max(turn_misfit_shown_, turn_misfit_);
  push_misfit_shown_ = std::max(push_misfit_shown_, push_misfit_);
}

Matrix6d MotionFilter::velocity_covariance() const { return P_.block<6, 6>(State::kV, State::kV); }

double MotionFilter::delay_variance_s2() const { return P_(State::kDelay, State::kDelay); }

double MotionFilter::gyroscope_trust() const { return QuietShare() / std::sqrt(Widening(turn_misfit_)); }

double MotionFilter::QuietShare() const {
  return kGyroscopeSigma_rad_s / std::hypot(kGyroscopeSigma_rad_s, std::sqrt(noise_.turn_rad2_s / kUsualSpan_s));
}

bool MotionFilter::knows_acceleration() const {
  return force_m_s2_ > 0 && knows_gravity() && !FitsBadly(inertial_fit().accelerometer) &&
         P_.diagonal().segment<3>(State::kGravity).sum() < kKnownGravity_m_s2 * kKnownGravity_m_s2;
}

InertialFit MotionFilter::inertial_fit() const {
  if (!read_ns_) return {};
  InertialFit fit{std::sqrt(Widening(turn_misfit_shown_)), 0, force_m_s2_};
  if (force_m_s2_ > 0) fit.accelerometer = std::sqrt(Widening(push_misfit_shown_));
  return fit;
}

InertialMean MotionFilter::Usable(InertialMean inertial, double dt_s) {
  read_ns_ = t_ns_;
  noise_ = inertial.noise;
  if (!inertial.linear_acceleration) return inertial;
  const double force = inertial.linear_acceleration->norm();
  force_m_s2_ += (force - force_m_s2_) * (force_m_s2_ > 0 ? 1 - std::exp(-dt_s / kForceSpan_s) : 1);
  force_m_s2_ = std::max(force_m_s2_, std::numeric_limits<double>::min());
  const bool plausible = IsPlausibleForce(force_m_s2_);
  if (plausible && !knows_gravity()) LearnGravity(*inertial.linear_acceleration, dt_s);
  if (!plausible || !knows_gravity()) inertial.linear_acceleration.reset();
  return inertial;
}

void MotionFilter::LearnGravity(const Eigen::Vector3d& force_event, double span_s) {
  if (!IsPlausibleForce(force_event.norm())) return;
  state_.gravity_world = -kGravity_m_s2 * (state_.T_world_event.rotation() * force_event.normalized());
  const double sigma = std::clamp(kGravitySpeed_m_s / span_s, kMinGravitySigma_m_s2, kMaxGravitySigma_m_s2);
  P_.diagonal().segment<3>(State::kGravity).setConstant(sigma * sigma);
}

double MotionFilter::TurnSigma(const InertialMean& inertial, double dt_s) const {
  const double noise = std::sqrt(inertial.noise.turn_rad2_s / dt_s);
  return std::hypot(kGyroscopeSigma_rad_s, kGyroscopeShare * inertial.angular_velocity.norm(), noise) *
         std::sqrt(Widening(turn_misfit_));
}

double MotionFilter::PushSigma(const InertialMean& inertial, double dt_s) const {
  const double beyond_gravity = std::abs(inertial.linear_acceleration->norm() - kGravity_m_s2);
  const double noise = std::sqrt(inertial.noise.push_m2_s3 / dt_s);
  return std::hypot(kAccelerometerSigma_m_s2, kAccelerometerShare * beyond_gravity, noise) *
         std::sqrt(Widening(push_misfit_));
}

void MotionFilter::Correct(const InertialMean& inertial, const MotionFilter& before, const Change& F, double dt_s,
                           double error_share) {
  const double share_s = error_share * dt_s, turn_sigma = share_s * TurnSigma(inertial, dt_s);
  const double push_sigma = inertial.linear_acceleration ? share_s * PushSigma(inertial, dt_s) : 0;
  const auto stacked = Stacked(inertial, before.state_, state_, dt_s, turn_sigma, push_sigma);
  const auto &H = stacked.H_after, &H_before = stacked.H_before;
  const auto n = static_cast<int>(stacked.residual.size());

  // Covariances of the state now and of the measurement with it: the state before is correlated through F.
  Matrix C = before.P_;
  C.topRows<State::kChanging>() = (F * before.P_.topRows<State::kChanging>()).eval();
  const Eigen::Matrix<double, State::kSize, Eigen::Dynamic, 0, State::kSize, 6> P_z =
      P_ * H.transpose() + C * H_before.transpose();
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6> S =
      H * P_z + H_before * (C.transpose() * H.transpose() + before.P_ * H_before.transpose());
  S.diagonal() += stacked.variance;
  const auto square_of = [&](int row, int rows) {
    const auto part = stacked.residual.segment(row, rows);
    return part.dot(S.block(row, row, rows, rows).ldlt().solve(part).eval());
  };
  const double turn_square = square_of(0, 3), push_square = n == 6 ? square_of(3, 3) : 0;
  const double square = square_of(0, n);
  if (square > kMaxNormalisedSquare) S *= square / kMaxNormalisedSquare;
  const Eigen::Matrix<double, State::kSize, Eigen::Dynamic, 0, State::kSize, 6> gain =
      S.ldlt().solve(P_z.transpose()).transpose();
  state_.Correct(gain * stacked.residual);
  // How the readings differ from a fading acceleration grows with the acceleration, too: only poses tell of a delay.
  const double delay_variance = P_(State::kDelay, State::kDelay);
  P_ -= gain * S * gain.transpose();
  P_(State::kDelay, State::kDelay) = delay_variance;
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  NoteRefused(turn_square, dt_s, &turn_misfit_, &turn_misfit_shown_);
  NoteRefused(push_square, dt_s, &push_misfit_, &push_misfit_shown_);
}

void MotionFilter::Advance(std::int64_t t_ns, const InertialMean& inertial) {
  const double dt_s = SecondsFromNs(t_ns - t_ns_);
  if (dt_s <= 0) return;
  const InertialMean usable = Usable(inertial, dt_s);
  const double steady_s = std::max(kLongestSteady_s * (1 - QuietShare()), 1e-6);
  state_.steady_turn_acceleration +=
      (1 - std::exp(-dt_s / steady_s)) * (state_.acceleration.tail<3>() - state_.steady_turn_acceleration);
  // Before the state is copied: the readings are of both, and would seem to tell of the pose what one has and not the
  // other.
  LeaveRest();
  const MotionFilter before = *this;
  const Change F = Propagate(dt_s);
  t_ns_ = t_ns;
  Correct(usable, before, F, dt_s);
  read_turn_s_ += dt_s;
  if (usable.linear_acceleration) read_push_s_ += dt_s;
}

void MotionFilter::HoldStill(std::int64_t t_ns, const std::optional<InertialMean>& inertial,
                             const std::optional<InertialScatter>& scatter) {
  const double dt_s = SecondsFromNs(t_ns - t_ns_);
  t_ns_ = t_ns;
  if (!state_.velocity.isZero()) {
    before_rest_ = state_.velocity * state_.velocity.transpose() + velocity_covariance();
    rested_s_ = 0;
  }
  rested_s_ += dt_s;
  if (dt_s > 0) LetInertialWander(dt_s);
  const auto stand = [this] {
    state_.velocity.setZero();
    state_.StopSpeedingUp();
    SetMotion(Both(kStillSpeed_m_s, kStillTurn_rad_s));
    P_.block<6, 6>(State::kV, State::kV) += std::exp(-2 * rested_s_ / kMistaken_s) * before_rest_;
  };
  stand();
  if (!inertial || dt_s <= 0) return;
  const InertialMean usable = Usable(*inertial, dt_s);
  const Rigid3 T_world_event = state_.T_world_event;
  Correct(usable, *this, Change::Identity(), dt_s, ErrorShareAtRest(scatter));
  state_.T_world_event = T_world_event;
  stand();
}

void MotionFilter::GoOn(std::int64_t t_ns) {
  if (t_ns > t_ns_) PropagateTo(t_ns);
  t_ns_ = t_ns;
}

void MotionFilter::Coast(std::int64_t t_ns) {
  while (t_ns - t_ns_ > kLongestStep_ns) Coast(t_ns_ + kStep_ns);
  const double dt_s = SecondsFromNs(t_ns - t_ns_);
  if (dt_s > 0) Propagate(dt_s);
  t_ns_ = t_ns;
  state_.StopSpeedingUp();
  state_.velocity *= std::exp(-dt_s / kCoast_s);
  // Coasting for long must not let the covariance overflow what a search can cover. What does not change with time is
  // known as well as before.
  const double shrink = 1 / std::sqrt(std::max(1.0, P_.diagonal().head<6>().maxCoeff()));
  P_.topRows<State::kChanging>() *= shrink;
  P_.leftCols<State::kChanging>() *= shrink;
}

}  // namespace devo
