// SPDX-License-Identifier: BSD-3-Clause
//
// How large errors of alignments are against what their information (J'J, one standard deviation for all) says, by what
// is seen of them at once: how far points miss their edges (the variance factor of least squares), and how fast the
// edges move. Where they move slowly a miss is each edge's own, and the mean over many has little of it; where they
// move fast it is latency, which is alike for edges of like brightness. Depth tells the rest, where there is time for
// it (ErrorScale).
#pragma once

namespace devo {

/// Not thread-safe.
class ResidualScale {
 public:
  /// An alignment that is to be trusted, `since_s` after the surface before: the mean distance of its points to their
  /// edges (px) and the mean speed of the edges across themselves (px/s).
  void Note(double since_s, double mean_residual_px, double flow_px_s);

  /// Of variances, 0.25 to 10; 1 before anything is known.
  double variance_scale() const { return scale_; }

 private:
  double scale_ = 1, known_s_ = 0;
};

}  // namespace devo
