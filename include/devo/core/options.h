// SPDX-License-Identifier: BSD-3-Clause
//
// Every tunable of the odometry, once: its default here, its key, range and meaning in VisitOptions.
// The yaml loader, the validation, docs/parameters.md and the ROS parameters are all made from the visit.
#pragma once

#include <string>
#include <vector>

namespace devo {

/// Ideas of the method that comparisons switch off, one at a time (scripts/ablation.txt); all should stay on.
struct SurfaceIdeas {
  bool leave_lamps = true;
  bool move_events = true;
  bool find_turn = true;
  bool refine_turn = true;
  bool accelerate_events = true;
  bool mean_time = true;
  bool depth_grid = true;
  bool clear_crests = true;
  bool above_noise = true;
};

struct MappingIdeas {
  bool depth_of_rest = true;
  bool move_depth = true;
  bool follow_scene = true;
  bool hide_points = true;
  bool flying_pixels = true;
  bool surrounded_depth = true;
  bool drop_points = true;
  bool refine_points = true;
  bool spread_points = true;
  bool guess_depth = true;
  bool learn_depth_errors = true;
  bool depth_jumps = true;
  bool doubt_things = true;
};

struct TrackingIdeas {
  bool match_direction = true;
  bool match_polarity = true;
  bool visibility_weight = true;
  bool unmatched_cost = true;
  bool fine_alignment = true;
  bool noise_of_normals = true;
  bool weigh_events = true;
  bool weigh_matches = true;
  bool doubt_events = true;
  bool shared_errors = true;
  bool calm_motion = true;
  bool motion_prior = true;
  bool search = true;
  bool start_from_rest = true;
};

struct SurfaceOptions {
  std::string method = "motion_compensated";
  double rate_hz = 100;
  double event_share = 0.1;
  double max_window_s = 0.05;
  double blur_px = 1.0;
  double crest_quantile = 0.45;
  double truncation_px = 4;
  double edge_lag_px = 0.06;
  double noise_window_s = 0.01;
  int noise_neighbours = 1;
  double hot_pixel_factor = 20;
  double still_activity_hz = 0.15;
  double tau_s = 0.03;
  double delta = 0.5;
  SurfaceIdeas ideas;
};

struct MappingOptions {
  double min_depth_m = 0.1;
  double max_depth_m = 100;
  bool reuse_references = true;
  double min_coverage = 0.8;
  double new_reference_distance_m = 0.1;
  double new_reference_angle_rad = 0.1;
  int max_points = 2000;
  int max_map_points = 200000;
  double lidar_window_s = 0.8;
  bool align_depth = true;
  MappingIdeas ideas;
};

struct TrackingOptions {
  int max_iterations = 20;
  double huber_share = 0.1;
  double acceleration_m_s2 = 3;
  double angular_acceleration_rad_s2 = 10;
  double max_delay_s = 0.03;
  TrackingIdeas ideas;
};

struct OdometryOptions {
  SurfaceOptions surface;
  MappingOptions mapping;
  TrackingOptions tracking;
};

/// The part of VisitOptions that is for comparisons only.
template <typename Options, typename Visitor>
void VisitIdeas(Options& o, Visitor&& visit) {
  auto& surface = o.surface.ideas;
  visit("ablation.move_events", surface.move_events,
        "for comparisons, should stay on, as all of ablation: events are moved along the motion; false: accumulated "
        "where they are");
  visit(
      "ablation.leave_lamps", surface.leave_lamps,
      "events that fire as one over an area, brighter and darker in turn, are a flickering lamp's and left out; false: "
      "taken for others");
  visit("ablation.find_turn", surface.find_turn,
        "as long as there is no pose, events are moved by the turn that makes the image clearest; false: not moved "
        "until then");
  visit("ablation.refine_turn", surface.refine_turn,
        "where poses alone tell the velocity, events are moved by the turn besides that makes the image clearest; "
        "false: by that velocity");
  visit("ablation.accelerate_events", surface.accelerate_events,
        "where an inertial sensor tells the acceleration, events are moved with it; false: at one velocity");
  visit("ablation.mean_time", surface.mean_time,
        "events are moved to the mean of their times; false: to the surface's time");
  visit("ablation.depth_grid", surface.depth_grid,
        "events are moved with the depth of their place; false: with the scene's median");
  visit("ablation.clear_crests", surface.clear_crests,
        "a crest stands out from both its sides; false: any ridge is an edge");
  visit("ablation.above_noise", surface.above_noise,
        "crests are higher than noise alone makes them and, among much of it, go on; false: above crest_quantile only");
  auto& mapping = o.mapping.ideas;
  visit("ablation.depth_of_rest", mapping.depth_of_rest,
        "the first map may be of the depth image of the rest before; false: it waits for one of the motion");
  visit("ablation.move_depth", mapping.move_depth,
        "depth images are moved to the surface's time; false: taken as if made then");
  visit("ablation.follow_scene", mapping.follow_scene,
        "between depth images, the depth of each place by which events are moved follows the view; false: it stays as "
        "the last depth image saw it");
  visit("ablation.hide_points", mapping.hide_points,
        "points behind what the depth camera saw last are hidden; false: none is");
  visit("ablation.flying_pixels", mapping.flying_pixels,
        "a few readings in front of a surface are no foreground; false: the nearest reading counts");
  visit("ablation.surrounded_depth", mapping.surrounded_depth,
        "an edge with readings on one side only gets depth where they are near; false: always");
  visit("ablation.drop_points", mapping.drop_points,
        "points that seldom meet an edge where they should are dropped; false: kept");
  visit("ablation.refine_points", mapping.refine_points,
        "points move towards the edges that they meet in other views; false: they stay as they were first seen");
  visit("ablation.spread_points", mapping.spread_points,
        "tracked points are spread over the image; false: drawn from all of it alike");
  visit("ablation.guess_depth", mapping.guess_depth,
        "edges where neither map nor depth is get one from around them, which further views correct; false: none");
  visit("ablation.learn_depth_errors", mapping.learn_depth_errors,
        "how a depth camera errs is learnt from what is left between aligned images; false: as cameras usually do");
  visit("ablation.depth_jumps", mapping.depth_jumps,
        "a depth camera that begins to see otherwise is followed from there; false: it is believed as before");
  visit("ablation.doubt_things", mapping.doubt_things,
        "a thing that alone shows a motion which events deny is taken to have moved by itself; false: it stands");
  auto& tracking = o.tracking.ideas;
  visit("ablation.match_direction", tracking.match_direction, "points match edges of their direction; false: of any");
  visit("ablation.match_polarity", tracking.match_polarity,
        "points match edges of the polarity that their motion makes; false: of any");
  visit("ablation.visibility_weight", tracking.visibility_weight,
        "points weigh as much as their motion should show; false: all alike");
  visit("ablation.unmatched_cost", tracking.unmatched_cost,
        "points without an edge cost as much as one at the truncation; false: nothing");
  visit("ablation.fine_alignment", tracking.fine_alignment,
        "once they lie near their edges, points are aligned again with half of the truncation; false: only once");
  visit(
      "ablation.noise_of_normals", tracking.noise_of_normals,
      "without an inertial sensor, what the noise of edges' normals tells of motion along them does not count; false: "
      "it does, as if exact");
  visit("ablation.weigh_matches", tracking.weigh_matches,
        "poses that match less than usual count less; false: as those that match as usual");
  visit("ablation.weigh_events", tracking.weigh_events,
        "poses of few events count less against the motion so far; false: as those of many");
  visit("ablation.doubt_events", tracking.doubt_events,
        "without an inertial sensor, poses that depth images in quick succession find farther off than stated count "
        "less; false: as stated");
  visit("ablation.shared_errors", tracking.shared_errors,
        "what successive alignments err alike is told from motion by its likeness; false: each errs by itself, twice "
        "as much");
  visit("ablation.calm_motion", tracking.calm_motion,
        "without an inertial sensor the prior takes a calm motion to stay calm, and one livelier than options say to "
        "stay so; false: always as lively as options say");
  visit("ablation.motion_prior", tracking.motion_prior,
        "the prediction holds directions that the edges leave open; false: it is the start only");
  visit("ablation.search", tracking.search, "a better pose is sought when one matches less than usual; false: never");
  visit("ablation.start_from_rest", tracking.start_from_rest,
        "an inertial sensor gives a first map's velocity from the rest before it; false: gravity's direction alone");
}

/// Calls `visit(key, value&, min, max, meaning)` for numbers and `visit(key, string&, choices, meaning)` for
/// names, `visit(key, bool&, meaning)` for switches, once per option. `Options` is OdometryOptions or const
/// OdometryOptions. Keys are the yaml's.
template <typename Options, typename Visitor>
void VisitOptions(Options& o, Visitor&& visit) {
  visit("surface.method", o.surface.method, "motion_compensated|exponential",
        "motion_compensated (events moved to the surface's time, crests) or exponential (the paper's eq. 1)");
  visit("surface.rate_hz", o.surface.rate_hz, 1.0, 1000.0, "surfaces and poses per second of data time");
  visit("surface.event_share", o.surface.event_share, 0.001, 10.0, "events per surface, as a share of the pixels");
  visit("surface.max_window_s", o.surface.max_window_s, 1e-3, 1.0, "no event older than this enters a surface");
  visit("surface.blur_px", o.surface.blur_px, 0.0, 5.0, "standard deviation of the blur before crests are sought");
  visit("surface.crest_quantile", o.surface.crest_quantile, 0.0, 1.0,
        "crests are above this quantile of the occupied pixels");
  visit("surface.truncation_px", o.surface.truncation_px, 1.0, 30.0, "distance beyond which an edge attracts no point");
  visit("surface.edge_lag_px", o.surface.edge_lag_px, 0.0, 1.0,
        "how far an edge of one event per pixel trails behind the scene's, others by their share; 0: not corrected");
  visit("surface.noise_window_s", o.surface.noise_window_s, 0.0, 1.0,
        "an event without a neighbour in this time is noise");
  visit("surface.noise_neighbours", o.surface.noise_neighbours, 0, 8,
        "neighbouring pixels that must have fired, one more where noise is dense; 0: no filter");
  visit("surface.hot_pixel_factor", o.surface.hot_pixel_factor, 0.0, 1e6,
        "a pixel this many times as active as its surroundings is hot; 0: none is");
  visit("surface.still_activity_hz", o.surface.still_activity_hz, 0.0, 1000.0,
        "below this many events per pixel and second nothing moves");
  visit("surface.tau_s", o.surface.tau_s, 1e-4, 10.0, "exponential method: decay (paper eq. 1)");
  visit("surface.delta", o.surface.delta, 0.0, 1.0, "exponential method: threshold of the semi-dense region");
  visit("mapping.min_depth_m", o.mapping.min_depth_m, 0.0, 100.0, "nearer readings are no measurement");
  visit("mapping.max_depth_m", o.mapping.max_depth_m, 0.1, 1000.0, "farther readings are no measurement");
  visit("mapping.reuse_references", o.mapping.reuse_references,
        "all references in view are registered together and new ones add what the old ones lack; false: only the "
        "newest (the paper)");
  visit("mapping.min_coverage", o.mapping.min_coverage, 0.0, 1.0,
        "a new reference is made when the map explains less than this share of the edges");
  visit("mapping.new_reference_distance_m", o.mapping.new_reference_distance_m, 0.0, 100.0,
        "without reuse: translation after which a new reference is made");
  visit("mapping.new_reference_angle_rad", o.mapping.new_reference_angle_rad, 0.0, 3.2,
        "without reuse: rotation after which a new reference is made");
  visit("mapping.max_points", o.mapping.max_points, 50, 100000, "points that tracking registers");
  visit("mapping.max_map_points", o.mapping.max_map_points, 1000, 100000000,
        "points of all references; beyond it the one that was out of view for longest is forgotten");
  visit("mapping.lidar_window_s", o.mapping.lidar_window_s, 0.01, 10.0,
        "LiDAR: sweeps of this time are accumulated; longer is denser, shorter forgets drift and moving things sooner");
  visit(
      "mapping.align_depth", o.mapping.align_depth,
      "depth images are aligned to earlier ones, which holds the pose where events are few; false: they serve the map "
      "alone");
  visit("tracking.max_iterations", o.tracking.max_iterations, 1, 200, "of the minimisation, per pose");
  visit("tracking.huber_share", o.tracking.huber_share, 0.001, 10.0,
        "where the robust loss turns linear, as a share of the truncation");
  visit("tracking.acceleration_m_s2", o.tracking.acceleration_m_s2, 0.1, 1000.0,
        "standard deviation of the camera's acceleration: how far the motion prior trusts a constant velocity");
  visit("tracking.angular_acceleration_rad_s2", o.tracking.angular_acceleration_rad_s2, 0.1, 10000.0,
        "the same for rotation");
  visit("tracking.max_delay_s", o.tracking.max_delay_s, 0.0, 1.0,
        "the delay of events against an inertial sensor's stamps is estimated up to this; 0: both show one moment");
  VisitIdeas(o, visit);
}

/// "a|b|c" -> {"a", "b", "c"}: the names that an option may have.
std::vector<std::string> SplitChoices(const std::string& choices);

/// Throws std::invalid_argument naming the first key whose value is out of its range, and the range.
void Validate(const OdometryOptions& options);

}  // namespace devo
