// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace simulated_world {

/// A wall as the judge sees it: it hides what is behind it, and is no pile.
struct PileWall {
  Eigen::Isometry3d T_map_wall{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
};

struct PileSurfaceConfig {
  std::vector<PileWall> walls;
  double sample_spacing_m{0.02};         ///< at most this between the samples of a face
  double max_view_angle_rad{1.3962634};  ///< 80 deg: flatter than this onto a face, nobody sees it
  int num_directions{96};                ///< from which somebody could look, spread evenly over the upward hemisphere
  double ground_height_m{0.0};           ///< in the map frame
  double moved_distance_m{0.001};        ///< a brick that moved or turned less than this is where it was, ...
  double moved_angle_rad{0.003};         ///< ... so that the tremor of a simulated pile changes nothing

  std::vector<std::string> validate() const;
};

/// A brick of the pile, be it moving or not. Held and stowed bricks are not in the pile.
struct PileBrick {
  int id{0};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
  bool is_resting{true};  ///< a moving brick hides others, but its own faces are not there to be mapped
};

/// Point in the middle of a rectangle of a brick's face, in the brick's frame.
struct FaceSample {
  Eigen::Vector3d p_brick;
  Eigen::Vector3d normal_brick;
  double area_m2;
};

/// All six faces of a brick, cut into equal rectangles no longer than the spacing. The areas add up to the brick's.
std::vector<FaceSample> sampleFaces(const Eigen::Vector3d& size_m, double spacing_m);

/// Unit vectors with z > 0, spread evenly (golden angle spiral).
std::vector<Eigen::Vector3d> upwardDirections(int count);

/// True pile at one moment.
struct PileTruth {
  struct Sample {
    int brick_id;
    std::size_t index;  ///< of the sample on its brick
    Eigen::Vector3d p_map;
    Eigen::Vector3d normal_map;  ///< unit, outward
    double area_m2;
  };
  std::vector<PileBrick> bricks;
  std::vector<PileWall> walls;
  std::vector<Sample> exposed;  ///< of the bricks at rest; by brick in the order of `bricks`
};

/// Whether somebody at `eye_map` sees the sample: not flatter than `max_view_angle_rad` onto its face, with none of
/// `truth.bricks` and `truth.walls` in between. Of other things it knows nothing.
bool isVisibleFrom(const Eigen::Vector3d& eye_map, const PileTruth::Sample& sample, const PileTruth& truth,
                   double max_view_angle_rad);

/// Which parts of the pile's surface could be seen from somewhere, now.
///
/// A sample is exposed if it is above the ground and a straight line from it towards at least one of the directions,
/// within the view angle of its normal, leaves the pile without meeting another brick or a wall. Exact for the given directions;
/// an update looks again only at samples whose answer a changed brick may have changed.
class PileSurface {
 public:
  /// Throws std::invalid_argument with all that is wrong with `config`.
  explicit PileSurface(const PileSurfaceConfig& config);

  /// Takes over the pile as it is now; true if anything changed, truth() being a new object then. Ids must be unique,
  /// sizes positive and poses finite; std::invalid_argument otherwise.
  bool update(const std::vector<PileBrick>& bricks);

  /// Never null; not changed by later updates.
  std::shared_ptr<const PileTruth> truth() const { return truth_; }

  /// Samples of this brick, exposed or not; the brick must be in the pile.
  const std::vector<FaceSample>& samplesOf(int id) const { return *bricks_.at(id).samples; }

 private:
  static constexpr int kUnknown = -2;
  static constexpr int kHidden = -1;

  struct Tracked {
    PileBrick brick;
    std::shared_ptr<const std::vector<FaceSample>> samples;
    std::vector<int> witness;  ///< per sample: a direction that leaves the pile, kHidden or kUnknown
  };

  bool hasMoved(const PileBrick& before, const PileBrick& now) const;
  std::shared_ptr<const std::vector<FaceSample>> samplesFor(const Eigen::Vector3d& size_m);
  int findWitness(const Tracked& tracked, const FaceSample& sample) const;
  void review(Tracked& tracked, const std::vector<PileBrick>& gone, const std::vector<PileBrick>& come) const;

  PileSurfaceConfig config_;
  std::vector<Eigen::Vector3d> directions_map_;
  std::map<int, Tracked> bricks_;
  std::vector<std::pair<Eigen::Vector3d, std::shared_ptr<const std::vector<FaceSample>>>> samples_by_size_;
  std::shared_ptr<const PileTruth> truth_;
};

}  // namespace simulated_world
