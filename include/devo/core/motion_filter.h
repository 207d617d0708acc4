// SPDX-License-Identifier: BSD-3-Clause
//
// What the motion so far says of the next pose: a Kalman filter on SE(3) whose state is pose, velocity and
// acceleration, driven by white jerk, with the acceleration fading (Singer, "Estimating optimal tracking filter
// performance for manned maneuvering targets", 1970). Its prediction is the prior of the alignment, so that
// directions that one surface leaves open are held by what earlier surfaces said of them. An inertial sensor, where
// there is one, measures how rotation and velocity change from pose to pose; its biases, scales, mounting and place,
// the direction of gravity and the delay of events against it are states too (as Furgale, Rehder and Siegwart
// calibrate, "Unified temporal and spatial calibration for multi-sensor systems", 2013; Rehder et al., "Extending
// kalibr", 2016). Its noise is not taken for granted: the more poses contradict it, the less it counts (after Sage and
// Husa, "Adaptive filtering with unknown prior statistics", 1969).
//
// What alignments to successive surfaces err alike (the same points, the same smear) is no noise, and would pass for
// motion: it is a state too, a first-order Gauss-Markov process (coloured measurement noise: Bryson and Henrikson,
// "Estimation using sampled data containing sequentially correlated noise", 1968).
#pragma once

#include <cstdint>
#include <optional>

#include <Eigen/Core>

#include "devo/core/inertial_buffer.h"
#include "devo/core/inertial_fit.h"
#include "devo/core/manoeuvre.h"
#include "devo/core/motion_state.h"
#include "devo/core/options.h"
#include "devo/core/rigid3.h"

namespace devo {

/// Not thread-safe.
class MotionFilter {
 public:
  explicit MotionFilter(const TrackingOptions& options) : options_(options) {}

  void SetOptions(const TrackingOptions& options) { options_ = options; }

  static constexpr double kStartSpeed_m_s = 0.3;
  /// Starts with a velocity [v; omega] of and in the event frame, by default at rest, known to
  /// within `speed_sigma_m_s` and 1 rad/s, at a pose known to a millimetre and milliradian. What is known of gravity
  /// and of the inertial sensor stays.
  void Start(std::int64_t t_ns, const Rigid3& T_world_event, const Vector6d& velocity_event = Vector6d::Zero(),
             double speed_sigma_m_s = kStartSpeed_m_s);

  /// The same moment in another world, in which the pose is as well known as at a start.
  void Anchor(const Rigid3& T_world_event);

  /// As if no inertial sensor had ever been read; pose and motion stay.
  void ForgetInertial();

  struct Prediction {
    Rigid3 T_world_event;
    Vector6d velocity_event;       ///< [v; omega], m/s and rad/s
    Matrix6d velocity_covariance;  ///< of velocity_event
    Matrix6d covariance;           ///< of a right perturbation [rho; phi] of T_world_event, m and rad
    /// Where an alignment will find the camera: with the error that it shares with those before it.
    Rigid3 T_world_aligned;
    Matrix6d aligned_covariance;  ///< of a right perturbation [rho; phi] of it, m and rad
  };
  /// At a time at or after the last update.
  Prediction Predict(std::int64_t t_ns) const;

  /// Of a camera that stands where it is.
  Prediction AtRest() const;

  /// Takes the pose that maximises prior and measurement together, where the measurement shares no error with
  /// alignments, and its information on a right perturbation of it (without the prior). `variance_scale`: the squares
  /// of such measurements' errors, as they are seen, over what the information says; for judging the inertial sensor
  /// only.
  void Update(std::int64_t t_ns, const Rigid3& T_world_event, const Matrix6d& information, double variance_scale = 1);

  /// What an alignment says of the pose, whatever was predicted: to second order about `T_world_aligned`.
  struct Likelihood {
    Rigid3 T_world_aligned;
    Matrix6d information;   ///< of its own errors, on a right perturbation
    Vector6d gradient;      ///< of half the squared error
    double shared;          ///< variance of the error that successive alignments share, over that of their own
    double variance_scale;  ///< as of Update
    /// As if this share of what was aligned had told it.
    void Weigh(double share) {
      information *= share;
      gradient *= share;
    }
  };
  /// Of the alignment that found this pose together with that prediction.
  static Likelihood LikelihoodOf(const Prediction& predicted, const Rigid3& T_world_aligned,
                                 const Matrix6d& information, double shared, double variance_scale);
  /// Takes an alignment, whatever it was predicted with.
  void Update(std::int64_t t_ns, const Likelihood& measured);

  /// Which way is down, from the mean specific force (m/s^2, event frame) over `span_s` before: the longer, the less a
  /// change of velocity counts in it. To be called once, before Advance, which otherwise takes its first reading. A
  /// force that cannot be gravity is not taken.
  void LearnGravity(const Eigen::Vector3d& force_event, double span_s);
  bool knows_gravity() const { return !state_.gravity_world.isZero(); }

  /// The pose's variance is so many times what is stated, for a reason that its velocity has no part in: corrections
  /// of the pose tell the less of that.
  void WidenPose(double times);

  /// The same of all that is stated, where the velocity and what is known of gravity have led the pose astray:
  /// corrections of the pose tell of them, too.
  void Widen(double times) { P_ *= times; }

  /// A gap longer than this is gone through in steps: within one of half a second an acceleration would neither fade
  /// nor a force turn with the camera.
  static constexpr std::int64_t kLongestStep_ns = 50'000'000, kStep_ns = 10'000'000;

  /// Goes on to `t_ns` with what an inertial sensor read since the last update, at most kLongestStep_ns before.
  void Advance(std::int64_t t_ns, const InertialMean& inertial);

  /// The camera is known to stand still; what an inertial sensor reads then is its bias and gravity. `scatter`: of such
  /// readings over the whole rest, where it is known for certain; without it they count as if it moved.
  void HoldStill(std::int64_t t_ns, const std::optional<InertialMean>& inertial = std::nullopt,
                 const std::optional<InertialScatter>& scatter = std::nullopt);

  /// Goes on with the prediction, to what is measured then.
  void GoOn(std::int64_t t_ns);

  /// Nothing was measured: goes on with the prediction, slowing down.
  void Coast(std::int64_t t_ns);

  std::int64_t time_ns() const { return t_ns_; }
  const Rigid3& pose() const { return state_.T_world_event; }
  Matrix6d pose_covariance() const { return P_.topLeftCorner<6, 6>(); }
  const Vector6d& velocity_event() const { return state_.velocity; }          ///< [v; omega], m/s and rad/s
  Matrix6d velocity_covariance() const;                                       ///< of [v; omega], m/s and rad/s
  const Vector6d& acceleration_event() const { return state_.acceleration; }  ///< its change, m/s^2 and rad/s^2
  bool started() const { return started_; }
  /// What the sensor reads over [a, b] is to be given for [a + delay_s, b + delay_s].
  const MotionState& state() const { return state_; }
  double delay_variance_s2() const;
  /// A good gyroscope's errors over those that it is taken to have now, up to 1.
  double gyroscope_trust() const;
  /// Whether an accelerometer that fits the motion is in use, and it is known which way is down.
  bool knows_acceleration() const;
  /// Of the sensor's readings with the poses, about the worst of the last seconds; without its noise.
  InertialFit inertial_fit() const;
  void Reset();

 private:
  using Matrix = Eigen::Matrix<double, MotionState::kSize, MotionState::kSize>;
  using Change = Eigen::Matrix<double, MotionState::kChanging, MotionState::kChanging>;

  /// What a measurement shows: the pose, or where alignments find it.
  enum class Shown { kPose, kAligned };
  using Columns = Eigen::Matrix<double, MotionState::kSize, 6>;

  void SetPoseAsAtStart(const Rigid3& T_world_event);
  void SetMotion(const Vector6d& sigma_velocity);
  /// A rest before this moment, if there was one, is over.
  void LeaveRest();
  /// Returns the derivative of what changes by what it was.
  Change Propagate(double dt_s);
  /// In steps so short that nothing changes much within one.
  void PropagateTo(std::int64_t t_ns);
  /// What is not known of the motion in this time.
  void AddJerk(double dt_s);
  /// The same of the inertial sensor, and of gravity.
  void LetInertialWander(double dt_s);
  /// `error_share`: of the errors that the sensor has in motion.
  void Correct(const InertialMean& inertial, const MotionFilter& before, const Change& F, double dt_s,
               double error_share = 1);
  /// Of this moment, with this velocity.
  Prediction Now(const Vector6d& velocity_event) const;
  Rigid3 Predicted(Shown shown) const;
  /// Of the state with what is shown.
  Columns CovarianceWith(Shown shown) const;
  Matrix6d CovarianceOf(Shown shown) const;
  Matrix6d PriorCovariance(Shown shown) const;
  void Condition(std::int64_t t_ns, Shown shown, const Rigid3& T_world_measured, const Matrix6d& information,
                 double variance_scale);
  /// Of the accelerations [a; alpha] of a lively motion, as options have them.
  Vector6d LivelyVariance() const;
  /// `moved`: from the predicted pose to the measured one; `expected`: what was stated of that.
  void NoteManoeuvre(const Vector6d& moved, const Matrix6d& expected);
  /// `moved`: from what was predicted to what was measured.
  void NoteFit(const Vector6d& moved, Shown shown, const Matrix6d& information, double variance_scale);
  /// Without the accelerometer where that cannot be one in m/s^2.
  InertialMean Usable(InertialMean inertial, double dt_s);
  /// Of the errors of a good gyroscope in those that this one has with its noise.
  double QuietShare() const;
  /// Standard deviations of the sensor's readings in motion, rad/s and m/s^2.
  double TurnSigma(const InertialMean& inertial, double dt_s) const;
  double PushSigma(const InertialMean& inertial, double dt_s) const;

  TrackingOptions options_;
  Manoeuvre manoeuvre_;
  std::int64_t manoeuvre_ns_ = 0;  // of the pose that it was told of last
  bool started_ = false;
  std::int64_t t_ns_ = 0;
  MotionState state_;
  Matrix6d shared_variance_ = Matrix6d::Zero();  // that it tends to
  double turn_misfit_ = 0, push_misfit_ = 0;     // variances of gyroscope and accelerometer over those of good ones
  double turn_misfit_shown_ = 0, push_misfit_shown_ = 0;
  double read_turn_s_ = 0, read_push_s_ = 0;  // since the last pose
  double force_m_s2_ = 0;                     // mean; 0: not known
  std::optional<std::int64_t> read_ns_;       // the inertial sensor, last
  InertialNoise::Density noise_;              // as last read
  // Of the state; of the pose as a right perturbation.
  Matrix P_ = Matrix::Zero();
  Matrix6d before_rest_ = Matrix6d::Zero();  // mean square of the velocity, while it is held still
  double rested_s_ = 0;
};

}  // namespace devo
