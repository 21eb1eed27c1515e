// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/brick_types.h>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

struct BrickTrackerConfig {
  double camera_std_m{0.003};
  double camera_std_rad{0.003};
  double localisation_std_m{0.01};
  double localisation_std_rad{0.005};
  int looks_per_standpoint{2};
  double floor_std_m{0.001};
  double floor_std_rad{0.002};
  double gate_chi2{22.5};  // 99.9 %
  int moved_looks{2};
  // In the simulated pile at most a tenth of a present brick was called free, and two thirds of a removed one. Other
  // objects hide the rest from any one standpoint.
  double free_share{0.5};
  int inside_samples{4};

  static void fields(BrickTrackerConfig& c, interactive_mapping::Fields& f) {
    f("camera_std_m", c.camera_std_m, 0.0, 1.0, "m",
      "standard deviation of the camera's position in tf, shared by all views from one standpoint");
    f("camera_std_rad", c.camera_std_rad, 0.0, 1.0, "rad", "the same of its rotation");
    f("localisation_std_m", c.localisation_std_m, 0.0, 1.0, "m",
      "standard deviation of the robot's position in the map, drifting: what was seen from elsewhere is off by it");
    f("localisation_std_rad", c.localisation_std_rad, 0.0, 1.0, "rad", "the same of its heading");
    f("looks_per_standpoint", c.looks_per_standpoint, 1, 1000, "looks",
      "latest views from one standpoint whose mean counts; they share light, lens and depth camera");
    f("floor_std_m", c.floor_std_m, 0.0, 1.0, "m",
      "standard deviation that no number of standpoints removes: calibration of camera and mast");
    f("floor_std_rad", c.floor_std_rad, 0.0, 1.0, "rad", "the same of the rotation");
    f("gate_chi2", c.gate_chi2, 1.0, 1e4, "",
      "a view with a larger chi-square, of six degrees of freedom, shows a brick that has moved");
    f("moved_looks", c.moved_looks, 1, 100, "looks",
      "views that must agree on another pose before it is accepted, and that a second brick with an id needs to stay");
    f("free_share", c.free_share, 0.01, 1.0, "",
      "a brick is dropped when the map has seen this share of its inside free");
    f("inside_samples", c.inside_samples, 1, 50, "", "points per edge of the inside that the map is asked about");
  }
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

/// Bricks over time, in the map. Static between observations. A moved brick is at its new place once enough
/// observations agree, and nowhere twice. A brick whose place the map has seen free since is gone. A brick in view that
/// is not decoded says nothing. A bad look beside a good one makes no second brick: instances of an id within each
/// other are one, that with most looks. Not thread-safe.
///
/// Of each brick the mean of the looks from each standpoint is kept, with the looks' own information. A standpoint's mean
/// has the covariance of that plus that of the camera's pose there; the standpoints are independent, and fused with it.
/// The floor is added to the result.
class BrickTracker {
 public:
  /// Throws std::invalid_argument listing what is wrong with the config.
  BrickTracker(const mp700_ur5e_description::BrickCatalogue& catalogue, const BrickTrackerConfig& config);

  /// Takes in one image's bricks. Returns the indices into bricks() of those seen, in the order of `sightings`. A
  /// sighting that is held back (moved, not yet accepted) or ignored (in the hand) has none. Several of one id in an
  /// image are as many instances. Throws std::invalid_argument, and changes nothing, if the stamp is before the last
  /// observation's or not finite. So it does if a pose or covariance is invalid, or an id is unknown.
  std::vector<std::optional<std::size_t>> addLook(double stamp_s, const Eigen::Isometry3d& T_map_camera,
                                                  const std::vector<BrickSighting>& sightings);

  /// Points inside each brick [m, map frame], in the order of bricks(): what to ask the map about. A regular grid, its
  /// outermost points 2 cm below the faces, or a quarter of the edge where a brick is thinner than 8 cm. Nearer points
  /// may belong to the surface of the brick or of a neighbour.
  std::vector<Eigen::Matrix3Xd> insidePoints() const;

  /// Drops the bricks whose inside was seen free. `free_share`: for each of bricks() the share of its insidePoints() that
  /// the map calls free; `map_stamp_s`: of the last image in the map. Bricks seen at or after it stay. Returns the
  /// dropped ids. Throws std::invalid_argument if the sizes differ, or a number is none or no share.
  std::vector<int> dropFree(const std::vector<double>& free_share, double map_stamp_s);

  /// The brick is in the hand. It is taken out, and observations of it are ignored until it is let go. Other instances
  /// stay. An instance is not asked for: of several with this id the one nearest to `p_map` goes. Returns whether one
  /// was known. Throws std::invalid_argument for an unknown id or a point that is not finite.
  bool attach(int id, const Eigen::Vector3d& p_map);

  /// The brick in the hand was let go at `stamp_s`: looks from then on show it, at a new place but as the same instance.
  /// Earlier ones that come late still show it in the hand. Nothing happens if there was none.
  void detach(double stamp_s = -std::numeric_limits<double>::infinity());

  /// Forgets all bricks and the time, as after a jump of time or of the map. What is in the hand stays there.
  void clear();

  /// In order of id and instance.
  const std::vector<TrackedBrick>& bricks() const { return bricks_; }

 private:
  /// One sighting in the map, with its own covariance and what the camera's pose adds.
  struct Look {
    Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};
    Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
    Matrix6d covariance{Matrix6d::Identity()};
    Matrix6d camera_covariance{Matrix6d::Identity()};
    Matrix6d drift_covariance{
        Matrix6d::Identity()};  ///< what localisation may have drifted until a look from elsewhere
  };
  struct Standpoint {
    Look mean;                               ///< the camera's pose is the first look's
    Matrix6d information{Matrix6d::Zero()};  ///< of the latest looks, without the camera's pose
    int num_looks{0};                        ///< of these
  };
  /// Where a brick is against the robot's pose in the map as it is now, by all looks that agree.
  struct Place {
    std::vector<Standpoint> standpoints;  ///< that of the latest look is the last
    Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
    Matrix6d covariance{Matrix6d::Identity()};
    int num_looks{0};
  };
  struct Track {
    TrackedBrick brick;
    Place place;
    std::optional<Place> moved_to;  ///< not yet believed
    bool was_duplicate{false};      ///< in the last look
  };
  /// A brick that is or was in the hand.
  struct Held {
    int id{0};
    std::optional<int> instance;
    double released_s{std::numeric_limits<double>::infinity()};
  };

  class Assignment;

  Look makeLook(const Eigen::Isometry3d& T_map_camera, const BrickSighting& sighting) const;
  void add(const Look& look, Place* place) const;
  void fuse(Place* place) const;
  double separation(const Look& look, const Standpoint& standpoint) const;
  double chi2(const Look& look, const Place& place) const;
  void dropUnconfirmed(int id, double stamp_s);
  void dropImpossible(int id);
  int freeInstance(int id) const;
  void publish();

  mp700_ur5e_description::BrickCatalogue catalogue_;
  BrickTrackerConfig config_;
  Matrix6d floor_{Matrix6d::Zero()};
  std::vector<Track> tracks_;  ///< in the order of bricks_
  std::vector<TrackedBrick> bricks_;
  std::optional<Held> attached_;
  std::vector<Held> released_;  ///< let go, and not seen since
  double last_look_s_{-std::numeric_limits<double>::infinity()};
};

}  // namespace brick_detection
