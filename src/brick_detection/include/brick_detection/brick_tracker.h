// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

struct BrickTrackerConfig {
  // Of the camera's pose in the map, as tf gives it: an error that all bricks of a look share and that differs between
  // looks from elsewhere.
  double camera_std_m{0.003};
  double camera_std_rad{0.003};
  // What no number of looks removes: calibration of camera and mast.
  double floor_std_m{0.001};
  double floor_std_rad{0.002};
  double gate_chi2{22.5};  ///< six degrees of freedom, 99.9 %: a look that is farther off shows a brick that has moved
  int moved_looks{2};      ///< looks that agree on another place, before the brick is believed to be there
  double free_share{0.8};  ///< of a brick's inside that the map must have seen free before the brick is dropped
  int inside_samples{4};   ///< points per edge of the inside, for that

  std::vector<std::string> validate() const;
};

/// A brick as known from all looks.
struct TrackedBrick {
  int id{0};
  int instance{0};
  bool has_duplicate{false};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  Matrix6d covariance{Matrix6d::Identity()};  ///< as BrickSighting's, along the map's axes
  int num_looks{0};
  double first_seen_s{0.0};
  double last_seen_s{0.0};
  std::array<bool, mp700_ur5e_description::kNumBrickFaces> faces_seen{};
};

/// Bricks over time, in the map. Static between looks; one that was moved is at its new place once enough looks agree, and
/// nowhere twice; one whose place the map has seen free since is gone. Not thread-safe.
class BrickTracker {
 public:
  BrickTracker(const mp700_ur5e_description::BrickCatalogue& catalogue, const BrickTrackerConfig& config);

  /// Takes in one image's bricks. Returns the indices into bricks() of those seen, in the order of `sightings`; a
  /// sighting that is held back (moved, not yet believed) has none. Throws std::invalid_argument if the stamp is
  /// before the last look's.
  std::vector<std::optional<std::size_t>> addLook(double stamp_s, const Eigen::Isometry3d& T_map_camera,
                                                  const std::vector<BrickSighting>& sightings);

  /// Points inside each brick [m, map frame], in the order of bricks(): what to ask the map about.
  std::vector<Eigen::Matrix3Xd> insidePoints() const;

  /// Drops the bricks whose inside was seen free. `free_share`: for each of bricks() the share of its insidePoints() that
  /// the map calls free; `map_stamp_s`: of the last image in the map. Bricks seen at or after it stay. Returns the
  /// dropped ids. Throws std::invalid_argument if the sizes differ.
  std::vector<int> dropFree(const std::vector<double>& free_share, double map_stamp_s);

  /// The brick is in the hand: it is taken out, and looks of it are ignored until it is let go. An instance is not asked
  /// for: of several with this id the one nearest to `p_map` goes. Returns whether one was known.
  bool attach(int id, const Eigen::Vector3d& p_map);
  void detach();

  /// Forgets everything, as after a jump of time or of the map.
  void clear();

  /// In order of id and instance.
  const std::vector<TrackedBrick>& bricks() const { return bricks_; }

 private:
  struct Candidate {  // where a brick may have moved to
    TrackedBrick brick;
    std::size_t of{0};
  };

  mp700_ur5e_description::BrickCatalogue catalogue_;
  BrickTrackerConfig config_;
  std::vector<TrackedBrick> bricks_;
  std::vector<Candidate> candidates_;
  std::optional<int> attached_id_;
  double last_look_s_{0.0};
};

}  // namespace brick_detection
