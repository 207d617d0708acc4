// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/apparent_turn.h"

#include <algorithm>
#include <iterator>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "devo/core/rigid3.h"

namespace devo {
namespace {

using Sighting = ApparentTurn::Sighting;

constexpr double kSpan_s = 0.04;

Camera TestCamera() { return {320, 240, 250, 250, 160.2, 119.7, "", {}}; }

/// Points seen by a camera of constant velocity, each once in a millisecond or so.
std::vector<Sighting> SightingsOf(const std::vector<Eigen::Vector3d>& points, const Vector6d& velocity_event) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> jitter(0, 1);
  std::vector<Sighting> events;
  for (double t_s = -kSpan_s; t_s < 0; t_s += 1e-3) {
    for (const Eigen::Vector3d& point : points) {
      if (jitter(random) > 0.5) continue;
      const double then_s = t_s + 1e-3 * jitter(random);
      const Eigen::Vector3d p = Exp(velocity_event * then_s).inverse() * point;
      events.push_back({static_cast<float>(then_s), static_cast<float>(p.x() / p.z()),
                        static_cast<float>(p.y() / p.z()), point.x() * point.y() > 0 ? 1 : 0});
    }
  }
  std::sort(events.begin(), events.end(), [](const Sighting& a, const Sighting& b) { return a.t_s < b.t_s; });
  return events;
}

/// Spread over the image, at one depth.
std::vector<Eigen::Vector3d> Points(double depth_m) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(-0.55, 0.55), y(-0.4, 0.4);
  std::vector<Eigen::Vector3d> points(200);
  for (Eigen::Vector3d& point : points) point = depth_m * Eigen::Vector3d(x(random), y(random), 1);
  return points;
}

std::vector<Sighting> Noise(std::size_t count) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> x(-0.6F, 0.6F), y(-0.45F, 0.45F);
  std::vector<Sighting> noise(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(count);
    noise[i] = {static_cast<float>(kSpan_s * (share - 1)), x(random), y(random), static_cast<int>(i % 2)};
  }
  return noise;
}

Vector6d Turning(double wx, double wy, double wz) {
  Vector6d velocity;
  velocity << 0, 0, 0, wx, wy, wz;
  return velocity;
}

TEST(ApparentTurn, FindsSlowAndFastTurnsOfAnyDirectionAtOnce) {
  for (const Vector6d& velocity :
       {Turning(0.3, 0, 0), Turning(0, -1.2, 0.3), Turning(-2, 1.5, 0), Turning(0.2, 4.5, -0.5), Turning(0, 0, 1.5)}) {
    ApparentTurn apparent(TestCamera());
    const Eigen::Vector3d turn = apparent.Estimate(SightingsOf(Points(2), velocity));
    // A pixel over the span is 0.1 rad/s.
    EXPECT_LT((turn - velocity.tail<3>()).norm(), 0.2)
        << turn.transpose() << ", not " << velocity.tail<3>().transpose();
  }
}

TEST(ApparentTurn, StandsForATranslationAtOneDepth) {
  Vector6d velocity = Vector6d::Zero();
  velocity.head<3>() << 1, -0.6, 0;
  ApparentTurn apparent(TestCamera());
  // To the right, things move to the left as they do when the camera turns to the right, about y.
  const Eigen::Vector3d turn = apparent.Estimate(SightingsOf(Points(2), velocity));
  EXPECT_LT((turn - Eigen::Vector3d(0.3, 0.5, 0)).norm(), 0.15) << turn.transpose();
}

TEST(ApparentTurn, FollowsATurnThatGrowsWhileItIsNotSoughtAmongAll) {
  ApparentTurn apparent(TestCamera());
  for (int i = 0; i < 20; ++i) {
    const Vector6d velocity = Turning(0, 0.1 + 0.1 * i, 0);
    const Eigen::Vector3d turn = apparent.Estimate(SightingsOf(Points(2), velocity));
    EXPECT_LT((turn - velocity.tail<3>()).norm(), 0.25) << i << ": " << turn.transpose();
  }
}

TEST(ApparentTurn, IsNoneForAStandingImageNoiseOrAHandfulOfEvents) {
  ApparentTurn apparent(TestCamera());
  EXPECT_EQ(apparent.Estimate(SightingsOf(Points(2), Turning(0, 0, 0))), Eigen::Vector3d::Zero());
  EXPECT_EQ(apparent.Estimate(Noise(8000)), Eigen::Vector3d::Zero());
  EXPECT_EQ(apparent.Estimate(SightingsOf({{0.1, 0.1, 1}, {0.2, -0.1, 1}}, Turning(0, 1, 0))), Eigen::Vector3d::Zero());
  EXPECT_EQ(apparent.Estimate({}), Eigen::Vector3d::Zero());
}

TEST(ApparentTurn, IsNotTemptedAlongEdgesOfOneDirection) {
  std::vector<Eigen::Vector3d> upright;
  for (double x = -0.5; x <= 0.5; x += 0.25) {
    for (double y = -0.4; y <= 0.4; y += 0.02) upright.emplace_back(2 * x, 2 * y, 2);
  }
  ApparentTurn apparent(TestCamera());
  const Eigen::Vector3d turn = apparent.Estimate(SightingsOf(upright, Turning(0, -1, 0)));
  EXPECT_NEAR(turn.y(), -1, 0.2);
  EXPECT_NEAR(turn.x(), 0, 0.2);
}

TEST(ApparentTurn, IsWhatAGyroscopeReadsWhereEventsTellNoOther) {
  const Eigen::Vector3d read(0.1, -1.2, 0.3);
  ApparentTurn apparent(TestCamera());
  EXPECT_EQ(apparent.Estimate({}, read), read);
  EXPECT_EQ(apparent.Estimate(Noise(8000), read), read);
}

TEST(ApparentTurn, AddsToAReadTurnWhatATranslationMovesTheImageBy) {
  Vector6d velocity = Turning(0.1, -1.2, 0.3);
  velocity.head<3>() << 1, -0.6, 0;
  ApparentTurn apparent(TestCamera());
  const Eigen::Vector3d turn = apparent.Estimate(SightingsOf(Points(2), velocity), velocity.tail<3>());
  EXPECT_LT((turn - Eigen::Vector3d(0.4, -0.7, 0.3)).norm(), 0.15) << turn.transpose();
}

TEST(ApparentTurn, IsFoundBesideAReadTurnAmongNoiseThatHidesItElse) {
  const Vector6d velocity = Turning(0, -1.2, -0.3);
  std::vector<Sighting> events;
  const std::vector<Sighting> points = SightingsOf(Points(2), velocity), noise = Noise(8 * points.size());
  std::merge(points.begin(), points.end(), noise.begin(), noise.end(), std::back_inserter(events),
             [](const Sighting& a, const Sighting& b) { return a.t_s < b.t_s; });
  const Eigen::Vector3d alone = ApparentTurn(TestCamera()).Estimate(events);
  EXPECT_TRUE(alone.isZero()) << alone.transpose();
  const Eigen::Vector3d turn = ApparentTurn(TestCamera()).Estimate(events, Eigen::Vector3d(0.1, -1.1, -0.3));
  EXPECT_LT((turn - velocity.tail<3>()).norm(), 0.2) << turn.transpose();
}

/// As seen at one common time, by what is believed of the motion; all things are 2 m away.
std::vector<Sighting> MovedAlong(const Vector6d& believed, std::vector<Sighting> events) {
  for (Sighting& event : events) {
    const Eigen::Vector3d p = Exp(believed * (event.t_s + kSpan_s / 2)) * (2 * Eigen::Vector3d(event.x, event.y, 1));
    event.x = static_cast<float>(p.x() / p.z());
    event.y = static_cast<float>(p.y() / p.z());
  }
  return events;
}

TEST(ApparentTurn, TakesPixelsOfSlantedEdgesThatAnswerInTurnForNoMotionAlongThem) {
  // Upright edges that move by less than a pixel: most of their events say nothing of time, those of some columns'
  // pixels come one after the other.
  std::mt19937 random(11);
  std::uniform_real_distribution<float> any(0, 1), height(-0.4F, 0.4F);
  std::vector<Sighting> events;
  for (int edge = 0; edge < 10; ++edge) {
    const float x = -0.5F + 0.1F * static_cast<float>(edge);
    for (int k = 0; k < 200; ++k) events.push_back({-static_cast<float>(kSpan_s) * any(random), x, height(random), 1});
    for (int column = 0; column < 5; ++column) {
      const float from = -0.4F + 0.16F * static_cast<float>(column);
      for (int k = 0; k < 14; ++k) {
        const float share = any(random);
        events.push_back({static_cast<float>(kSpan_s) * (share - 1), x, from + 0.056F * share, 1});
      }
    }
  }
  std::sort(events.begin(), events.end(), [](const Sighting& a, const Sighting& b) { return a.t_s < b.t_s; });
  const Eigen::Vector3d turn = ApparentTurn(TestCamera()).Estimate(events);
  EXPECT_TRUE(turn.isZero()) << turn.transpose();
}

TEST(ApparentTurn, FindsWhatABelievedMotionLacks) {
  ApparentTurn apparent(TestCamera());
  const Vector6d velocity = Turning(0.4, -0.8, 0.2);
  const std::vector<Sighting> events = SightingsOf(Points(2), velocity);
  for (const Vector6d& believed : {velocity, Turning(0.4, -0.3, 0.2), Turning(0.8, -0.8, 0), Turning(0, -1.2, 0.2)}) {
    const Eigen::Vector3d turn = apparent.Beside(MovedAlong(believed, events), believed.tail<3>());
    const Vector6d lacking = velocity - believed;
    EXPECT_LT((turn - lacking.tail<3>()).norm(), 0.12) << turn.transpose() << ", not " << lacking.tail<3>().transpose();
  }
}

TEST(ApparentTurn, StandsForTheTranslationThatABelievedMotionLacks) {
  Vector6d velocity = Turning(0.3, 0, 0), believed = velocity;
  velocity.head<3>() << 0.5, 0.2, 0;
  believed.head<3>() << -0.3, 0.2, 0;
  ApparentTurn apparent(TestCamera());
  const Eigen::Vector3d turn = apparent.Beside(MovedAlong(believed, SightingsOf(Points(2), velocity)), {0.2, -0.15, 0});
  EXPECT_LT((turn - Eigen::Vector3d(0, 0.4, 0)).norm(), 0.12) << turn.transpose();
}

TEST(ApparentTurn, FindsTheMotionAgainWhereWhatIsBelievedIsFarFromIt) {
  const Vector6d velocity = Turning(0.2, 0.4, 0);
  const std::vector<Sighting> events = SightingsOf(Points(2), velocity);
  for (const Vector6d& believed : {Turning(0.2, 2.4, 0), Turning(-1.5, -1.5, 0.5)}) {
    ApparentTurn apparent(TestCamera());
    const Eigen::Vector3d turn = apparent.Beside(MovedAlong(believed, events), believed.tail<3>());
    const Vector6d lacking = velocity - believed;
    EXPECT_LT((turn - lacking.tail<3>()).norm(), 0.15) << turn.transpose() << ", not " << lacking.tail<3>().transpose();
  }
}

TEST(ApparentTurn, AddsNothingToABelievedMotionForNoiseOrAHandfulOfEvents) {
  ApparentTurn apparent(TestCamera());
  const Eigen::Vector3d believed(0.1, 0.2, 0);
  EXPECT_EQ(apparent.Beside(Noise(8000), believed), Eigen::Vector3d::Zero());
  EXPECT_EQ(apparent.Beside(SightingsOf({{0.1, 0.1, 1}, {0.2, -0.1, 1}}, Turning(0, 1, 0)), believed),
            Eigen::Vector3d::Zero());
  EXPECT_EQ(apparent.Beside({}, believed), Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace devo
