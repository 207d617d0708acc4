// SPDX-License-Identifier: BSD-3-Clause
//
// How the image moves before any pose is known, from the events alone: of all rotations the one that lets them fall on
// the fewest places (contrast maximisation; Gallego, Rebecq, Scaramuzza, "A unifying contrast maximization framework
// for event cameras", CVPR 2018). At one depth a translation moves an image nearly as some rotation does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "devo/core/camera.h"

namespace devo {

/// Not thread-safe.
class ApparentTurn {
 public:
  explicit ApparentTurn(const Camera& undistorted);

  /// An event: its time, its viewing ray (x, y, 1), 1 where the pixel turned brighter and 0 where darker.
  struct Sighting {
    float t_s, x, y;
    int polarity;
  };

  /// rad/s, event frame: that of the camera, were all it sees far away. `events`: of the last moments, in the order of
  /// their time, some thousands. It is sought near the last answer and near zero, now and then among all; zero where
  /// no rotation makes the image clearer than chance would.
  const Eigen::Vector3d& Estimate(const std::vector<Sighting>& events);

  /// The next events are of another time.
  void Reset();

 private:
  /// The events of a span. A turn [rad/s] moves each by `move` times it, in squares of the image.
  struct Look {
    Eigen::ArrayX2f at, move_x, move_y, move_z;
    std::vector<int> polarity;
    double squares_per_turn;  // that the image moves over the span, of a turn of 1 rad/s
    int columns, rows;
    double none, sigma;  // pairs without a turn, and their standard deviation by chance
  };
  void LookAt(const std::vector<Sighting>& events, double span_s, double square_px, std::size_t most, Look* look);
  /// Of events of one polarity in one square.
  double Pairs(const Look& look, const Eigen::Vector3d& turn);
  /// These, less what a turn as fast has to be worth.
  double Sharpness(const Look& look, const Eigen::Vector3d& turn);
  Eigen::Vector3d Climb(const Look& look, Eigen::Vector3d turn);
  Eigen::Vector3d AmongAll(const Look& look);

  float fx_, fy_, cx_, cy_;
  int width_, height_;
  Look glance_, look_, all_;
  std::vector<std::uint16_t> counts_;
  Eigen::ArrayX2f moved_;
  Eigen::Vector3d turn_ = Eigen::Vector3d::Zero();
  unsigned asked_ = 0;
};

}  // namespace devo
