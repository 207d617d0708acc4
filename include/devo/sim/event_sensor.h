// SPDX-License-Identifier: BSD-3-Clause
//
// Contrast-threshold pixels: light per pixel over time in, events out.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "devo/core/event.h"
#include "devo/sim/sensors.h"

namespace devo::sim {

/// All pixels of one sensor. Rows are independent: different threads may advance different rows.
class EventPixels {
 public:
  /// `stride` >= width: distance between rows of the light that is fed in.
  EventPixels(const EventSensor& sensor, int stride, std::uint64_t seed);

  /// Starts with constant light (reflected lux per pixel, as BandRenderer gives it) at time `t_ns`.
  void StartRow(int row, std::int64_t t_ns, const float* luminance);

  /// Draws the noise events of [t0, t1) from the light that the row's pixels see now; call before advancing into it.
  void BeginNoiseBlock(int row, std::int64_t t0_ns, std::int64_t t1_ns);

  /// One pixel's light at a time in the step being advanced: share in (0, 1) of the step, column -> luminance.
  using Probe = std::function<float(double share, int column)>;

  /// How finely a pixel's light is sampled around its events, in thresholds. A step is halved, at most four times over,
  /// while the log light changes by more than `contrast` in it, or while the middle of the parabola that stands for it
  /// is farther than `straightness` from its chord.
  struct Accuracy {
    double contrast = 1;
    double straightness = 0.03;
  };

  /// Light goes from the last to `luminance` at t1; between, `probe` is asked where `accuracy` wants it. Appends the
  /// events in (t0, t1], unordered between pixels.
  void AdvanceRow(int row, std::int64_t t0_ns, std::int64_t t1_ns, const float* luminance, const Accuracy& accuracy,
                  const Probe& probe, std::vector<Event>* events);

  const EventSensor& sensor() const { return sensor_; }
  float threshold_on(int row, int column) const { return on_[Index(row, column)]; }
  float threshold_off(int row, int column) const { return off_[Index(row, column)]; }

 private:
  struct Pixel {                // touched only where something happens
    std::int64_t ready_ns = 0;  ///< end of the refractory period
    float hot_hz = 0;
    std::uint32_t random = 0;
  };
  struct Step {
    int row;
    std::int64_t t0_ns;
    double dt_s, block_s;  ///< length; begin after the noise block's begin
    double
        bend_per_slope;  ///< estimates the bend of a pixel's light from how its slope has changed since the last step
    Accuracy accuracy;
    const Probe* probe;
    std::vector<Event>* events;
  };
  struct Sample {
    double share;  ///< of the step
    float log_light;
  };
  /// A parabola over [t0, t1], seconds in the step, whose middle lies `bend` above the chord.
  struct Arc {
    double t0, t1, y0, y1, bend;
  };

  std::size_t Index(int row, int column) const { return static_cast<std::size_t>(row) * stride_ + column; }
  void AdvancePixel(const Step& step, int column, std::size_t i, float log_light);
  void Subdivide(const Step& step, int column, std::size_t i, Sample from, Sample to, double bend, int depth,
                 float* level);
  /// Answer of the photoreceptor, which is at `y0`, to light: exact at both ends and in the middle.
  Arc LowPassed(const Arc& light, double y0) const;
  /// The events while the photoreceptor's output takes this arc.
  void Fire(const Step& step, int column, std::size_t i, const Arc& arc);
  void Emit(const Step& step, int column, std::size_t i, double t_s, bool on);
  float TimeConstant(float chip_lux) const;
  float DrawNoiseTime(std::size_t i, double after_s);

  EventSensor sensor_;
  int width_, height_, stride_;
  float to_chip_lux_;
  std::vector<Pixel> pixels_;
  // One value per pixel, touched in every step, hence apart from Pixel.
  std::vector<float> light_;      ///< chip lux (with dark current) at the end of the last step
  std::vector<float> log_light_;  ///< its logarithm
  std::vector<float> slope_;      ///< change of the logarithm per second in the last step
  std::vector<float> level_;      ///< photoreceptor's output: the low-passed logarithm
  std::vector<float> reference_;  ///< level memorised at the last event; NaN while the pixel is refractory
  std::vector<float> on_, off_;   ///< thresholds
  std::vector<float> leak_;       ///< fall of the reference in the dark, log units per second
  std::vector<float> noise_s_;    ///< next noise event after the block's begin; infinite: none in this block
  std::vector<std::int64_t> block_begin_ns_;  ///< per row
  std::vector<double> block_s_;               ///< per row, length
  std::vector<double> step_s_;                ///< per row, length of the last step
};

/// Puts events of all rows in the order of their time (ties: row, column), through a readout of bounded rate.
class Readout {
 public:
  explicit Readout(const EventPixelModel& model);
  /// `events` of times after all earlier ones; sorts them, and appends to `out` what has left the chip, stamped with
  /// the time it left, in whole microseconds.
  void Pass(std::vector<Event>* events, std::vector<Event>* out);
  std::uint64_t lost() const { return lost_; }

 private:
  double period_ns_, delay_ns_;
  double free_ns_ = -1e300;
  std::uint64_t lost_ = 0;
};

}  // namespace devo::sim
