// SPDX-License-Identifier: BSD-3-Clause
//
// Do depth and events fit together? Silhouettes of the depth images are projected into the event image and compared
// with the crests of the events at the same time, and at times a little earlier and later: the time offset at which
// they fit best is `depth_time_offset_s`, the distance that is left then judges the calibration.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <exception>
#include <fstream>
#include <iostream>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/QR>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "command_line.h"
#include "devo/core/camera.h"
#include "devo/core/crest_threshold.h"
#include "devo/core/crests.h"
#include "devo/core/nearest_edge_field.h"
#include "devo/core/rig.h"
#include "devo/core/silhouettes.h"
#include "devo/core/time.h"
#include "devo/io/output_folder.h"
#include "devo/io/rig_config.h"
#include "devo/ros/bag_reader.h"

namespace devo {
namespace {

constexpr double kSearch_px = 5;  // farther silhouettes have no edge of their own
constexpr double kBlur_px = 1;
constexpr double kSigma_px = 1.5;  // of a good fit: calibration, the silhouettes of depth, crests
constexpr double kMaxHalfWindow_s = 0.015;
constexpr double kEventShare = 0.12;  // of the pixels, per window: edges are thin, and whole
constexpr double kMinEventShare = 0.01;
constexpr std::size_t kMinPoints = 100;

struct Arguments {
  std::vector<std::string> configs, bags, overrides;
  std::string out = "alignment";
  BagRange range;
  double search_s = 0.05, step_s = 0.002, every_s = 0.1;
};

/// Events around the present, and their accumulation over a window that is symmetric about its time, so that
/// moving edges are found where they are at that time.
class EventWindow {
 public:
  explicit EventWindow(const Camera& camera) : undistorted_(camera.Undistorted()), rays_(RayTable(camera)) {}

  const Camera& undistorted() const { return undistorted_; }
  void Add(EventSpan events) { events_.insert(events_.end(), events.begin(), events.end()); }
  void ForgetBefore(std::int64_t t_ns) {
    while (!events_.empty() && events_.front().t_ns < t_ns) events_.pop_front();
  }
  std::int64_t last_ns() const { return events_.empty() ? INT64_MIN : events_.back().t_ns; }
  std::size_t CountIn(std::int64_t begin_ns, std::int64_t end_ns) const {
    return static_cast<std::size_t>(LowerBound(end_ns) - LowerBound(begin_ns));
  }

  /// Events of [begin, end) per pixel of the undistorted image, in units of kEventWeight.
  cv::Mat1w Accumulate(std::int64_t begin_ns, std::int64_t end_ns) const {
    cv::Mat1w image(undistorted_.height(), undistorted_.width(), std::uint16_t{0});
    const auto end = LowerBound(end_ns);
    for (auto event = LowerBound(begin_ns); event != end; ++event) {
      if (event->x >= rays_.cols || event->y >= rays_.rows) continue;
      const cv::Vec2f ray = rays_(event->y, event->x);
      const double u = undistorted_.fx() * ray[0] + undistorted_.cx(),
                   v = undistorted_.fy() * ray[1] + undistorted_.cy();
      if (!undistorted_.Contains({u, v}, 1)) continue;  // false for pixels without a ray (NaN), too
      const int x = static_cast<int>(u), y = static_cast<int>(v);
      const double a = u - x, b = v - y;
      const auto add = [&image](int row, int column, double share) {
        image(row, column) = static_cast<std::uint16_t>(std::min(4095.0, image(row, column) + kEventWeight * share));
      };
      add(y, x, (1 - a) * (1 - b));
      add(y, x + 1, a * (1 - b));
      add(y + 1, x, (1 - a) * b);
      add(y + 1, x + 1, a * b);
    }
    return image;
  }

 private:
  std::deque<Event>::const_iterator LowerBound(std::int64_t t_ns) const {
    return std::lower_bound(events_.begin(), events_.end(), t_ns,
                            [](const Event& event, std::int64_t t) { return event.t_ns < t; });
  }

  Camera undistorted_;
  cv::Mat2f rays_;
  std::deque<Event> events_;
};

/// How well silhouettes lie on the crests of accumulated events.
class CrestFit {
 public:
  explicit CrestFit(const cv::Mat1w& events) {
    cv::Mat1w scratch, blurred;
    Blur(events, kBlur_px, &scratch, &blurred);
    FindCrests(blurred, SignedCounts(), CrestThreshold(blurred, 0.7, 0, kBlur_px), &surface_.edges);
    surface_.nearest_edge.create(events.size());
    BuildNearestEdgeField(surface_.edges, kSearch_px, &surface_.nearest_edge);
  }
  std::optional<double> Distance(const Silhouette& point) const { return DistanceToEdge(point, surface_); }

 private:
  Surface surface_;  // of which only the edges and their field are used
};

/// Fit per time offset, summed over the silhouettes of all depth images.
struct Curve {
  std::vector<double> offset_s;
  std::vector<double> fit;                   // 1 for a silhouette on an edge, 0 for one without, Gaussian in between
  std::vector<double> matched, distance_px;  // silhouettes within 2 sigma, and their summed distance
  double points = 0;
  int images = 0;

  explicit Curve(const Arguments& arguments) {
    const int steps = static_cast<int>(std::lround(arguments.search_s / arguments.step_s));
    for (int i = -steps; i <= steps; ++i) offset_s.push_back(i * arguments.step_s);
    fit.assign(offset_s.size(), 0);
    matched = distance_px = fit;
  }
  void Add(std::size_t i, const std::optional<double>& distance) {
    if (!distance) return;
    fit[i] += std::exp(-0.5 * *distance * *distance / (kSigma_px * kSigma_px));
    if (*distance > 2 * kSigma_px) return;
    ++matched[i];
    distance_px[i] += *distance;
  }
  std::size_t Middle() const { return offset_s.size() / 2; }
  std::size_t Best() const { return static_cast<std::size_t>(std::max_element(fit.begin(), fit.end()) - fit.begin()); }

  /// Offset of the best fit between the samples: vertex of the parabola through those within 6 ms of the best.
  double BestOffset() const {
    const double step_s = offset_s[1] - offset_s[0];
    const auto reach = std::max<std::ptrdiff_t>(1, std::lround(0.006 / step_s));
    const auto best = static_cast<std::ptrdiff_t>(Best()), count = static_cast<std::ptrdiff_t>(offset_s.size());
    if (best < reach || best + reach >= count) return offset_s[Best()];
    Eigen::MatrixX3d A(2 * reach + 1, 3);
    Eigen::VectorXd b(2 * reach + 1);
    for (std::ptrdiff_t k = -reach; k <= reach; ++k) {
      A.row(k + reach) << 1, static_cast<double>(k), static_cast<double>(k * k);
      b[k + reach] = fit[static_cast<std::size_t>(best + k)];
    }
    const Eigen::Vector3d c = A.colPivHouseholderQr().solve(b);
    const double shift = c[2] < 0 ? std::clamp(-0.5 * c[1] / c[2], -1.0 * reach, 1.0 * reach) : 0;
    return offset_s[Best()] + shift * step_s;
  }
  /// How much better the fit is there than usual, as a share of it: near 0 where nothing moved.
  double Contrast() const {
    std::vector<double> sorted = fit;
    std::sort(sorted.begin(), sorted.end());
    return sorted.back() > 0 ? 1 - sorted[sorted.size() / 4] / sorted.back() : 0;
  }
};

/// What the picture shows: the depth image with most silhouettes.
struct Example {
  std::vector<Silhouette> points;
  cv::Mat1w events_at_stamp, events_at_best;
  std::int64_t t_ns = 0, half_window_ns = 0;
};

class Checker {
 public:
  Checker(const Arguments& arguments, const Rig& rig)
      : arguments_(arguments), rig_(rig), depth_rays_(RayTable(rig.depth_camera)), window_(rig.event_camera),
        curve_(arguments) {}

  void Add(EventSpan events) {
    window_.Add(events);
    ProcessDue(false);
    const std::int64_t oldest_ns = depths_.empty() ? window_.last_ns() : depths_.front().t_ns;
    window_.ForgetBefore(oldest_ns - Margin());
  }
  void Add(const DepthImage& depth) {
    if (depth.depth_m.size() != depth_rays_.size()) {
      throw std::runtime_error("depth image of " + std::to_string(depth.depth_m.cols) + "x" +
                               std::to_string(depth.depth_m.rows) + ", expected the depth camera's " +
                               std::to_string(depth_rays_.cols) + "x" + std::to_string(depth_rays_.rows));
    }
    if (depth.t_ns < next_depth_ns_) return;
    next_depth_ns_ = depth.t_ns + NsFromSeconds(arguments_.every_s);
    depths_.push_back({depth.t_ns, depth.depth_m.clone()});
  }
  void Finish() { ProcessDue(true); }

  const Curve& curve() const { return curve_; }
  const Example& example() const { return example_; }

 private:
  std::int64_t Margin() const { return NsFromSeconds(arguments_.search_s + kMaxHalfWindow_s + 0.001); }

  void ProcessDue(bool all) {
    while (!depths_.empty() && (all || window_.last_ns() > depths_.front().t_ns + Margin())) {
      Process(depths_.front());
      depths_.pop_front();
    }
  }

  void Process(const DepthImage& depth) {
    const double pixels = rig_.event_camera.width() * rig_.event_camera.height();
    const std::int64_t widest_ns = NsFromSeconds(kMaxHalfWindow_s);
    const double count = static_cast<double>(window_.CountIn(depth.t_ns - widest_ns, depth.t_ns + widest_ns));
    if (count < kMinEventShare * pixels) return;  // stands still
    const auto half_ns =
        static_cast<std::int64_t>(static_cast<double>(widest_ns) * std::min(1.0, kEventShare * pixels / count));
    const std::vector<Silhouette> points =
        ProjectSilhouettes(depth.depth_m, depth_rays_, rig_.T_event_depth, window_.undistorted());
    if (points.size() < kMinPoints) return;

    for (std::size_t i = 0; i < curve_.offset_s.size(); ++i) {
      const std::int64_t t_ns = depth.t_ns + NsFromSeconds(curve_.offset_s[i]);
      const CrestFit fit(window_.Accumulate(t_ns - half_ns, t_ns + half_ns));
      for (const Silhouette& point : points) curve_.Add(i, fit.Distance(point));
    }
    curve_.points += static_cast<double>(points.size());
    ++curve_.images;
    if (points.size() > example_.points.size()) {
      const std::int64_t best_ns = depth.t_ns + NsFromSeconds(curve_.BestOffset());
      example_ = {points, window_.Accumulate(depth.t_ns - half_ns, depth.t_ns + half_ns),
                  window_.Accumulate(best_ns - half_ns, best_ns + half_ns), depth.t_ns, half_ns};
    }
  }

  Arguments arguments_;
  Rig rig_;
  cv::Mat2f depth_rays_;
  EventWindow window_;
  std::deque<DepthImage> depths_;
  std::int64_t next_depth_ns_ = INT64_MIN;
  Curve curve_;
  Example example_;
};

/// Events in grey, silhouettes of the depth image in red.
cv::Mat DrawOverlay(const cv::Mat1w& events, const std::vector<Silhouette>& points, const std::string& title) {
  // Small sensors' pixels would be hard to see.
  const int scale = events.cols < 400 ? 3 : events.cols < 1000 ? 2 : 1;
  cv::Mat1b grey;
  events.convertTo(grey, CV_8U, 255.0 / (2 * kEventWeight));
  cv::Mat picture;
  cv::cvtColor(255 - grey, picture, cv::COLOR_GRAY2BGR);
  cv::resize(picture, picture, cv::Size(), scale, scale, cv::INTER_NEAREST);
  for (const Silhouette& point : points) {
    // Centre of the pixel after scaling; small, so that the events stay visible beneath.
    const cv::Point u = (point.u + cv::Point2f(0.5F, 0.5F)) * scale;
    if (cv::Rect(0, 0, picture.cols, picture.rows).contains(u)) picture.at<cv::Vec3b>(u) = {0, 0, 255};
  }
  cv::rectangle(picture, {0, 0, picture.cols, 18}, {255, 255, 255}, cv::FILLED);
  cv::putText(picture, title, {4, 13}, cv::FONT_HERSHEY_SIMPLEX, 0.42, {0, 0, 0}, 1, cv::LINE_AA);
  return picture;
}

cv::Mat DrawCurve(const Curve& curve, int width) {
  constexpr int kHeight = 200, kMargin = 36;
  cv::Mat picture(kHeight, width, CV_8UC3, cv::Scalar::all(255));
  const double span_s = curve.offset_s.back() - curve.offset_s.front();
  const double most = *std::max_element(curve.fit.begin(), curve.fit.end());
  const auto place = [&](double offset_s, double share) {
    return cv::Point(static_cast<int>(kMargin + (width - 2 * kMargin) * (offset_s - curve.offset_s.front()) / span_s),
                     static_cast<int>(kHeight - kMargin - (kHeight - 2 * kMargin) * share));
  };
  const auto text = [&picture](const std::string& words, const cv::Point& at) {
    cv::putText(picture, words, at, cv::FONT_HERSHEY_SIMPLEX, 0.4, {0, 0, 0}, 1, cv::LINE_AA);
  };
  cv::line(picture, place(curve.offset_s.front(), 0), place(curve.offset_s.back(), 0), {0, 0, 0});
  cv::line(picture, place(0, 0), place(0, 1), {180, 180, 180});
  const double best_s = curve.BestOffset();
  cv::line(picture, place(best_s, 0), place(best_s, 1), {0, 0, 220});
  for (std::size_t i = 1; i < curve.offset_s.size(); ++i) {
    cv::line(picture, place(curve.offset_s[i - 1], curve.fit[i - 1] / most),
             place(curve.offset_s[i], curve.fit[i] / most), {200, 80, 0}, 2, cv::LINE_AA);
  }
  char words[128];
  std::snprintf(words, sizeof words, "fit of silhouettes to event edges over time offset; best %+.1f ms", 1e3 * best_s);
  text(words, {8, 16});
  std::snprintf(words, sizeof words, "%+.0f ms", 1e3 * curve.offset_s.front());
  text(words, {8, kHeight - 12});
  std::snprintf(words, sizeof words, "%+.0f ms", 1e3 * curve.offset_s.back());
  text(words, {width - 60, kHeight - 12});
  return picture;
}

void WritePicture(const std::string& path, const Checker& checker) {
  const Example& example = checker.example();
  char title[64];
  std::snprintf(title, sizeof title, "moved by %+.1f ms", 1e3 * checker.curve().BestOffset());
  cv::Mat overlays, picture;
  cv::hconcat(DrawOverlay(example.events_at_stamp, example.points, "as stamped"),
              DrawOverlay(example.events_at_best, example.points, title), overlays);
  cv::vconcat(overlays, DrawCurve(checker.curve(), overlays.cols), picture);
  if (!cv::imwrite(path, picture)) throw std::runtime_error(path + " cannot be written");
}

void WriteCsv(const std::string& path, const Curve& curve) {
  std::ofstream file(path);
  file << "offset_s,fit,matched_share,mean_distance_px\n";
  for (std::size_t i = 0; i < curve.offset_s.size(); ++i) {
    file << curve.offset_s[i] << ',' << curve.fit[i] / curve.points << ',' << curve.matched[i] / curve.points << ','
         << curve.distance_px[i] / std::max(1.0, curve.matched[i]) << '\n';
  }
  if (!file.flush()) throw std::runtime_error(path + " cannot be written");
}

void Report(const Arguments& arguments, const RigConfig& config, const Checker& checker) {
  const Curve& curve = checker.curve();
  if (curve.images == 0) {
    throw std::runtime_error(
        "no depth image shows enough silhouettes while events show motion; expected objects in "
        "front of a background, and a moving camera");
  }
  const std::size_t best = curve.Best();
  const auto print = [&curve](const char* name, std::size_t i) {
    std::printf("%s%.0f %% of the silhouettes have an edge, %.2f px away\n", name,
                100 * curve.matched[i] / curve.points, curve.distance_px[i] / std::max(1.0, curve.matched[i]));
  };
  std::printf("%d depth images, %.0f silhouette points\n", curve.images, curve.points);
  print("as configured        ", curve.Middle());
  print("at the best offset   ", best);
  if (curve.Contrast() < 0.1) {
    std::printf("depth_time_offset_s  not observable: the fit hardly depends on time (move faster, sideways)\n");
  } else if (best == 0 || best + 1 == curve.offset_s.size()) {
    std::printf("depth_time_offset_s  beyond %.3f s of the configured one: search wider (--search)\n",
                arguments.search_s);
  } else {
    std::printf("depth_time_offset_s  %.4f (configured: %.4f)\n", config.depth_time_offset_s + curve.BestOffset(),
                config.depth_time_offset_s);
  }
  if (curve.matched[best] < 0.2 * curve.points) {
    std::printf("warning: most silhouettes lie beside the events even there: check intrinsics and T_event_depth\n");
  }
  WriteCsv(arguments.out + "/alignment.csv", curve);
  WritePicture(arguments.out + "/alignment.png", checker);
  std::printf("curve and picture    %s/alignment.csv, alignment.png\n", arguments.out.c_str());
}

void Main(const Arguments& arguments) {
  const RigConfig config = LoadRigConfig(arguments.configs, arguments.overrides);
  if (config.depth_from_lidar()) {
    throw std::invalid_argument(
        "key 'topics.points' is given, expected depth images (key 'topics.depth'): the alignment " +
        std::string("of a LiDAR's sweeps is not checked"));
  }
  if (arguments.step_s > arguments.search_s) {
    throw std::invalid_argument("--step is wider than --search: only one offset would be tried, expected less");
  }
  MakeOutputFolder(arguments.out);
  BagReader reader(arguments.bags, config, arguments.range);
  Rig rig = reader.ReadRig();
  if (rig.depth_registered) {
    rig.depth_camera = rig.event_camera;
    rig.T_event_depth = Rigid3();
  }
  Checker checker(arguments, rig);
  // What can be read of a broken recording is judged; only then is its defect said, as devo_offline does.
  std::string error;
  try {
    while (const std::optional<BagItem> item = reader.Next()) {
      if (const auto* slice = std::get_if<EventSlice>(&*item)) checker.Add(slice->events);
      if (const auto* depth = std::get_if<DepthImage>(&*item)) checker.Add(*depth);
    }
  } catch (const std::exception& e) {
    error = e.what();
  }
  checker.Finish();
  if (error.empty() && !reader.Defects().empty()) error = reader.Defects().front();
  if (error.empty() || checker.curve().images > 0) Report(arguments, config, checker);
  if (!error.empty()) throw std::runtime_error(error);
}

}  // namespace
}  // namespace devo

int main(int argc, char** argv) {
  devo::Arguments arguments;
  devo::CommandLine line("--config RIG.yaml --bag A.bag [options]",
                         "Estimates depth_time_offset_s and shows how silhouettes of the depth fit the events.");
  line.Add("config", devo::Several(&arguments.configs)->required(),
           "yaml of the rig; later files override earlier ones");
  line.Add("bag", devo::Several(&arguments.bags)->required(), "recordings, read together");
  line.Add("out", devo::Shown(&arguments.out), "folder for alignment.csv and alignment.png, made if missing");
  line.Add("set", devo::Several(&arguments.overrides), "key=value that overrides the yaml");
  line.Add("start", devo::NumberIn(&arguments.range.start_s, 0, 1e9), "skip this many seconds of events");
  line.Add("duration", devo::NumberIn(&arguments.range.duration_s, 1e-3, 1e9), "seconds of events");
  line.Add("search", devo::ShownNumberIn(&arguments.search_s, 0.004, 1), "largest offset tried, seconds");
  line.Add("step", devo::ShownNumberIn(&arguments.step_s, 1e-4, 0.1), "between offsets tried, seconds");
  line.Add("every", devo::ShownNumberIn(&arguments.every_s, 0, 1e6), "seconds between depth images used");
  if (const auto status = line.Read(argc, argv)) return *status;
  try {
    devo::Main(arguments);
  } catch (const std::exception& error) {
    std::cerr << "devo_check_alignment: " << error.what() << "\n";
    return 2;
  }
  return 0;
}
