// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/alignment.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

#include "devo/core/alignment_problem.h"
#include "numeric_jacobian.h"
#include "segment_scene.h"

namespace devo {
namespace {

Camera TestCamera() { return SegmentCamera(); }
std::vector<MapPoint> Scene() { return SegmentScene(10, 1); }
Surface Seen(const std::vector<MapPoint>& points, const Rigid3& T_event_ref, double radius_px = 4) {
  return SegmentsSeen(points, T_event_ref, radius_px);
}

PosePrior WeakPrior(const Rigid3& T_event_ref) { return {T_event_ref, 1e-3 * Matrix6d::Identity()}; }

Vector6d RandomTwist(double size, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(-size, size);
  return Vector6d::NullaryExpr([&] { return uniform(*random); });
}

std::vector<AlignmentPoint> Unspecific(const std::vector<MapPoint>& points) {
  std::vector<AlignmentPoint> out;
  for (const MapPoint& point : points) out.push_back({point.p_ref, 0, 0, 0, 1});
  return out;
}

/// Compares Jacobian and central differences at 100 random poses. Points are kept in single precision, good to 1e-5 px:
/// over steps of 0.2 mm and 0.2 mrad (0.04 px) differences are good to a percent where the robust loss bends.
void ExpectJacobian(const Surface& surface, const std::vector<MapPoint>& points, double offset,
                    const OdometryOptions& options) {
  std::mt19937 random(11);
  const auto prepared = Unspecific(points);
  for (int k = 0; k < 100; ++k) {
    PosePrior prior;
    prior.T_event_ref = Exp(RandomTwist(0.5 * offset, &random));
    prior.sqrt_information =
        100 * Matrix6d::Identity() + 10 * RandomTwist(1, &random) * RandomTwist(1, &random).transpose();
    const Camera camera = TestCamera();
    const AlignmentProblem problem(prepared, surface, camera, prior, Exp(RandomTwist(0.5 * offset, &random)), options);
    const Eigen::VectorXd delta = RandomTwist(0.5 * offset, &random);
    Eigen::VectorXd residuals(problem.NumResiduals());
    Eigen::MatrixXd jacobian(problem.NumResiduals(), 6);
    ASSERT_TRUE(problem(delta.data(), residuals.data(), jacobian.data()));
    const auto f = [&](const Eigen::VectorXd& x) {
      Eigen::VectorXd r(problem.NumResiduals());
      problem(x.data(), r.data(), nullptr);
      return r;
    };
    ASSERT_TRUE(JacobianIsNear("d residuals / d dtheta", jacobian, f, delta, 0.03, 2e-4)) << "pose " << k;
    // A test of matched points: the field says something of nearly all of them.
    const Eigen::Index n = static_cast<Eigen::Index>(points.size());
    ASSERT_GT((jacobian.topRows(n).rowwise().norm().array() > 1e-6).count(), 0.9 * n);
  }
}

/// One long straight edge: whichever of its crests is nearest, the distance to it is the same, so no association that
/// changes within a step shows in the differences.
std::vector<MapPoint> LongEdge() {
  std::vector<MapPoint> points;
  AddSegment({100, 20}, {140, 160}, 1.5, &points);
  return points;
}

/// Points of the long edge that stay beside it when the pose changes a little.
std::vector<MapPoint> MiddleOfLongEdge() {
  std::vector<MapPoint> points;
  AddSegment({105.7, 40}, {134.3, 140}, 1.5, &points);
  return points;
}

TEST(AlignmentJacobian, IsThatOfCentralDifferencesInTheCrestField) {
  OdometryOptions options;
  options.surface.truncation_px = 8;
  const Surface surface = Seen(LongEdge(), Rigid3(), 8);
  ExpectJacobian(surface, MiddleOfLongEdge(), 0.006, options);
  options.tracking.huber_share = 10;  // nothing is robust: squares alone
  ExpectJacobian(surface, MiddleOfLongEdge(), 0.006, options);
}

TEST(AlignmentJacobian, IsThatOfCentralDifferencesInThePlainSurface) {
  // A ramp is linear between and across pixels, so its gradient has no jumps.
  Surface across, down;
  across.image = cv::Mat1b(180, 240);
  down.image = cv::Mat1b(180, 240);
  for (int y = 0; y < 180; ++y) {
    for (int x = 0; x < 240; ++x) {
      across.image(y, x) = static_cast<std::uint8_t>(250 - x);
      down.image(y, x) = static_cast<std::uint8_t>(20 + y);
    }
  }
  ExpectJacobian(across, Scene(), 0.02, {});
  ExpectJacobian(down, Scene(), 0.02, {});
}

TEST(AlignmentJacobian, OfThePriorIsThatOfCentralDifferencesFarFromTheStart) {
  std::mt19937 random(17);
  const std::vector<AlignmentPoint> none;
  const Surface surface = Seen({}, Rigid3());
  const Camera camera = TestCamera();
  const OdometryOptions options;
  for (int k = 0; k < 100; ++k) {
    PosePrior prior;
    prior.T_event_ref = Exp(RandomTwist(1, &random));
    prior.sqrt_information = Matrix6d::Identity() + 0.3 * RandomTwist(1, &random) * RandomTwist(1, &random).transpose();
    const AlignmentProblem problem(none, surface, camera, prior, prior.T_event_ref * Exp(RandomTwist(0.05, &random)),
                                   options);
    const Eigen::VectorXd delta = RandomTwist(0.1, &random);
    Eigen::VectorXd residuals(6);
    Eigen::MatrixXd jacobian(6, 6);
    problem(delta.data(), residuals.data(), jacobian.data());
    const auto f = [&](const Eigen::VectorXd& x) {
      Eigen::VectorXd r(6);
      problem(x.data(), r.data(), nullptr);
      return r;
    };
    ASSERT_TRUE(JacobianIsNear("d prior / d dtheta", jacobian, f, delta, 1e-4)) << "pose " << k;
  }
}

TEST(AlignmentProblem, CompressedToSevenRowsHasTheProductsOfAllRows) {
  std::mt19937 random(17);
  const auto points = Scene();
  const Surface surface = Seen(points, Rigid3());
  const Camera camera = TestCamera();
  // Not a whole number of the batches in which rows are multiplied.
  for (const std::size_t count : {points.size(), points.size() - 1, std::size_t{33}, std::size_t{5}}) {
    const auto prepared = Unspecific({points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count)});
    const PosePrior prior{Exp(RandomTwist(0.01, &random)), 100 * Matrix6d::Identity()};
    const AlignmentProblem problem(prepared, surface, camera, prior, Exp(RandomTwist(0.01, &random)),
                                   OdometryOptions());
    const CompressedProblem compressed(problem);
    Vector6d at_first = RandomTwist(0.01, &random);
    for (const Vector6d& delta : {at_first, RandomTwist(0.01, &random), at_first}) {
      Eigen::VectorXd r(problem.NumResiduals());
      Eigen::MatrixXd J(problem.NumResiduals(), 6);
      ASSERT_TRUE(problem(delta.data(), r.data(), J.data()));
      Eigen::Matrix<double, 7, 1> few, cost_alone;
      Eigen::Matrix<double, 7, 6> J_few;
      // As the solver does: the cost of a step, then all of it.
      ASSERT_TRUE(compressed(delta.data(), cost_alone.data(), nullptr));
      ASSERT_TRUE(compressed(delta.data(), few.data(), J_few.data()));
      const double scale = J.squaredNorm();
      EXPECT_NEAR(cost_alone.squaredNorm(), r.squaredNorm(), 1e-5 * r.squaredNorm());
      EXPECT_NEAR(few.squaredNorm(), r.squaredNorm(), 1e-5 * r.squaredNorm());
      EXPECT_LT((J_few.transpose() * J_few - J.transpose() * J).norm(), 1e-5 * scale);
      EXPECT_LT((J_few.transpose() * few - J.transpose() * r).norm(), 1e-5 * std::sqrt(scale) * r.norm());
      EXPECT_LT((compressed.SumsAt(delta).of_points - J.topRows(count).transpose() * J.topRows(count)).norm(),
                1e-5 * scale);
    }
  }
}

TEST(AlignmentProblem, CompressedTellsASolverWithoutToleranceWhenTheCostHardlyChanges) {
  std::mt19937 random(18);
  const auto points = Scene();
  const auto prepared = Unspecific(points);
  const Surface surface = Seen(points, Rigid3());
  const Camera camera = TestCamera();
  const AlignmentProblem problem(prepared, surface, camera, WeakPrior(Rigid3()), Rigid3(), OdometryOptions());
  const Vector6d first = RandomTwist(0.01, &random), second = 0.9 * first;
  const double change = std::abs(problem.SumsAt(first).squared_norm - problem.SumsAt(second).squared_norm);
  ASSERT_GT(change, 0);
  const auto slope_at_second = [&](double function_tolerance) {
    const CompressedProblem compressed(problem, function_tolerance);
    Eigen::Matrix<double, 7, 1> r;
    Eigen::Matrix<double, 7, 6> J;
    EXPECT_TRUE(compressed(first.data(), r.data(), J.data()));
    EXPECT_GT(J.norm(), 0) << "there is no step before the first one";
    EXPECT_TRUE(compressed(second.data(), r.data(), J.data()));
    EXPECT_NEAR(r.squaredNorm(), problem.SumsAt(second).squared_norm, 1e-9 * r.squaredNorm());
    return (J.transpose() * r).norm();
  };
  EXPECT_GT(slope_at_second(0.99 * change), 0);
  EXPECT_EQ(slope_at_second(1.01 * change), 0);
}

TEST(AlignmentProblem, IsForwardCompositionalThePerturbationActsOnThePointsInTheReferenceFrame) {
  const auto points = Scene();
  const auto prepared = Unspecific(points);
  const Surface surface = Seen(points, Rigid3());
  const Camera camera = TestCamera();
  const OdometryOptions options;
  Vector6d delta;
  delta << 0.01, -0.005, 0.02, 0.004, 0.003, -0.01;
  const Rigid3 T_event_ref = Exp(0.5 * delta.reverse());
  const PosePrior prior = WeakPrior(T_event_ref);
  const AlignmentProblem at_start(prepared, surface, camera, prior, T_event_ref, options);
  const AlignmentProblem moved(prepared, surface, camera, prior, T_event_ref * Exp(delta), options);
  Eigen::VectorXd a(at_start.NumResiduals()), b(moved.NumResiduals());
  const Vector6d zero = Vector6d::Zero();
  at_start(delta.data(), a.data(), nullptr);
  moved(zero.data(), b.data(), nullptr);
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Alignment, StaysWhereEveryPointMeetsItsEdge) {
  const auto points = Scene();
  const auto result = Align(points, Seen(points, Rigid3()), TestCamera(), WeakPrior(Rigid3()), Vector6d::Zero(), {});
  EXPECT_LT(Log(result.T_event_ref).norm(), 1e-5);
  EXPECT_GT(result.visible, 0.95 * static_cast<double>(points.size()));
  EXPECT_EQ(result.matched, result.visible);
  EXPECT_DOUBLE_EQ(result.inlier_share, 1);
  EXPECT_LT(result.mean_residual_px, 1e-3);
}

TEST(Alignment, FindsThePoseFromAStartThatIsOffAlongEachAxis) {
  const auto points = Scene();
  const Rigid3 truth = Exp(0.05 * Vector6d::Ones());
  const Surface surface = Seen(points, truth);
  // About two pixels each.
  for (int axis = 0; axis < 6; ++axis) {
    for (const double sign : {-1, 1}) {
      const double size = axis < 2 ? 0.015 : axis == 2 ? 0.04 : axis < 5 ? 0.01 : 0.03;
      const Rigid3 start = truth * Exp(sign * size * Vector6d::Unit(axis));
      const auto result = Align(points, surface, TestCamera(), WeakPrior(start), Vector6d::Zero(), {});
      EXPECT_LT(Log(truth.inverse() * result.T_event_ref).norm(), 5e-4) << "axis " << axis << " sign " << sign;
    }
  }
}

TEST(Alignment, FindsThePoseFromStartsThatAreOffInAllSixDirections) {
  const auto points = Scene();
  std::mt19937 random(12);
  const Rigid3 truth = Exp(-0.04 * Vector6d::Ones());
  const Surface surface = Seen(points, truth);
  for (int k = 0; k < 20; ++k) {
    const Rigid3 start = truth * Exp(RandomTwist(0.006, &random));
    const auto result = Align(points, surface, TestCamera(), WeakPrior(start), Vector6d::Zero(), {});
    EXPECT_LT(Log(truth.inverse() * result.T_event_ref).norm(), 5e-4) << k;
  }
}

TEST(Alignment, EnduresThirtyPercentOfPointsThatBelongToNoEdge) {
  auto points = Scene();
  const Rigid3 truth = Exp(0.03 * Vector6d::Ones());
  const Surface surface = Seen(points, truth);
  std::mt19937 random(13);
  std::uniform_real_distribution<double> share(0, 1), x(10, 230), y(10, 170), z(1, 3);
  std::size_t outliers = 0;
  for (MapPoint& point : points) {
    if (share(random) > 0.3) continue;
    point.p_ref = (z(random) * *TestCamera().Unproject({x(random), y(random)})).cast<float>();
    ++outliers;
  }
  ASSERT_GT(outliers, points.size() / 4);
  const auto result =
      Align(points, surface, TestCamera(), WeakPrior(truth * Exp(0.004 * Vector6d::Ones())), Vector6d::Zero(), {});
  EXPECT_LT(Log(truth.inverse() * result.T_event_ref).norm(), 3e-3);
  EXPECT_LT(result.inlier_share, 0.9);
}

TEST(Alignment, OfOneStraightEdgeStaysAtThePriorAlongItAndItsInformationHasRankTwo) {
  std::vector<MapPoint> edge, middle;  // upright in the image
  AddSegment({119.5, 10}, {119.5, 170}, 2, &edge);
  AddSegment({119.5, 60}, {119.5, 120}, 2, &middle);
  const Surface surface = Seen(edge, Rigid3());
  PosePrior prior;
  prior.T_event_ref = Rigid3::Translation({0.01, 0.02, 0});  // one pixel across the edge, two along it
  prior.sqrt_information = 1e-2 * Matrix6d::Identity();
  const auto result = Align(middle, surface, TestCamera(), prior, Vector6d::Zero(), {});
  EXPECT_NEAR(result.T_event_ref.translation().y(), 0.02, 1e-4);
  EXPECT_LT(result.mean_residual_px, 0.05);
  const Vector6d eigenvalues = result.information.selfadjointView<Eigen::Lower>().eigenvalues();  // ascending
  EXPECT_LT(eigenvalues[3], 1e-6 * eigenvalues[5]);
  EXPECT_GT(eigenvalues[4], 1e-6 * eigenvalues[5]);
}

TEST(Alignment, DoesNotMatchEdgesOfAnotherDirectionOrOppositePolarity) {
  std::vector<MapPoint> upright, lying;
  AddSegment({119.5, 60}, {119.5, 120}, 2, &upright);
  AddSegment({90, 89.5}, {150, 89.5}, 2, &lying);
  EXPECT_EQ(Align(lying, Seen(upright, Rigid3()), TestCamera(), WeakPrior(Rigid3()), Vector6d::Zero(), {}).matched, 0);

  // Brighter along the normal, moving along it: the pixels that it passes turn darker.
  for (MapPoint& point : upright) point.sign = 1;
  Vector6d velocity = Vector6d::Zero();
  velocity[0] = upright.front().normal_ref.x() > 0 ? -1 : 1;
  Surface surface = Seen(upright, Rigid3());
  for (const float polarity : {-1.0F, 1.0F}) {
    for (EdgePoint& edge : surface.edges) edge.polarity = polarity;
    const auto result = Align(upright, surface, TestCamera(), WeakPrior(Rigid3()), velocity, {});
    EXPECT_EQ(result.matched, polarity < 0 ? result.visible : 0);
  }
}

TEST(Alignment, MatchesEdgesOfAnyDirectionOrPolarityWhenThatIsSwitchedOff) {
  std::vector<MapPoint> upright, lying;
  AddSegment({119.5, 60}, {119.5, 120}, 2, &upright);
  AddSegment({90, 89.5}, {150, 89.5}, 2, &lying);
  OdometryOptions options;
  options.tracking.ideas.match_direction = false;
  const Surface surface = Seen(upright, Rigid3());
  EXPECT_GT(Align(lying, surface, TestCamera(), WeakPrior(Rigid3()), Vector6d::Zero(), options).matched, 0);

  options = OdometryOptions();
  options.tracking.ideas.match_polarity = false;
  for (MapPoint& point : upright) point.sign = 1;
  for (const float polarity : {-1.0F, 1.0F}) {
    Surface signed_surface = Seen(upright, Rigid3());
    for (EdgePoint& edge : signed_surface.edges) edge.polarity = polarity;
    const auto result = Align(upright, signed_surface, TestCamera(), WeakPrior(Rigid3()), Vector6d::Unit(0), options);
    EXPECT_EQ(result.matched, result.visible);
  }
}

TEST(Alignment, WeighsAnEdgeThatMovesAlongItselfATenthUnlessThatIsSwitchedOff) {
  std::vector<MapPoint> upright;
  AddSegment({119.5, 60}, {119.5, 120}, 2, &upright);
  const Surface surface = Seen(upright, Rigid3());
  const auto information = [&](const OdometryOptions& options) {
    return Align(upright, surface, TestCamera(), WeakPrior(Rigid3()), Vector6d::Unit(1), options).information.trace();
  };
  OdometryOptions off;
  off.tracking.ideas.visibility_weight = false;
  EXPECT_NEAR(information(off) / information(OdometryOptions()), 10, 0.01);
}

TEST(Alignment, WeighsAPointOfGuessedDepthByHowFarThatMayPlaceItAcrossItsEdge) {
  std::vector<MapPoint> upright;
  AddSegment({119.5, 60}, {119.5, 120}, 2, &upright);
  // From the view that made them the depth does not show, from 5 cm aside a centimetre of it does.
  const auto weight = [&upright](const Rigid3& T_event_ref, float sigma_m, double way_m = 0) {
    std::vector<MapPoint> guessed = upright;
    for (MapPoint& point : guessed) point.sigma_depth_ref = sigma_m * point.p_ref / point.p_ref.z();
    const auto information = [&](const std::vector<MapPoint>& points) {
      PosePrior prior = WeakPrior(T_event_ref);
      prior.position_covariance = way_m * way_m * Eigen::Matrix3d::Identity();
      return Align(points, Seen(points, T_event_ref), TestCamera(), prior, Vector6d::Unit(0), {}).information.trace();
    };
    return information(guessed) / information(upright);
  };
  const Rigid3 aside = Rigid3::Translation({0.05, 0, 0});
  EXPECT_NEAR(weight(Rigid3(), 1), 1, 1e-3);
  const double by_centimetre_px = TestCamera().fx() * 0.05 * 0.01 / (2 * 2);
  EXPECT_NEAR(weight(aside, 0.01F), 1 / (1 + std::pow(by_centimetre_px / 0.15, 2)), 0.01);
  EXPECT_LT(weight(aside, 0.5F), 0.02);
  EXPECT_NEAR(weight(aside, 0), 1, 1e-6);
  // Where the camera's own way is not known, the depth may show as well.
  const double by_way_px = TestCamera().fx() * 0.01 * 0.5 / (2 * 2);
  EXPECT_NEAR(weight(Rigid3(), 0.5F, 0.01), 1 / (1 + std::pow(by_way_px / 0.15, 2)), 0.01);
  EXPECT_NEAR(weight(Rigid3(), 0, 0.01), 1, 1e-6);
}

TEST(Alignment, ChargesForPointsWithoutAnEdgeUnlessThatIsSwitchedOff) {
  const Surface surface = Seen({}, Rigid3());
  const auto cost = [&](const OdometryOptions& options) {
    return Align(Scene(), surface, TestCamera(), WeakPrior(Rigid3()), Vector6d::Zero(), options).cost;
  };
  OdometryOptions off;
  off.tracking.ideas.unmatched_cost = false;
  EXPECT_GT(cost(OdometryOptions()), 0.1);
  EXPECT_EQ(cost(off), 0);
}

TEST(Alignment, LooksCloserOnceItIsNearSoThatEdgesBesideTheTrueOnesPullLess) {
  const auto points = Scene();
  Surface surface = Seen(points, Rigid3());
  // Of every third crest only a neighbour is seen, 2.5 px beside it and always to the right.
  for (std::size_t i = 0; i < surface.edges.size(); i += 3) surface.edges[i].x += 2.5F;
  BuildNearestEdgeField(surface.edges, 4, &surface.nearest_edge);
  const auto error_px = [&](const OdometryOptions& options) {
    const PosePrior start = WeakPrior(Exp(0.003 * Vector6d::Ones()));
    const auto result = Align(points, surface, TestCamera(), start, Vector6d::Zero(), options);
    double sum = 0;
    for (const MapPoint& point : points) {
      const Eigen::Vector3d p = point.p_ref.cast<double>();
      sum += (*TestCamera().Project(result.T_event_ref * p) - *TestCamera().Project(p)).norm();
    }
    return sum / static_cast<double>(points.size());
  };
  OdometryOptions once;
  once.tracking.ideas.fine_alignment = false;
  EXPECT_LT(error_px(OdometryOptions()), 0.7 * error_px(once));
}

std::vector<AlignmentPoint> OfKnownNormals(const std::vector<MapPoint>& points) {
  std::vector<AlignmentPoint> out = Unspecific(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    out[i].normal_x = points[i].normal_ref.x();
    out[i].normal_y = points[i].normal_ref.y();
  }
  return out;
}

/// Of an alignment that begins where it ends.
Matrix6d CredibleInformation(const std::vector<MapPoint>& points, const Surface& surface, bool doubt_normals) {
  PosePrior prior = WeakPrior(Rigid3());
  prior.doubt_normals = doubt_normals;
  return Align(points, surface, TestCamera(), prior, Vector6d::Zero(), OdometryOptions()).credible_information;
}

TEST(AlignmentProblem, MotionAlongTheEdgesIsMotionAcrossOnesThatAreTurnedByARightAngle) {
  const auto points = Scene();
  const Camera camera = TestCamera();
  const Surface surface = Seen(points, Rigid3()), turned = WithTurnedNormals(surface, M_PI / 2, 0);
  const auto known = OfKnownNormals(points), unspecific = Unspecific(points);
  OdometryOptions squares;
  squares.tracking.huber_share = 10;
  const AlignmentProblem problem(known, surface, camera, {}, Rigid3(), squares);
  const AlignmentProblem across_turned(unspecific, turned, camera, {}, Rigid3(), squares);
  const Matrix6d along = problem.NormalsAt(Rigid3()).along, expected = across_turned.SumsAt(Vector6d::Zero()).of_points;
  EXPECT_LT((along - expected).norm(), 0.01 * expected.norm());
}

TEST(AlignmentProblem, MeasuresHowNormalsOfPointsAndOfTheirEdgesDiffer) {
  const auto points = Scene();
  const Camera camera = TestCamera();
  const auto known = OfKnownNormals(points);
  for (const double sigma_rad : {0.0, 0.05, 0.15}) {
    const Surface surface = WithTurnedNormals(Seen(points, Rigid3()), 0, sigma_rad);
    const AlignmentProblem problem(known, surface, camera, {}, Rigid3(), {});
    EXPECT_NEAR(std::sqrt(problem.NormalsAt(Rigid3()).angle_variance), sigma_rad, 0.01 + 0.05 * sigma_rad);
  }
}

TEST(Alignment, KnowsNothingOfAMotionAlongStripesWhateverTheNoiseOfTheirNormals) {
  std::vector<MapPoint> points;
  for (int x = 20; x <= 220; x += 10) AddSegment({x, 20}, {x, 160}, 1.5, &points);
  const Surface surface = WithTurnedNormals(Seen(points, Rigid3()), 0, 0.15);
  const Matrix6d with = CredibleInformation(points, surface, true);
  const Matrix6d without = CredibleInformation(points, surface, false);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(with);
  EXPECT_GT(eigen.eigenvalues()(0), -1e-6 * with.trace());
  EXPECT_GT(with(0, 0), 0.9 * without(0, 0)) << "across them";
  EXPECT_GT(without(1, 1), 0.01 * without(0, 0)) << "along them, as if their normals were exact";
  EXPECT_LT(with(1, 1), 0.2 * without(1, 1));
}

TEST(Alignment, KeepsWhatEdgesOfAllDirectionsTell) {
  const auto points = Scene();
  const Surface surface = WithTurnedNormals(Seen(points, Rigid3()), 0, 0.1);
  const Matrix6d with = CredibleInformation(points, surface, true);
  const Matrix6d without = CredibleInformation(points, surface, false);
  for (int axis = 0; axis < 6; ++axis) EXPECT_GT(with(axis, axis), 0.9 * without(axis, axis)) << axis;
}

TEST(Alignment, WithoutPointsOrEdgesStaysAtThePrior) {
  const Rigid3 start = Exp(0.1 * Vector6d::Ones());
  const auto no_points = Align({}, Seen(Scene(), Rigid3()), TestCamera(), WeakPrior(start), Vector6d::Zero(), {});
  const auto no_edges = Align(Scene(), Seen({}, Rigid3()), TestCamera(), WeakPrior(start), Vector6d::Zero(), {});
  for (const auto& result : {no_points, no_edges}) {
    EXPECT_LT(Log(start.inverse() * result.T_event_ref).norm(), 1e-9);
    EXPECT_EQ(result.matched, 0);
    EXPECT_EQ(result.inlier_share, 0);
    EXPECT_TRUE(result.information.isZero());
    EXPECT_TRUE(std::isfinite(result.cost));
  }
}

}  // namespace
}  // namespace devo
