// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/noise_filter.h"

#include <algorithm>
#include <utility>

#include "devo/core/hot_pixels.h"
#include "devo/core/neighbour_filter.h"
#include "devo/core/time.h"

namespace devo {
namespace {

// Activity is compared over this span: long enough for a pixel at 40 Hz to stand out, short enough
// to follow changes of temperature and light.
constexpr std::int64_t kPeriod_ns = 250'000'000;
// Noise is first estimated after this time: a block at 1 Hz has a dozen events by then.
constexpr std::int64_t kFirstPeriod_ns = 50'000'000;

NeededNeighbours Asked(double window_s, int min_neighbours) {
  return {min_neighbours, static_cast<std::uint32_t>(1e6 * window_s), false};
}

}  // namespace

NoiseFilter::NoiseFilter(int width, int height, double window_s, int min_neighbours, double hot_factor)
    : asked_(Asked(window_s, min_neighbours)), hot_factor_(hot_factor), memory_(width, height, asked_.window_us),
      noise_(width, height, SecondsFromNs(kPeriod_ns)), flicker_(width, height) {
  SetNeeded();
}

void NoiseFilter::SetCriteria(double window_s, int min_neighbours, double hot_factor) {
  asked_ = Asked(window_s, min_neighbours);
  hot_factor_ = hot_factor;
  memory_.SetWindow(asked_.window_us);
  SetNeeded();
}

void NoiseFilter::Reset() {
  memory_.Clear();
  noise_.Clear();
  flicker_.Clear();
  hot_.clear();
  knows_noise_ = false;
  SetNeeded();
}

std::size_t NoiseFilter::Pass(EventSpan events, std::uint32_t* passed) {
  std::size_t count = 0;
  for (const Event* next = events.begin(); next != events.end();) {
    if (!memory_.has_begun()) {
      memory_.Begin(next->t_ns);
      counted_since_ns_ = next->t_ns;
      next_update_ns_ = next->t_ns + kFirstPeriod_ns;
    }
    memory_.ForgetLongAgo(next->t_ns);
    if (next->t_ns >= next_update_ns_) Update(next->t_ns);
    const std::int64_t end_ns = std::min(next_update_ns_, memory_.next_forgetting_ns());
    const Event* until =
        events.end()[-1].t_ns < end_ns
            ? events.end()
            : std::partition_point(next, events.end(), [&](const Event& e) { return e.t_ns < end_ns; });
    const EventSpan piece(next, static_cast<std::size_t>(until - next));
    const auto position = static_cast<std::uint32_t>(next - events.begin());
    const std::size_t of_piece = PassWithNeighbours(needed_, piece, position, &memory_, passed + count);
    noise_.CountPassed(piece.size, events.begin(), passed + count, of_piece);
    count += of_piece;
    next = until;
  }
  return count;
}

void NoiseFilter::SetNeeded() {
  needed_ = ChooseNeeded(asked_, noise_.hz(), noise_.on_share(), knows_noise_);
  mean_passing_noise_hz_ = noise_.MeanPassingHz(needed_);
}

void NoiseFilter::Update(std::int64_t t_ns) {
  // After a gap it is the events before it that were counted.
  const double span_s = SecondsFromNs(next_update_ns_ - counted_since_ns_);
  noise_.Measure(memory_, t_ns, span_s, needed_);
  flicker_.Find(memory_, t_ns, span_s);
  SetNeeded();
  if (!std::exchange(knows_noise_, true)) {
    // Too early to tell hot pixels, what was counted stays; and that there is too much noise, not that there is little.
    memory_.MarkHot(flicker_.pixels());
    next_update_ns_ = std::max(t_ns, counted_since_ns_ + kPeriod_ns);
    return;
  }
  FindHotPixels(memory_, hot_factor_, &hot_);
  memory_.BeginPeriod();
  memory_.MarkHot(hot_);
  memory_.MarkHot(flicker_.pixels());
  noise_.ForgetPassed();
  counted_since_ns_ = t_ns;
  next_update_ns_ = t_ns + kPeriod_ns;
}

}  // namespace devo
