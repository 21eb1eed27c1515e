// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <gpis_mapping/map_snapshot.h>
#include <motion_planning/arm_kinematics.h>
#include <motion_planning/motion_planner.h>
#include <motion_planning/surface.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/brick_types.h>
#include <mp700_ur5e_description/robot_model.h>

#include "simulated_world/pile_scene.h"
#include "synthetic_depth/seeded_random.h"

namespace experiments {

/// How a pile was looked at, and how badly.
struct SurveyConfig {
  int approach_looks{3};             // on the way to the pile
  int arc_looks{7};                  // along an arc about it
  double half_arc_rad{1.75};         // to both sides of where the robot came from
  int stand_looks{2};                // before each standing place: a metre before it, and from it
  double depth_noise_per_m{0.0015};  // sigma of a pixel's depth z is 0.5 mm + this z^2; the map is told so
  double pose_error_m{0.0};          // sigma of the camera's position along each axis, drawn for each look ...
  double pose_error_rad{0.0};        // ... and of its rotation about each axis; the map is told the former
  bool has_shadows{true};            // as a stereo camera with a baseline of 5 cm has them
  int width_px{320};                 // 4 : 3
  double focal_length_px{262.5};

  std::vector<std::string> validate() const;
};

/// Where the files are.
struct ProblemFiles {
  std::string worlds;       // folder with the scenes
  std::string description;  // folder of mp700_ur5e_description
};

/// The robot stands before a pile. What is so and what the map says of it are kept apart: planners get `surface`, `map`,
/// `T_map_base` and the target; everything else is for who judges them.
struct Stand {
  // What is so. Frame: map, whose ground is at neither z = 0 nor along its axes.
  std::string scene;
  std::uint64_t seed{0};
  std::vector<simulated_world::BrickPlacement> bricks;  // at rest
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  double standoff_m{0.0};  // from the robot's front to the first brick in its lane

  // What the map says after the looks up to here.
  std::shared_ptr<const gpis_mapping::MapSnapshot> map;
  motion_planning::Surface surface;
  int looks{0};
};

/// Pick this brick from here.
struct PlanningProblem {
  std::string name;  // scene, seed, stand, brick
  std::shared_ptr<const Stand> stand;
  motion_planning::PickTarget target;  // pose and type as they are: detection is judged elsewhere
};

/// Makes planning problems out of settled piles. Everything is fixed by the seeds. Must outlive its problems, which point
/// at its types of bricks.
class ProblemMaker {
 public:
  /// Throws std::invalid_argument for a bad config or bad files.
  ProblemMaker(const ProblemFiles& files, const SurveyConfig& survey);
  ProblemMaker(const ProblemMaker&) = delete;
  ProblemMaker& operator=(const ProblemMaker&) = delete;

  /// All problems of one pile; which scene it is follows from the seed. At most `max_stands` standing places, at most
  /// `max_targets` bricks from each: those on which nothing lies and that an arm of this length might touch, highest
  /// first. Faces: the one that looks up first, then those towards the robot. A scene that does not settle gives none.
  std::vector<PlanningProblem> problemsOfPile(std::uint64_t seed, int max_stands = 4, int max_targets = 4) const;

  std::shared_ptr<const mp700_ur5e_description::RobotModel> robot() const { return robot_; }
  /// Where the arm starts, all joints in the order of kArmJoints.
  const motion_planning::ArmVector& stowed() const { return stowed_; }
  /// Over the first place in the container.
  motion_planning::ArmGoal containerGoal() const;

 private:
  struct Standing {
    Eigen::Isometry3d T_world_base;
    double standoff_m;
  };
  bool isInReach(const simulated_world::BrickPlacement& brick, const Eigen::Isometry3d& T_base_world) const;
  /// Before the pile, with `aim` in reach. Nothing: 30 draws have failed.
  std::optional<Standing> drawStanding(const std::vector<simulated_world::BrickPlacement>& bricks,
                                       const simulated_world::BrickPlacement& aim, double from_rad,
                                       synthetic_depth::SeededRandom* random) const;

  SurveyConfig survey_;
  std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  mp700_ur5e_description::BaseProfile profile_;
  mp700_ur5e_description::BrickCatalogue catalogue_;
  motion_planning::ArmVector stowed_;
  Eigen::Isometry3d T_base_camera_;
  Eigen::Vector3d shoulder_base_;
  std::vector<simulated_world::PileSceneConfig> scenes_;
};

}  // namespace experiments
