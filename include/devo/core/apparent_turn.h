// SPDX-License-Identifier: BSD-3-Clause
//
// How the image moves, from the events alone: of all rotations the one that lets them fall on the fewest places
// (contrast maximisation; Gallego, Rebecq, Scaramuzza, "A unifying contrast maximization framework for event cameras",
// CVPR 2018). At one depth a translation moves an image nearly as some rotation does: that will do before any pose is
// known, and mends a velocity that poses tell wrongly.
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

  /// More events than this are not looked at; of more, a sample.
  static constexpr std::size_t kMostLookedAt = 6000;

  /// An event: its time, its viewing ray (x, y, 1), 1 where the pixel turned brighter and 0 where darker.
  struct Sighting {
    float t_s, x, y;
    int polarity;
  };

  /// rad/s, event frame: that of the camera, were all it sees far away. `events`: of the last moments, in the order of
  /// their time, some thousands. `read`: the camera's true turn, as a gyroscope has it; zero where there is none. It is
  /// sought near that, the last answer and zero, now and then among all; `read` where no other rotation makes the image
  /// clearer than chance would.
  const Eigen::Vector3d& Estimate(const std::vector<Sighting>& events,
                                  const Eigen::Vector3d& read = Eigen::Vector3d::Zero());

  /// rad/s, event frame: by how much more the image turned than was believed. `events`: as above, but each moved
  /// already, along the believed motion, to its ray at one common time. `believed`: the turn (rad/s, event frame) that
  /// moves the image about as that motion does. It is sought near zero, near the last answer and near an image at rest;
  /// zero where no such turn makes the image clearer.
  Eigen::Vector3d Beside(const std::vector<Sighting>& events, const Eigen::Vector3d& believed);

  /// The next events are of another time.
  void Reset();

 private:
  /// The events of a span. A turn [rad/s] moves each by `move` times it, in squares of the image.
  struct Look {
    struct Image {
      std::vector<float> u, v;
    };
    Image at, move_x, move_y, move_z;
    std::vector<std::int32_t> polarity;  // all: events, and some outside the image, to whole registers
    double squares_per_turn;             // that the image moves over the span, of a turn of 1 rad/s
    int columns, rows;
    double beforehand;  // pairs of the turn that is most likely beforehand
    double sigma;       // their standard deviation by chance
  };
  /// What a turn has to be worth.
  struct Price {
    Eigen::Vector3d from = Eigen::Vector3d::Zero();  ///< the turn that is most likely beforehand, rad/s
    double by_square = 0;                            ///< share of its pairs for each square that the image moves beside
  };
  void LookAt(const std::vector<Sighting>& events, double span_s, double square_px, std::size_t most, Look* look);
  /// Of each event, turned: twice its square and its polarity; beyond the last square where outside the image.
  void FindSquares(const Look& look, const Eigen::Vector3d& turn);
  /// Of events of one polarity in one square.
  double Pairs(const Look& look, const Eigen::Vector3d& turn);
  /// These, less what such a turn has to be worth.
  double Sharpness(const Look& look, const Eigen::Vector3d& turn);
  Eigen::Vector3d Climb(const Look& look, Eigen::Vector3d turn);
  Eigen::Vector3d AmongAll(const Look& look);

  float fx_, fy_, cx_, cy_;
  int width_, height_;
  Look glance_, look_, all_;
  Price price_;
  std::vector<std::uint16_t> counts_;  // all zero between calls
  std::vector<std::int32_t> squares_;  // of each event
  Eigen::Vector3d turn_ = Eigen::Vector3d::Zero();
  unsigned asked_ = 0;
};

}  // namespace devo
