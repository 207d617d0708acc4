// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/surface_builder.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "devo/core/time.h"

namespace devo {
namespace {

using ::testing::IsEmpty;

constexpr int kWidth = 160, kHeight = 120;
const std::int64_t kT_ns = NsFromSeconds(10);

Camera TestCamera() { return {kWidth, kHeight, 150, 150, 80.3, 59.6, "", {}}; }

Event At(std::int64_t t_ns, int x, int y) {
  return {t_ns, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1};
}

Vector6d Twist(double vx, double vy, double vz, double wx, double wy, double wz) {
  Vector6d twist;
  twist << vx, vy, vz, wx, wy, wz;
  return twist;
}

/// No filter: the events of these tests have no noise.
SurfaceOptions WithoutFilter() {
  SurfaceOptions options;
  options.noise_neighbours = 0;
  options.hot_pixel_factor = 0;
  return options;
}

/// A static edge between two points (event frame at kT_ns, metres) under a constant acceleration of the camera.
struct MovingEdge {
  Eigen::Vector3d a, b;
  Vector6d velocity;  // at kT_ns
  Vector6d acceleration = Vector6d::Zero();

  /// Column in which the edge crosses a row.
  double ColumnAt(std::int64_t t_ns, double row) const {
    const double since_s = SecondsFromNs(t_ns - kT_ns);
    const Rigid3 T_event_scene = Exp(since_s * (velocity + 0.5 * since_s * acceleration)).inverse();
    const Camera camera = TestCamera();
    const Eigen::Vector2d u = *camera.Project(T_event_scene * a), v = *camera.Project(T_event_scene * b);
    return u.x() + (row - u.y()) / (v.y() - u.y()) * (v.x() - u.x());
  }

  /// One event whenever the edge crosses the centre of a pixel in rows 10 to 109, over the last 40 ms.
  std::vector<Event> Events() const {
    constexpr std::int64_t kStep_ns = 100'000;
    std::vector<Event> events;
    for (int row = 10; row < 110; ++row) {
      double before = ColumnAt(kT_ns - 400 * kStep_ns, row);
      for (std::int64_t t_ns = kT_ns - 399 * kStep_ns; t_ns < kT_ns; t_ns += kStep_ns) {
        const double now = ColumnAt(t_ns, row);
        if (std::floor(now) != std::floor(before)) {
          const double column = std::max(std::floor(now), std::floor(before));
          const double share = (column - now) / (now - before);  // -1 to 0
          if (column >= 0 && column < kWidth) {
            events.push_back(At(t_ns + std::llround(share * kStep_ns), static_cast<int>(column), row));
          }
        }
        before = now;
      }
    }
    std::sort(events.begin(), events.end(), [](const Event& e, const Event& f) { return e.t_ns < f.t_ns; });
    return events;
  }
};

SurfacePtr SurfaceOf(const std::vector<Event>& events, const std::optional<ExpectedMotion>& motion, double median_m,
                     const SurfaceOptions& options = WithoutFilter()) {
  SurfaceBuilder builder(TestCamera(), options);
  builder.Insert(events);
  SceneDepth depth;
  depth.median_m = median_m;
  return builder.Render(kT_ns, motion, depth);
}

/// Distances along the row from the crests (but those at the edge's ends) to the true edge at the surface's t_edges_ns.
std::vector<double> CrestErrors(const Surface& surface, const MovingEdge& edge) {
  std::vector<double> errors;
  for (const EdgePoint& crest : surface.edges) {
    if (crest.y < 15 || crest.y > 104) continue;
    errors.push_back(crest.x - edge.ColumnAt(surface.t_edges_ns, crest.y));
  }
  return errors;
}

double Mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value / static_cast<double>(values.size());
  return sum;
}

MovingEdge EdgeUnder(const Vector6d& velocity) { return {{0.05, -1, 2}, {-0.1, 1, 2}, velocity}; }

TEST(CompensatedSurface, ShowsAMovingEdgeAsOneCrestWhereItWasAtTheMeanTimeOfItsEvents) {
  for (const Vector6d& velocity : {Twist(2, 0, 0, 0, 0, 0), Twist(-2, 0.5, 0, 0, 0, 0), Twist(0, 0, 0, 0, 1.5, 0),
                                   Twist(0, 0, 0, 0.2, -1, 1), Twist(1.5, 0, 0.3, 0.3, 0.6, -0.5)}) {
    const MovingEdge edge = EdgeUnder(velocity);
    const auto surface = SurfaceOf(edge.Events(), velocity, 2);
    EXPECT_EQ(surface->t_ns, kT_ns);
    EXPECT_LT(surface->t_edges_ns, kT_ns - NsFromSeconds(0.01));
    const auto errors = CrestErrors(*surface, edge);
    // At least one per row, and not two beside each other.
    EXPECT_GE(errors.size(), 80U) << velocity.transpose();
    EXPECT_LE(errors.size(), 120U) << velocity.transpose();
    for (const double error : errors) EXPECT_NEAR(error, 0, 0.15) << velocity.transpose();
  }
}

TEST(CompensatedSurface, HasItsTimeAtTheMeanOfItsEvents) {
  const auto surface = SurfaceOf({At(kT_ns - 8'000'000, 50, 50), At(kT_ns - 4'000'000, 50, 50)}, Vector6d::Zero(), 0);
  EXPECT_EQ(surface->t_edges_ns, kT_ns - 6'000'000);
  EXPECT_EQ(surface->events_used, 2U);
  EXPECT_NEAR(surface->window_s, 0.008, 1e-9);
}

TEST(CompensatedSurface, WithAWrongVelocityBlursAnEdgeButDoesNotMoveIt) {
  const Vector6d velocity = Twist(2, 0, 0, 0, 0, 0);
  const MovingEdge edge = EdgeUnder(velocity);
  const auto events = edge.Events();
  for (const double factor : {0.8, 1.2}) {
    const auto surface = SurfaceOf(events, factor * velocity, 2);
    const auto errors = CrestErrors(*surface, edge);
    ASSERT_GE(errors.size(), 80U);
    EXPECT_NEAR(Mean(errors), 0, 0.1) << factor;
  }
}

TEST(CompensatedSurface, UnderAnAccelerationShowsAnEdgeWhereItWasUnlessThatIsSwitchedOff) {
  const Vector6d velocity = Twist(0.3, 0, 0, 0, 0, 0), acceleration = Twist(-30, 0, 0, 0, 0, 0);
  MovingEdge edge = EdgeUnder(velocity);
  edge.acceleration = acceleration;
  PoseEstimate before;
  before.t_edges_ns = kT_ns - NsFromSeconds(0.04);
  before.velocity_event = velocity - 0.04 * acceleration;
  before.acceleration_event = acceleration;
  SurfaceOptions options = WithoutFilter();
  const auto error = [&] {
    const auto errors = CrestErrors(*SurfaceOf(edge.Events(), ExpectedMotion(before), 2, options), edge);
    EXPECT_GE(errors.size(), 80U);
    return Mean(errors);
  };
  EXPECT_NEAR(error(), 0, 0.03);
  options.ideas.accelerate_events = false;
  EXPECT_GT(std::abs(error()), 0.07);
}

TEST(CompensatedSurface, IsSharperWithTheRightVelocityThanWithoutOne) {
  const Vector6d velocity = Twist(2, 0, 0, 0, 0, 0);
  const auto events = EdgeUnder(velocity).Events();
  const auto strongest = [&](const Vector6d& assumed) {
    float strength = 0;
    const auto surface = SurfaceOf(events, assumed, 2);
    for (const EdgePoint& crest : surface->edges) strength = std::max(strength, crest.strength);
    return strength;
  };
  EXPECT_GT(strongest(velocity), 1.5F * strongest(Vector6d::Zero()));
}

TEST(CompensatedSurface, FindsATurnThatMakesItSharpWhereTheVelocityIsNotKnownUnlessThatIsSwitchedOff) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 1.5, 0));
  const auto events = edge.Events();
  const auto surface = SurfaceOf(events, std::nullopt, 0);
  const auto errors = CrestErrors(*surface, edge);
  EXPECT_GE(errors.size(), 80U);
  EXPECT_LE(errors.size(), 120U);
  for (const double error : errors) EXPECT_NEAR(error, 0, 0.5);

  SurfaceOptions off = WithoutFilter();
  off.ideas.find_turn = false;
  EXPECT_EQ(cv::norm(SurfaceOf(events, std::nullopt, 0, off)->image,
                     SurfaceOf(events, Vector6d::Zero().eval(), 0)->image, cv::NORM_INF),
            0);
}

TEST(CompensatedSurface, TakesTheDepthOfEachPlaceFromTheGrid) {
  // Two edges, at 1 m on the left and at 2 m on the right; the median is neither's.
  const Vector6d velocity = Twist(1.5, 0, 0, 0, 0, 0);
  const MovingEdge near{{-0.25, -0.6, 1}, {-0.22, 0.6, 1}, velocity}, far{{0.5, -1, 2}, {0.55, 1, 2}, velocity};
  std::vector<Event> events = near.Events();
  const auto more = far.Events();
  events.insert(events.end(), more.begin(), more.end());
  std::sort(events.begin(), events.end(), [](const Event& e, const Event& f) { return e.t_ns < f.t_ns; });
  SurfaceBuilder builder(TestCamera(), WithoutFilter());
  builder.Insert(events);
  SceneDepth depth;
  depth.median_m = 4;
  depth.inverse_depth = cv::Mat1f(8, 10, 0.5F);
  depth.inverse_depth.colRange(0, 5).setTo(1);
  const auto surface = builder.Render(kT_ns, velocity, depth);
  std::vector<double> near_errors, far_errors;
  for (const EdgePoint& crest : surface->edges) {
    if (crest.y < 15 || crest.y > 104) continue;
    (crest.x < 80 ? near_errors : far_errors)
        .push_back(crest.x - (crest.x < 80 ? near : far).ColumnAt(surface->t_edges_ns, crest.y));
  }
  // The two have one common mean time, but own means of their events: a fraction of a pixel apart. The far one moves
  // less, is fainter, and not all of it is above the threshold.
  ASSERT_GE(near_errors.size(), 80U);
  for (const double error : near_errors) EXPECT_NEAR(error, 0, 0.2);
  EXPECT_GE(far_errors.size(), 40U);
  for (const double error : far_errors) EXPECT_NEAR(error, 0, 0.3);
}

TEST(CompensatedSurface, HasItsEventsWhereTheyAreWhenMovingThemIsSwitchedOff) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0, 0));
  SurfaceOptions off = WithoutFilter();
  off.ideas.move_events = false;
  const auto surface = SurfaceOf(edge.Events(), edge.velocity, 2, off);
  EXPECT_EQ(cv::norm(surface->image, SurfaceOf(edge.Events(), Vector6d::Zero(), 2)->image, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(surface->image, SurfaceOf(edge.Events(), edge.velocity, 2)->image, cv::NORM_INF), 50);
}

TEST(CompensatedSurface, ShowsEdgesAtItsOwnTimeAndMovesThemWithTheVelocitysErrorWhenTheMeanTimeIsSwitchedOff) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0, 0));
  SurfaceOptions off = WithoutFilter();
  off.ideas.mean_time = false;
  const auto surface = SurfaceOf(edge.Events(), edge.velocity, 2, off);
  EXPECT_EQ(surface->t_edges_ns, kT_ns);
  const auto errors = CrestErrors(*surface, edge);
  EXPECT_GE(errors.size(), 80U);
  for (const double error : errors) EXPECT_NEAR(error, 0, 0.15);
  EXPECT_GT(std::abs(Mean(CrestErrors(*SurfaceOf(edge.Events(), 0.8 * edge.velocity, 2, off), edge))), 0.3);
}

TEST(CompensatedSurface, TakesTheMedianForEveryPlaceWhenTheGridIsSwitchedOff) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0, 0));
  SceneDepth depth;
  depth.median_m = 4;
  depth.inverse_depth = cv::Mat1f(8, 10, 0.5F);
  SurfaceOptions off = WithoutFilter();
  off.ideas.depth_grid = false;
  for (const SurfaceOptions& options : {WithoutFilter(), off}) {
    SurfaceBuilder builder(TestCamera(), options);
    builder.Insert(edge.Events());
    const auto surface = builder.Render(kT_ns, edge.velocity, depth);
    const auto expected = SurfaceOf(edge.Events(), edge.velocity, options.ideas.depth_grid ? 2 : 4);
    EXPECT_EQ(cv::norm(surface->image, expected->image, cv::NORM_INF), 0) << options.ideas.depth_grid;
  }
}

TEST(CompensatedSurface, TakesCrestsInTextureForEdgesWhenTheirTestIsSwitchedOff) {
  std::vector<Event> events;  // in every other column: ridges side by side
  for (int k = 0; k < 1900; ++k)
    events.push_back(At(kT_ns - 2'000'000 + 1000 * k, 40 + 2 * (k % 20), 30 + k / 20 % 40));
  SurfaceOptions options = WithoutFilter();
  const std::size_t usual = SurfaceOf(events, Vector6d::Zero(), 0, options)->edges.size();
  options.ideas.clear_crests = false;
  EXPECT_GT(SurfaceOf(events, Vector6d::Zero(), 0, options)->edges.size(), usual + 100);
}

double MeanStrength(const Surface& surface) {
  std::vector<double> strengths;
  for (const EdgePoint& crest : surface.edges) strengths.push_back(crest.strength);
  return Mean(strengths);
}

TEST(CompensatedSurface, IsSharpAlsoWherePosesTellItsVelocityWrongly) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0, 0));
  const auto strength = [&](double wrong_rad_s, bool of_poses, const SurfaceOptions& options) {
    SurfaceBuilder builder(TestCamera(), options);
    for (int k = 15; k >= 5; --k) {  // until it is known how little noise there is
      std::vector<Event> before;
      for (int i = 0; i < 200; ++i)
        before.push_back(At(kT_ns - k * 10'000'000 - 10'000'000 + i * 50'000, 7 * i % kWidth, 5));
      builder.Insert(before);
      builder.Render(kT_ns - k * 10'000'000, Vector6d::Zero(), {});
    }
    builder.Insert(edge.Events());
    SceneDepth depth;
    depth.median_m = 2;
    const Vector6d velocity = edge.velocity + Twist(0, 0, 0, 0, wrong_rad_s, 0);
    return MeanStrength(*builder.Render(kT_ns, ExpectedMotion(velocity, of_poses), depth));
  };
  SurfaceOptions off = WithoutFilter();
  off.ideas.refine_turn = false;
  const double sharp = strength(0, false, WithoutFilter());
  for (const double wrong_rad_s : {-1.5, -1.0, 1.0, 1.5}) {
    EXPECT_GT(strength(wrong_rad_s, true, WithoutFilter()), 0.8 * sharp) << wrong_rad_s;
    EXPECT_LT(strength(wrong_rad_s, true, off), 0.5 * sharp) << wrong_rad_s;
    EXPECT_LT(strength(wrong_rad_s, false, WithoutFilter()), 0.5 * sharp) << wrong_rad_s;  // of a trusted sensor
  }
}

TEST(CompensatedSurface, HasNoEdgesWithoutEvents) {
  const auto surface = SurfaceOf({}, Vector6d::Zero(), 0);
  EXPECT_THAT(surface->edges, IsEmpty());
  EXPECT_EQ(surface->events_used, 0U);
  EXPECT_EQ(surface->t_edges_ns, kT_ns);
  EXPECT_EQ(cv::countNonZero(surface->image), 0);
  EXPECT_TRUE(surface->still);
}

TEST(CompensatedSurface, LeavesOutEventsOlderThanTheWindow) {
  SurfaceOptions options = WithoutFilter();
  options.max_window_s = 0.02;
  const auto surface =
      SurfaceOf({At(kT_ns - 21'000'000, 50, 50), At(kT_ns - 19'000'000, 50, 50)}, Vector6d::Zero(), 0, options);
  EXPECT_EQ(surface->events_used, 1U);
}

TEST(CompensatedSurface, UsesNoMoreThanItsShareOfEvents) {
  std::vector<Event> events;
  for (int k = 0; k < 20000; ++k) events.push_back(At(kT_ns - 20'000'000 + 1000 * k, k % kWidth, k / kWidth % kHeight));
  EXPECT_EQ(SurfaceOf(events, Vector6d::Zero(), 0)->events_used, kWidth * kHeight / 10U);
}

TEST(CompensatedSurface, KeepsItsEdgesInsideWhenEventsOfTheBorderAreMovedOutside) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> side(0, 3), along_x(0, kWidth - 1), along_y(0, kHeight - 1);
  for (const Vector6d& velocity : {Twist(0, 0, 0, 0, 0, 0), Twist(20, 0, 0, 0, 0, 0), Twist(-20, -20, 0, 0, 0, 0),
                                   Twist(0, 0, 100, 0, 0, 0), Twist(0, 0, -100, 9, 9, 9), Twist(0, 0, 0, 80, 80, 80)}) {
    std::vector<Event> events;
    for (int k = 0; k < 1900; ++k) {
      const int s = side(random);
      events.push_back(At(kT_ns - 40'000'000 + 20'000 * k, s < 2 ? s * (kWidth - 1) : along_x(random),
                          s < 2 ? along_y(random) : (s - 2) * (kHeight - 1)));
    }
    const auto surface = SurfaceOf(events, velocity, 1);
    for (const EdgePoint& crest : surface->edges) {
      EXPECT_TRUE(TestCamera().Contains({crest.x, crest.y}, 2)) << crest.x << " " << crest.y;
    }
    ASSERT_EQ(surface->image.size(), cv::Size(kWidth, kHeight));
  }
}

TEST(CompensatedSurface, TellsAStandstillFromMotionByTheActivity) {
  const double pixels = kWidth * kHeight;
  for (const auto& [events_per_pixel_s, still] : {std::pair<double, bool>{0.05, true}, {1, false}}) {
    const auto per_period = static_cast<int>(events_per_pixel_s * pixels * 0.01);
    SurfaceBuilder builder(TestCamera(), WithoutFilter());
    SurfacePtr surface;
    for (int k = 1; k <= 10; ++k) {
      std::vector<Event> events;
      for (int i = 0; i < per_period; ++i) events.push_back(At(k * 10'000'000 - 5'000'000, 7 * i % kWidth, 50));
      builder.Insert(events);
      surface = builder.Render(k * 10'000'000, Vector6d::Zero(), {});
    }
    EXPECT_EQ(surface->still, still) << events_per_pixel_s;
    EXPECT_NEAR(surface->activity_hz, events_per_pixel_s, 0.1 * events_per_pixel_s);
    EXPECT_NEAR(surface->event_rate_hz, events_per_pixel_s * pixels, 0.1 * events_per_pixel_s * pixels);
  }
}

TEST(CompensatedSurface, DoesNotTakeALossOfEventsForAStandstill) {
  for (const bool told : {false, true}) {
    SurfaceBuilder builder(TestCamera(), WithoutFilter());
    const auto insert = [&](std::int64_t from_ns, std::int64_t until_ns) {
      for (std::int64_t t_ns = from_ns; t_ns < until_ns; t_ns += 50'000) {
        const auto i = static_cast<int>(t_ns / 50'000);
        builder.Insert(std::vector<Event>{At(t_ns, 7 * i % kWidth, 50)});
      }
    };
    SurfacePtr surface;
    for (std::int64_t t_ns = 0; t_ns < 100'000'000; t_ns += 10'000'000) {
      insert(t_ns, t_ns + 10'000'000);
      surface = builder.Render(t_ns + 10'000'000, Vector6d::Zero(), {});
    }
    EXPECT_FALSE(surface->still);
    if (told) builder.OnLoss(300'000'000);
    insert(300'000'000, 310'000'000);
    surface = builder.Render(310'000'000, Vector6d::Zero(), {});
    EXPECT_EQ(surface->still, !told);
    if (told) {
      EXPECT_NEAR(surface->event_rate_hz, 20e3, 100);
    }
  }
}

/// At the end of the k-th 10 ms: all that an edge makes of two columns.
void AddEdge(int k, int column, std::vector<Event>* events) {
  for (int i = 0; i < 2 * kHeight; ++i) {
    events->push_back(At((k - 1) * 10'000'000LL + 9'900'000 + 10 * i, column + i % 2, i / 2));
  }
}

TEST(CompensatedSurface, SaysThatEventsMayBeNoiseWhereItDiffersBetweenPartsOfTheImageUnlessAnEdgeMoves) {
  for (const bool moves : {false, true}) {
    SurfaceBuilder builder(TestCamera(), SurfaceOptions());
    std::mt19937 random(3);
    SurfacePtr surface;
    for (int k = 1; k <= 60; ++k) {
      std::vector<Event> events;
      for (int i = 0; i < 300; ++i) {  // 3.8 Hz per pixel on a third of the image, 0.5 Hz elsewhere
        const int x = static_cast<int>(random() % (i % 10 < 3 ? kWidth : kWidth / 3));
        events.push_back(At((k - 1) * 10'000'000LL + i * 33'000, x, static_cast<int>(random() % kHeight)));
      }
      const int edge = k - 40;  // 200 px/s
      if (moves && edge >= 0) AddEdge(k, 2 * edge, &events);
      builder.Insert(events);
      surface = builder.Render(k * 10'000'000, Vector6d::Zero(), {});
    }
    EXPECT_FALSE(surface->still) << moves;  // as much passes as a slow motion makes
    EXPECT_EQ(surface->maybe_noise, !moves);
  }
}

TEST(CompensatedSurface, HasItsEdgesOnWhatGoesOnAmongMuchNoise) {
  SurfaceBuilder builder(TestCamera(), SurfaceOptions());
  std::mt19937 random(3);
  constexpr int kNoise = 1600;  // events in 10 ms: 8 Hz per pixel
  const Vector6d turn = Twist(0, 0, 0, 0, -200 / TestCamera().fx(), 0);
  SurfacePtr surface;
  int column = 0;
  for (int k = 1; k <= 60; ++k) {
    std::vector<Event> events;
    for (int i = 0; i < kNoise; ++i) {
      events.push_back(At((k - 1) * 10'000'000LL + i * 6000, static_cast<int>(random() % kWidth),
                          static_cast<int>(random() % kHeight)));
    }
    column = 2 * (k - 40);  // as the camera turns
    if (column >= 0) AddEdge(k, column, &events);
    builder.Insert(events);
    surface = builder.Render(k * 10'000'000, turn, {});
  }
  ASSERT_GT(surface->edges.size(), 50U);
  const auto beside = std::count_if(surface->edges.begin(), surface->edges.end(),
                                    [&](const EdgePoint& edge) { return std::abs(edge.x - column) > 15; });
  EXPECT_LT(beside, 0.02 * surface->edges.size());
}

TEST(CompensatedSurface, SaysThatNoEventsAreMissingAsLongAsNoiseGoesOn) {
  for (const int per_10ms : {1, 10}) {
    SurfaceOptions options;
    options.rate_hz = 100 * per_10ms;
    SurfaceBuilder builder(TestCamera(), options);
    std::mt19937 random(3);
    const auto after = [&](int k, int events_per_10ms) {
      SurfacePtr surface;
      for (int part = 0; part < per_10ms; ++part) {
        const std::int64_t period_ns = 10'000'000LL / per_10ms, begin_ns = (k - 1) * 10'000'000LL + part * period_ns;
        const int count = std::max(1, events_per_10ms / per_10ms);
        std::vector<Event> events;
        for (int i = 0; i < count; ++i) {
          events.push_back(At(begin_ns + i * (period_ns / count), static_cast<int>(random() % kWidth),
                              static_cast<int>(random() % kHeight)));
        }
        builder.Insert(events);
        surface = builder.Render(begin_ns + period_ns, Vector6d::Zero(), {});
      }
      return surface;
    };
    SurfacePtr surface;
    for (int k = 1; k <= 60; ++k) surface = after(k, 400);  // 2 Hz per pixel
    EXPECT_TRUE(surface->still);
    EXPECT_TRUE(surface->noise_goes_on) << options.rate_hz;
    EXPECT_FALSE(after(61, 1)->noise_goes_on) << options.rate_hz;
    EXPECT_TRUE(after(62, 400)->noise_goes_on) << options.rate_hz;
  }
}

TEST(CompensatedSurface, TellsTheTurnOfItsEventsUnlessAnInertialSensorLeads) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0.3, 0));
  const auto turn = [&](const std::optional<ExpectedMotion>& motion) {
    return SurfaceOf(edge.Events(), motion, 2)->turn_event;
  };
  // At 2 m a translation of 2 m/s moves the image as a turn of 1 rad/s.
  EXPECT_LT((turn(ExpectedMotion(edge.velocity, true)) - Eigen::Vector3d(0, 1.3, 0)).norm(), 0.1);
  EXPECT_NEAR(turn(std::nullopt).y(), 1.3, 0.3);
  EXPECT_TRUE(turn(ExpectedMotion(edge.velocity, false)).isZero());
  EXPECT_NEAR(turn(ExpectedMotion::OfTurn(edge.velocity.tail<3>())).y(), 1.3, 0.3);
}

TEST(CompensatedSurface, TellsTheTurnOfSoManyEventsThatItSpansAMomentByTheSurfacesBefore) {
  const Vector6d velocity = Twist(0, 0, 0, 0, 1.2, 0);
  std::vector<Event> events;
  for (double x = -0.9; x < 1; x += 0.12) {
    const MovingEdge edge{{x, -1, 2}, {x - 0.1, 1, 2}, velocity};
    for (const Event& event : edge.Events()) events.push_back(event);
  }
  std::sort(events.begin(), events.end(), [](const Event& e, const Event& f) { return e.t_ns < f.t_ns; });
  SurfaceOptions options = WithoutFilter();
  options.event_share = 0.01;
  SurfaceBuilder builder(TestCamera(), options);
  SurfacePtr first, last;
  std::size_t inserted = 0;
  for (std::int64_t t_ns = kT_ns - 30'000'000; t_ns <= kT_ns; t_ns += 10'000'000) {
    std::size_t until = inserted;
    while (until < events.size() && events[until].t_ns < t_ns) ++until;
    builder.Insert(std::vector<Event>(events.begin() + static_cast<std::ptrdiff_t>(inserted),
                                      events.begin() + static_cast<std::ptrdiff_t>(until)));
    inserted = until;
    last = builder.Render(t_ns, std::nullopt, {});
    if (!first) first = last;
  }
  EXPECT_LT(last->window_s, 3e-3);
  EXPECT_GT(std::abs(first->turn_event.y() - 1.2), 0.3) << first->turn_event.transpose();
  EXPECT_NEAR(last->turn_event.y(), 1.2, 0.3);
}

TEST(CompensatedSurface, DoesNotTakeTheNoiseOfARecordingsFirstMomentsForMotion) {
  SurfaceBuilder builder(TestCamera(), SurfaceOptions());
  std::mt19937 random(3);
  constexpr int kNoise_hz = 8, kPerPeriod = kNoise_hz * kWidth * kHeight / 100;
  for (int k = 1; k <= 30; ++k) {
    std::vector<Event> events;
    for (int i = 0; i < kPerPeriod; ++i) {
      const std::int64_t t_ns = (k - 1) * 10'000'000LL + i * 10'000'000LL / kPerPeriod;
      events.push_back(At(t_ns, static_cast<int>(random() % kWidth), static_cast<int>(random() % kHeight)));
    }
    builder.Insert(events);
    EXPECT_TRUE(builder.Render(k * 10'000'000, Vector6d::Zero(), {})->still) << "surface " << k;
  }
}

TEST(SurfaceBuilder, CountsEventsOutsideUnorderedAndNoise) {
  SurfaceBuilder builder(TestCamera(), SurfaceOptions());
  builder.Insert(std::vector<Event>{At(100, 5, 5), At(200, kWidth, 5), At(300, 5, kHeight), At(400, 65535, 65535),
                                    At(50, 6, 6), At(100, 7, 7), At(500, 90, 90)});
  builder.Insert(std::vector<Event>{At(499, 9, 9)});
  builder.Render(1000, Vector6d::Zero(), {});
  EXPECT_EQ(builder.counters().in, 8U);
  EXPECT_EQ(builder.counters().outside, 3U);
  EXPECT_EQ(builder.counters().unordered, 2U);
  EXPECT_EQ(builder.counters().noise, 3U);  // the other three are alone
  EXPECT_EQ(builder.counters().used, 0U);
}

/// Nearly all pixels brighter and darker each 10 ms, from `first_ns` to kT_ns.
std::vector<Event> FlickerSince(std::int64_t first_ns) {
  std::mt19937 random(4);
  std::uniform_int_distribution<std::int64_t> late_ns(0, 1'500'000);
  std::vector<Event> events;
  for (std::int64_t t_ns = first_ns; t_ns + 5'000'000 <= kT_ns; t_ns += 5'000'000) {
    for (int i = 0; i < kWidth * kHeight; ++i) {
      if (random() % 10 == 0) continue;
      events.push_back(At(t_ns + late_ns(random), i % kWidth, i / kWidth));
      events.back().polarity = t_ns % 10'000'000 == 0;
    }
  }
  return events;
}

TEST(SurfaceBuilder, SeesAnEdgeInLightThatFlickersUnlessThatIsSwitchedOff) {
  const MovingEdge edge{{-0.3, -0.6, 2}, {-0.2, 0.6, 2}, Twist(3, 0, 0, 0, 0, 0)};
  std::vector<Event> events = FlickerSince(kT_ns - 300'000'000);
  for (const Event& event : edge.Events()) events.push_back(event);
  std::sort(events.begin(), events.end(), IsEarlier);
  const auto near_edge = [&](bool leave_lamps) {
    SurfaceOptions options;
    options.ideas.leave_lamps = leave_lamps;
    SurfaceBuilder builder(TestCamera(), options);
    SurfacePtr surface;
    std::size_t inserted = 0;
    for (std::int64_t t_ns = kT_ns - 290'000'000; t_ns <= kT_ns; t_ns += 10'000'000) {
      const auto begin = inserted;
      while (inserted < events.size() && events[inserted].t_ns < t_ns) ++inserted;
      builder.Insert({events.data() + begin, inserted - begin});
      surface = builder.Render(t_ns, ExpectedMotion(edge.velocity), {t_ns, 2, {}});
    }
    EXPECT_EQ(builder.counters().of_lamps > events.size() / 4, leave_lamps);
    const auto near = std::count_if(surface->edges.begin(), surface->edges.end(), [&](const EdgePoint& point) {
      return std::abs(point.x - edge.ColumnAt(surface->t_edges_ns, point.y)) < 2;
    });
    return static_cast<double>(near) / static_cast<double>(std::max<std::size_t>(surface->edges.size(), 1));
  };
  EXPECT_GT(near_edge(true), 0.8);
  EXPECT_LT(near_edge(false), 0.2);
}

TEST(SurfaceBuilder, StartsANewEpochOnResetAndTakesOlderEventsThen) {
  SurfaceBuilder builder(TestCamera(), WithoutFilter());
  builder.Insert(std::vector<Event>{At(kT_ns - 1000, 50, 50)});
  EXPECT_EQ(builder.Render(kT_ns, Vector6d::Zero(), {})->epoch, 0U);
  builder.Reset();
  EXPECT_EQ(builder.epoch(), 1U);
  builder.Insert(std::vector<Event>{At(5000, 20, 20)});
  const auto surface = builder.Render(6000, Vector6d::Zero(), {});
  EXPECT_EQ(surface->epoch, 1U);
  EXPECT_EQ(surface->events_used, 1U);
  EXPECT_EQ(builder.counters().unordered, 0U);
}

TEST(SurfaceBuilder, TakesOtherOptionsWithoutForgettingItsEvents) {
  const MovingEdge edge = EdgeUnder(Twist(2, 0, 0, 0, 0, 0));
  SurfaceOptions other = WithoutFilter();
  other.max_window_s = 0.01;
  other.crest_quantile = 0.8;
  const auto expected = SurfaceOf(edge.Events(), edge.velocity, 2, other);
  SurfaceBuilder builder(TestCamera(), WithoutFilter());
  builder.Insert(edge.Events());
  builder.SetOptions(other);
  SceneDepth depth;
  depth.median_m = 2;
  const auto surface = builder.Render(kT_ns, edge.velocity, depth);
  EXPECT_EQ(surface->epoch, 0U);
  EXPECT_LE(surface->window_s, 0.01);
  EXPECT_FALSE(surface->edges.empty());
  EXPECT_EQ(cv::countNonZero(surface->image != expected->image), 0);
  EXPECT_EQ(surface->edges.size(), expected->edges.size());
}

TEST(SurfaceBuilder, DoesNotChangeASurfaceThatIsStillHeld) {
  SurfaceBuilder builder(TestCamera(), WithoutFilter());
  const auto events = EdgeUnder(Twist(2, 0, 0, 0, 0, 0)).Events();
  builder.Insert(events);
  const auto first = builder.Render(kT_ns, Twist(2, 0, 0, 0, 0, 0), {});
  const cv::Mat1b image = first->image.clone();
  const cv::Mat1i nearest = first->nearest_edge.clone();
  for (int k = 0; k < 3; ++k) builder.Render(kT_ns + 1000 * k, Vector6d::Zero(), {});
  EXPECT_EQ(cv::norm(image, first->image, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(nearest, first->nearest_edge, cv::NORM_INF), 0);
}

TEST(SurfaceBuilder, MakesTheSameSurfaceWhenEventsAreFilteredAsTheyCome) {
  const SurfaceOptions options;
  SurfaceBuilder at_once(TestCamera(), options), bit_by_bit(TestCamera(), options);
  std::mt19937 random(5);
  std::uniform_int_distribution<int> column(40, 60), row(30, 90);
  for (int k = 1; k <= 30; ++k) {
    const std::int64_t t_ns = kT_ns + 10'000'000LL * k;
    for (int part = 0; part < 10; ++part) {
      std::vector<Event> events;
      for (int i = 0; i < 150; ++i) {
        events.push_back(At(t_ns - 1'000'000 * (10 - part) + 6000 * i, column(random), row(random)));
      }
      at_once.Insert(events);
      bit_by_bit.Insert(events);
      bit_by_bit.Filter();
    }
    const auto a = at_once.Render(t_ns, Vector6d::Zero(), {}), b = bit_by_bit.Render(t_ns, Vector6d::Zero(), {});
    ASSERT_EQ(a->events_used, b->events_used) << k;
    ASSERT_EQ(cv::norm(a->image, b->image, cv::NORM_INF), 0) << k;
    ASSERT_EQ(cv::norm(a->nearest_edge, b->nearest_edge, cv::NORM_INF), 0) << k;
  }
  EXPECT_GT(at_once.counters().noise, 0U);
  EXPECT_EQ(at_once.counters().noise, bit_by_bit.counters().noise);
}

TEST(PlainSurface, DecaysExponentiallyFromTheLastEventOfEachPixel) {
  SurfaceOptions options;
  options.method = "exponential";
  options.tau_s = 0.03;
  options.delta = 0.5;
  SurfaceBuilder builder(TestCamera(), options);
  std::mt19937 random(8);
  std::uniform_int_distribution<int> column(0, kWidth - 1), row(0, kHeight - 1);
  cv::Mat1d last_s(kHeight, kWidth, -1e9);
  std::vector<Event> events;
  for (int k = 0; k < 20000; ++k) {
    events.push_back(At(kT_ns - 100'000'000 + 5000 * k, column(random), row(random)));
    last_s(events.back().y, events.back().x) = SecondsFromNs(events.back().t_ns - kT_ns);
  }
  builder.Insert(events);
  const auto surface = builder.Render(kT_ns, Vector6d::Zero(), {});
  cv::Mat1b is_edge(kHeight, kWidth, std::uint8_t{0});
  for (const EdgePoint& edge : surface->edges) is_edge(static_cast<int>(edge.y), static_cast<int>(edge.x)) = 1;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double value = std::exp(last_s(y, x) / options.tau_s);  // paper eq. 1
      ASSERT_NEAR(surface->image(y, x), 255 * value, 0.51) << x << " " << y;
      const bool inner = x >= 3 && y >= 3 && x < kWidth - 3 && y < kHeight - 3;
      if (std::abs(value - options.delta) > 1.0 / 255) {
        ASSERT_EQ(is_edge(y, x) == 1, inner && value > options.delta) << x << " " << y;
      }
    }
  }
  EXPECT_TRUE(surface->nearest_edge.empty());
}

TEST(PlainSurface, ShowsAnEventOfADistortedCameraWhereItsRayIsInTheUndistortedImage) {
  SurfaceOptions options;
  options.method = "exponential";
  const Camera camera(kWidth, kHeight, 150, 150, 80.3, 59.6, "plumb_bob", {-0.2, 0.05, 0, 0});
  SurfaceBuilder builder(camera, options);
  builder.Insert(std::vector<Event>{At(kT_ns, 30, 25)});
  const auto surface = builder.Render(kT_ns, Vector6d::Zero(), {});
  const Eigen::Vector2d expected = *camera.Undistorted().Project(*camera.Unproject({30, 25}));
  ASSERT_FALSE(surface->edges.empty());
  for (const EdgePoint& edge : surface->edges) {
    EXPECT_NEAR(edge.x, expected.x(), 1.01);
    EXPECT_NEAR(edge.y, expected.y(), 1.01);
  }
}

TEST(PlainSurface, StaysDarkHoweverLongAPixelHasBeenSilent) {
  SurfaceOptions options;
  options.method = "exponential";
  SurfaceBuilder builder(TestCamera(), options);
  std::int64_t t_ns = kT_ns;
  // Counters of 32 bits come round after 4.3 s or a multiple of it.
  for (const std::int64_t silence_ns : {4'294'967'296L, 2 * 4'294'967'296L, 1'000'000'000L, 3'600'000'000'000L}) {
    builder.Insert(std::vector<Event>{At(t_ns, 30, 25)});
    builder.Insert(std::vector<Event>{At(t_ns + silence_ns, 90, 70)});
    t_ns += silence_ns;
    const auto surface = builder.Render(t_ns, Vector6d::Zero(), {});
    EXPECT_EQ(surface->image(25, 30), 0) << silence_ns;
    EXPECT_EQ(surface->image(70, 90), 255) << silence_ns;
    EXPECT_EQ(surface->events_used, 1U) << silence_ns;
    t_ns += 2'000'000'000;
  }
}

/// Surfaces of random events around moving lines, as a sensor without wide registers and one with them render them.
TEST(SurfaceBuilder, RendersTheSameBytesWithAndWithoutWideRegisters) {
  const Vector6d velocity = Twist(1.5, 0, 0.3, 0.3, 0.6, -0.5);
  const auto events = EdgeUnder(velocity).Events();
  for (const std::string method : {"motion_compensated", "exponential"}) {
    SurfaceOptions options = WithoutFilter();
    options.method = method;
    const auto wide = SurfaceOf(events, velocity, 2, options);
    cv::setUseOptimized(false);
    const auto narrow = SurfaceOf(events, velocity, 2, options);
    cv::setUseOptimized(true);
    EXPECT_EQ(cv::norm(wide->image, narrow->image, cv::NORM_INF), 0) << method;
    ASSERT_GT(wide->edges.size(), 50U);
    ASSERT_EQ(wide->edges.size(), narrow->edges.size());
    EXPECT_EQ(std::memcmp(wide->edges.data(), narrow->edges.data(), wide->edges.size() * sizeof(EdgePoint)), 0);
  }
}

TEST(PlainSurface, IsDarkAfterReset) {
  SurfaceOptions options;
  options.method = "exponential";
  SurfaceBuilder builder(TestCamera(), options);
  builder.Insert(std::vector<Event>{At(kT_ns, 30, 25)});
  builder.Reset();
  const auto surface = builder.Render(kT_ns, Vector6d::Zero(), {});
  EXPECT_EQ(cv::countNonZero(surface->image), 0);
  EXPECT_THAT(surface->edges, IsEmpty());
}

}  // namespace
}  // namespace devo
