// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/tracking_status.h"

#include "devo/core/time.h"

namespace devo {
namespace {

constexpr double kDegradedShare = 0.35;
constexpr double kInertialLostAfter_s = 0.6;  // as kLostAfter_s, bridged by an inertial sensor
constexpr double kKnownLostAfter_s = 1.2;     // that knows the acceleration, too: a view can pass between depth images
constexpr double kBadFor_s = 0.03;            // matching next to nothing, a pose is not the events' any more
// Where a pose is suspicious a better is sought, every few surfaces.
constexpr double kSearchEvery_s = 0.04;

}  // namespace

int TrackingStatus::PosesIn(double span_s) const { return CountIn(span_s, quality_.rate_hz()); }

bool TrackingStatus::MatchesNothing() const { return quality_.bad_in_a_row() >= PosesIn(kBadFor_s); }

double TrackingStatus::UnseenFor_s(std::int64_t t_ns) const { return SecondsFromNs(t_ns - seen_ns_); }

void TrackingStatus::NoteNewView(std::int64_t t_ns) {
  seen_ns_ = t_ns;
  quality_.ForgetUsual();
  begun_ = coasted_ = unsure_ = true;
}

void TrackingStatus::NoteStandstill() {
  if (state_ == TrackingState::kInitialising) state_ = TrackingState::kTracking;
}

void TrackingStatus::NoteMatch(double inlier_share, const Leads& by) {
  const bool suspicious = quality_.IsSuspicious(inlier_share);
  coasted_ = coasted_ && suspicious;
  begun_ = begun_ && suspicious;
  quality_.Note(inlier_share);
  const double inertial_s = by.knows_acceleration ? kKnownLostAfter_s : kInertialLostAfter_s;
  const double lost_after_s = by.inertial ? inertial_s : kLostAfter_s;
  if (quality_.bad_in_a_row() >= PosesIn(lost_after_s) && !by.depth) {
    state_ = TrackingState::kLost;
  } else if (inlier_share < kDegradedShare || (lost() && doubtful())) {
    // Where depth agrees with where it is led to, it is followed, whether events match or not.
    if (!lost() || by.depth_alone) state_ = TrackingState::kDegraded;
  } else {
    state_ = lost() ? TrackingState::kRecovered : TrackingState::kTracking;
  }
}

void TrackingStatus::NoteSurface(std::int64_t t_ns, bool still) {
  if (!lost() || still) seen_ns_ = t_ns;
}

bool TrackingStatus::WantsSearch(std::int64_t t_ns, double inlier_share, bool inertial) {
  const int search_every = PosesIn(kSearchEvery_s);
  const bool in_turn = quality_.suspicious_in_a_row() % search_every == search_every - 1;
  // What a search did not find, the next surface hardly shows better.
  const bool searched = t_ns - searched_ns_ < NsFromSeconds(kSearchEvery_s);
  // Where a motion turns round, few edges cross pixels: no reason to doubt what an inertial sensor saw.
  const bool in_doubt = in_turn && (quality_.IsBad(inlier_share) || !inertial);
  const bool wants = unsure_ || (quality_.IsSuspicious(inlier_share) && ((coasted_ && !searched) || in_doubt));
  if (wants) searched_ns_ = t_ns;
  unsure_ = false;
  return wants;
}

}  // namespace devo
