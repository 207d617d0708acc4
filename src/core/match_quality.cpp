// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/match_quality.h"

#include <algorithm>

namespace devo {
namespace {

constexpr double kBadShare = 0.15, kBadShareOfUsual = 0.4, kSuspiciousShareOfUsual = 0.7;
constexpr double kLeastOfUsual = 0.1;
// Suspicious poses change what is usual ten times more slowly: most are false, but a scene may be like that.
constexpr double kForgets_s = 0.5, kForgetsSuspicious_s = 5;

}  // namespace

bool MatchQuality::IsBad(double inlier_share) const {
  return inlier_share < std::max(kBadShare, kBadShareOfUsual * usual_share_);
}

bool MatchQuality::IsSuspicious(double inlier_share) const {
  return inlier_share < kSuspiciousShareOfUsual * usual_share_;
}

double MatchQuality::Weight(double inlier_share) const {
  const double of_usual = std::clamp(inlier_share / usual_share_, kLeastOfUsual, 1.0);
  return of_usual * of_usual;
}

void MatchQuality::Note(double inlier_share) {
  bad_in_a_row_ = IsBad(inlier_share) ? bad_in_a_row_ + 1 : 0;
  suspicious_in_a_row_ = IsSuspicious(inlier_share) ? suspicious_in_a_row_ + 1 : 0;
  const double forgets_s = suspicious_in_a_row_ > 0 ? kForgetsSuspicious_s : kForgets_s;
  usual_share_ += (inlier_share - usual_share_) / (forgets_s * rate_hz_);
}

}  // namespace devo
