// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/errors_alike.h"

#include <algorithm>

namespace devo {
namespace {

// Edge positions of neighbouring points err together; this many points count as one measurement of what each surface
// errs by itself, so many as one of what successive ones err alike.
constexpr double kPointsPerMeasurement = 7.5, kPointsPerShared = 6;
constexpr double kWithoutShared = 2;  // times as many of the former, where no error is taken to be shared
// That is so for surfaces this often. Of faster ones each shows mostly the events of those before it once more.
constexpr double kUsualRate_hz = 100;
// More points lie closer together on the same edges, and share their errors.
constexpr double kUsualPoints = 2000;
// A point takes so many events to place its edge. With fewer, edges are noise, and a velocity that follows it blurs the
// next surfaces until any pose matches. At most this many times less they count.
constexpr double kEventsPerPoint = 12, kFewestCount = 8;
// An inertial prior is so firm that errors which the edges of successive surfaces share would outweigh it: they count
// this many times less beside it, the less so the worse the sensor is.
constexpr double kInertialCaution = 8;

}  // namespace

ErrorsAlike PointsThatErrAlike(const AlignedPoints& of) {
  const auto points = static_cast<double>(of.points);
  const double events = std::max(1.0, static_cast<double>(of.events));
  const double few = of.weigh_events ? std::clamp(kEventsPerPoint * points / events, 1.0, kFewestCount) : 1;
  const double caution = 1 + (kInertialCaution - 1) * of.inertial_trust;
  const double close = std::max(1.0, points / kUsualPoints);
  const double weighed = std::max(caution, of.has_shared_errors ? few : kWithoutShared * few);
  const double own = kPointsPerMeasurement * close * weighed * std::max(1.0, of.rate_hz / kUsualRate_hz);
  return {own, of.has_shared_errors ? kPointsPerShared * close * few : 0};
}

}  // namespace devo
