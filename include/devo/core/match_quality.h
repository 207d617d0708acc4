// SPDX-License-Identifier: BSD-3-Clause
//
// What share of a map's points finds an edge says whether a pose can be right: against what is usual here, as scenes,
// light and sensors differ.
#pragma once

namespace devo {

/// Not thread-safe.
class MatchQuality {
 public:
  /// `rate_hz`: of poses.
  explicit MatchQuality(double rate_hz) : rate_hz_(rate_hz) {}

  /// Next to nothing was matched, or far less than usual: the pose is not the events'.
  bool IsBad(double inlier_share) const;
  /// Clearly less than usual was: the pose may be a false one.
  bool IsSuspicious(double inlier_share) const;

  /// How much a pose tells, 0 to 1: the less of it matches than usual, the more of what does may do so by chance.
  double Weight(double inlier_share) const;

  /// For each pose, in turn, what of its points was matched, 0 to 1.
  void Note(double inlier_share);

  /// Of matched points while tracking.
  double usual_share() const { return usual_share_; }
  /// The last poses that were.
  int bad_in_a_row() const { return bad_in_a_row_; }
  int suspicious_in_a_row() const { return suspicious_in_a_row_; }

  /// What is usual in a new map is not known.
  void ForgetUsual() { usual_share_ = kFirstUsualShare; }
  double rate_hz() const { return rate_hz_; }  ///< of poses
  void SetRate(double rate_hz) { rate_hz_ = rate_hz; }

 private:
  static constexpr double kFirstUsualShare = 0.5;

  double rate_hz_;
  double usual_share_ = kFirstUsualShare;
  int bad_in_a_row_ = 0, suspicious_in_a_row_ = 0;
};

}  // namespace devo
