// SPDX-License-Identifier: BSD-3-Clause
#include "planning_problems/planning_problems.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include <gpis_mapping/gpis_map.h>
#include <gpis_mapping/mesh_extractor.h>
#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/robot_names.h>

#include "simulated_world/box_separation.h"
#include "simulated_world/settle.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace experiments {
namespace {

using mp700_ur5e_description::BrickFace;
using simulated_world::BrickPlacement;
using synthetic_depth::SeededRandom;

constexpr const char* kScenes[] = {"two_rows", "one_heap", "wall", "two_ridges", "three_heaps"};
constexpr double kMinStandoff_m = 0.05;
constexpr double kMaxStandoff_m = 0.25;
constexpr double kSideGap_m = 0.05;  // the robot's sides to bricks
constexpr double kMaxRange_m = 3.5;
constexpr double kMinRange_m = 0.3;
constexpr double kBaseline_m = 0.05;
constexpr double kNoiseFloor_m = 0.0005;
constexpr double kMapMargin_m = 0.8;  // of the mapped region round the pile: to under the robot's front half

// From the shoulder to the origin of wrist 3 with the arm stretched (Denavit-Hartenberg table of the maker), and a tenth
// less: what is farther is no planning problem but one of standing.
const double kReach_m = 0.9 * std::hypot(0.425 + 0.3922 + 0.0997, 0.1333);
constexpr double kWristToTip_m = 0.0996 + 0.10;  // flange and magnet, along the tool's axis

/// The map's frame is not the world's: what takes the ground for z = 0 or faces for lying along axes and on the borders of
/// grids must fail here. Upright, as `map` is.
Eigen::Isometry3d mapFromWorld() {
  Eigen::Isometry3d T_map_world = Eigen::Isometry3d::Identity();
  T_map_world.translation() << 0.137, -0.211, 0.0173;
  T_map_world.rotate(Eigen::AngleAxisd(0.31, Eigen::Vector3d::UnitZ()));
  return T_map_world;
}

Eigen::Isometry3d standing(const Eigen::Vector2d& xy, double yaw_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << xy.x(), xy.y(), 0.0;
  T.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

Eigen::Isometry3d shaken(const Eigen::Isometry3d& T, double std_m, double std_rad, SeededRandom* random) {
  const auto normal = [random](Eigen::Index) { return random->normal(); };
  const Eigen::Vector3d shift = std_m * Eigen::Vector3d::NullaryExpr(normal);
  const Eigen::Vector3d turn = std_rad * Eigen::Vector3d::NullaryExpr(normal);
  Eigen::Isometry3d result = T;
  result.translation() += shift;
  if (turn.norm() > 0.0) result.linear() = T.linear() * Eigen::AngleAxisd(turn.norm(), turn.normalized()).matrix();
  return result;
}

bool isTopmost(const BrickPlacement& brick, const std::vector<BrickPlacement>& all) {
  constexpr double kGrazing_m = 0.005;  // bricks stand side by side, not quite parallel
  constexpr double kStep_m = 0.1;       // half the height of a brick
  for (double lift_m = kStep_m; lift_m < 1.0; lift_m += kStep_m) {
    const Eigen::Isometry3d T_lifted = Eigen::Translation3d(0.0, 0.0, lift_m) * brick.T_map_brick;
    for (const BrickPlacement& other : all) {
      const bool is_higher = other.T_map_brick.translation().z() > brick.T_map_brick.translation().z() + 0.05;
      if (is_higher && simulated_world::boxSeparation(T_lifted, brick.type.size_m, other.T_map_brick,
                                                      other.type.size_m) < -kGrazing_m) {
        return false;
      }
    }
  }
  return true;
}

/// Those on which nothing lies, highest first.
std::vector<BrickPlacement> topmostOf(const std::vector<BrickPlacement>& bricks) {
  std::vector<BrickPlacement> topmost;
  std::copy_if(bricks.begin(), bricks.end(), std::back_inserter(topmost),
               [&](const BrickPlacement& brick) { return isTopmost(brick, bricks); });
  std::stable_sort(topmost.begin(), topmost.end(), [](const BrickPlacement& a, const BrickPlacement& b) {
    // Lying side by side is the same height; they come to rest some tenths of a millimetre apart.
    return std::round(a.T_map_brick.translation().z() / 0.02) > std::round(b.T_map_brick.translation().z() / 0.02);
  });
  return topmost;
}

/// Where bricks begin for a robot that drives along x of `T_world_lane`: smallest x of any brick within
/// [right_m, left_m]. Nothing: the lane is empty.
std::optional<double> firstInLane(const std::vector<BrickPlacement>& bricks, const Eigen::Isometry3d& T_world_lane,
                                  double right_m, double left_m) {
  const Eigen::Isometry3d T_lane_world = T_world_lane.inverse();
  double first_m = std::numeric_limits<double>::infinity();
  for (const BrickPlacement& brick : bricks) {
    std::array<Eigen::Vector2d, 8> corners;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Eigen::Vector3d sign((i & 1U) != 0 ? 0.5 : -0.5, (i & 2U) != 0 ? 0.5 : -0.5, (i & 4U) != 0 ? 0.5 : -0.5);
      corners[i] = (T_lane_world * (brick.T_map_brick * sign.cwiseProduct(brick.type.size_m))).head<2>();
    }
    // The outline's edges are among the lines between all pairs of corners, and the other lines are inside.
    for (const Eigen::Vector2d& a : corners) {
      for (const Eigen::Vector2d& b : corners) {
        const double low_m = std::max(std::min(a.y(), b.y()), right_m);
        const double high_m = std::min(std::max(a.y(), b.y()), left_m);
        if (low_m > high_m) continue;
        for (const double y_m : {low_m, high_m}) {
          const double share = std::abs(b.y() - a.y()) > 1e-9 ? (y_m - a.y()) / (b.y() - a.y()) : 0.0;
          first_m = std::min(first_m, a.x() + share * (b.x() - a.x()));
        }
      }
    }
  }
  if (!std::isfinite(first_m)) return std::nullopt;
  return first_m;
}

/// The robot on its way round a pile with its camera: truth in, map out. Frame of all poses: world.
class Surveyor {
 public:
  Surveyor(const SurveyConfig& config, const std::vector<BrickPlacement>& bricks,
           const Eigen::Isometry3d& T_base_camera, std::uint64_t seed)
      : config_(config),
        T_base_camera_(T_base_camera),
        seed_(seed),
        map_(mapConfig(config, bricks)),
        mesh_(map_.config()) {
    scene_.T_map_scene = mapFromWorld();
    const double height_px = 0.75 * config.width_px;
    scene_.camera = {config.width_px,        static_cast<int>(height_px),   config.focal_length_px,
                     config.focal_length_px, 0.5 * (config.width_px - 1.0), 0.5 * (height_px - 1.0)};
    scene_.sensor.min_range_m = kMinRange_m;
    scene_.sensor.max_range_m = kMaxRange_m;
    scene_.sensor.axial_noise_a_m = kNoiseFloor_m;
    scene_.sensor.axial_noise_c_per_m = config.depth_noise_per_m;
    scene_.sensor.baseline_m = kBaseline_m;
    scene_.sensor.has_shadows = config.has_shadows;
    for (const BrickPlacement& brick : bricks) {
      synthetic_depth::Box box;
      box.id = brick.id;
      box.T_scene_box = brick.T_map_brick;
      box.half_extents_m = 0.5 * brick.type.size_m;
      scene_.boxes.push_back(box);
    }
  }

  void look(const Eigen::Isometry3d& T_world_base) {
    const auto number = static_cast<std::uint64_t>(looks_);
    scene_.T_scene_camera = {T_world_base * T_base_camera_};
    scene_.seed = SeededRandom(seed_, 1, number).next();
    const cv::Mat depth = synthetic_depth::measureDepth(scene_, 0);
    gpis_mapping::DepthImage image{depth.cols, depth.rows, {}};
    image.depth_m.assign(depth.ptr<float>(), depth.ptr<float>() + depth.total());
    const auto& camera = scene_.camera;
    SeededRandom random(seed_, 2, number);
    map_.update(image, {camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px},
                shaken(scene_.cameraInMap(0), config_.pose_error_m, config_.pose_error_rad, &random),
                100.0 + static_cast<double>(looks_));
    ++looks_;
  }

  /// The way a robot comes: straight on, then along an arc with its face to the pile.
  void comeFrom(double from_rad) {
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    for (const synthetic_depth::Box& brick : scene_.boxes) {
      middle += brick.T_scene_box.translation().head<2>() / static_cast<double>(scene_.boxes.size());
    }
    double extent_m = 0.0;
    for (const synthetic_depth::Box& brick : scene_.boxes) {
      extent_m = std::max(extent_m, (brick.T_scene_box.translation().head<2>() - middle).norm());
    }
    const auto lookFrom = [&](double distance_m, double bearing_rad) {
      const Eigen::Vector2d out(std::cos(bearing_rad), std::sin(bearing_rad));
      look(standing(middle + distance_m * out, bearing_rad + M_PI));
    };
    const double arc_radius_m = extent_m + 1.1;
    for (int i = 0; i < config_.approach_looks; ++i) {
      lookFrom(arc_radius_m + 0.5 * (config_.approach_looks - i), from_rad);
    }
    for (int i = 0; i < config_.arc_looks; ++i) {
      const double share = config_.arc_looks == 1 ? 0.0 : 2.0 * i / (config_.arc_looks - 1.0) - 1.0;
      lookFrom(arc_radius_m, from_rad + share * config_.half_arc_rad);
    }
  }

  void report(Stand* stand) {
    stand->map = map_.snapshot();
    stand->looks = looks_;
    mesh_.update(*stand->map);
    const gpis_mapping::TriangleMesh mesh = mesh_.mesh();
    stand->surface = {mesh.vertices_map, mesh.normals_map, mesh.triangles};
  }

 private:
  static gpis_mapping::GpisConfig mapConfig(const SurveyConfig& config, const std::vector<BrickPlacement>& bricks) {
    gpis_mapping::GpisConfig map;
    map.threads = 1;  // times are compared, and two test programs run beside one another
    map.sensor.min_range_m = kMinRange_m;
    map.sensor.max_range_m = kMaxRange_m;
    map.sensor.baseline_m = kBaseline_m;
    map.sensor.noise = {kNoiseFloor_m, 0.0, config.depth_noise_per_m};
    map.sensor.pose_std_m = std::max(map.sensor.pose_std_m, config.pose_error_m);
    Eigen::AlignedBox3d pile;
    for (const BrickPlacement& brick : bricks) pile.extend(mapFromWorld() * brick.T_map_brick.translation());
    map.region.min_m = pile.min() - Eigen::Vector3d::Constant(kMapMargin_m);
    map.region.max_m = pile.max() + Eigen::Vector3d::Constant(kMapMargin_m);
    return map;
  }

  SurveyConfig config_;
  Eigen::Isometry3d T_base_camera_;
  std::uint64_t seed_;
  synthetic_depth::Scene scene_;
  gpis_mapping::GpisMap map_;
  gpis_mapping::MeshExtractor mesh_;
  int looks_{0};
};

/// The one that looks up first, then those that the robot sees, the most frontal one first. `T_base_brick`: in base_link.
std::vector<BrickFace> facesToTry(const Eigen::Isometry3d& T_base_brick) {
  std::vector<std::pair<double, BrickFace>> rated;
  for (const BrickFace face : mp700_ur5e_description::kBrickFaces) {
    const Eigen::Vector3d normal_base = T_base_brick.linear() * mp700_ur5e_description::faceNormal(face);
    constexpr double kUpwards = 0.5;  // cosine: within 60 degrees of up
    if (normal_base.z() > kUpwards) {
      rated.emplace_back(2.0 + normal_base.z(), face);
    } else if (normal_base.z() > -kUpwards && normal_base.x() < 0.0) {
      rated.emplace_back(-normal_base.x(), face);
    }
  }
  std::sort(rated.begin(), rated.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<BrickFace> faces;
  faces.reserve(rated.size());
  for (const auto& rating : rated) faces.push_back(rating.second);
  return faces;
}

}  // namespace

std::vector<std::string> SurveyConfig::validate() const {
  interactive_mapping::RangeCheck check("survey/");
  check("approach_looks", approach_looks, 0, 100, "");
  check("arc_looks", arc_looks, 0, 100, "");
  check("half_arc_rad", half_arc_rad, 0.0, M_PI, "rad");
  check("stand_looks", stand_looks, 0, 2, "");
  check("looks in all", approach_looks + arc_looks + stand_looks, 1, 202, "");
  check("depth_noise_per_m", depth_noise_per_m, 0.0, 0.05, "1/m");
  check("pose_error_m", pose_error_m, 0.0, 0.1, "m");
  check("pose_error_rad", pose_error_rad, 0.0, 0.1, "rad");
  check("width_px", width_px, 40, 4000, "px");
  check("focal_length_px", focal_length_px, 10.0, 1e4, "px");
  return check.problems();
}

ProblemMaker::ProblemMaker(const ProblemFiles& files, const SurveyConfig& survey)
    : survey_(survey),
      robot_(mp700_ur5e_description::RobotModel::load(files.description + "/urdf/mp700_ur5e.urdf")),
      profile_(mp700_ur5e_description::loadBaseProfile(files.description + "/config/base_profile.yaml")),
      catalogue_(mp700_ur5e_description::loadBrickTypes(files.description + "/config/bricks.yaml")),
      stowed_(mp700_ur5e_description::loadArmPose(files.description + "/config/arm_poses/stowed.yaml")) {
  interactive_mapping::refuseIfAny("impossible survey:", survey.validate());
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
  T_base_camera_ = robot_->framePose(mp700_ur5e_description::kDepthFrame, zero);
  // Lift axis: where the second joint's body has its origin.
  std::vector<Eigen::Isometry3d> T_root_body;
  robot_->bodyPoses(zero, &T_root_body);
  shoulder_base_ = T_root_body[robot_->jointIndex(mp700_ur5e_description::kArmJoints[1]) + 1].translation();
  for (const char* scene : kScenes) {
    scenes_.push_back(
        simulated_world::loadPileScene(files.worlds + "/" + scene + ".yaml", catalogue_.types, catalogue_.maxBricks()));
    scenes_.back().name = scene;
  }
}

motion_planning::ArmGoal ProblemMaker::containerGoal() const {
  motion_planning::PlaceGoal place;
  place.T_base_place = robot_->framePose(mp700_ur5e_description::kContainerPlaces[0],
                                         Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size())));
  motion_planning::ArmGoal goal;
  goal.place = place;
  return goal;
}

bool ProblemMaker::isInReach(const BrickPlacement& brick, const Eigen::Isometry3d& T_base_world) const {
  const Eigen::Isometry3d T_base_brick = T_base_world * brick.T_map_brick;
  const std::vector<BrickFace> faces = facesToTry(T_base_brick);
  return std::any_of(faces.begin(), faces.end(), [&](BrickFace face) {
    const Eigen::Vector3d normal = mp700_ur5e_description::faceNormal(face);
    const Eigen::Vector3d wrist = 0.5 * brick.type.size_m.cwiseProduct(normal) + kWristToTip_m * normal;
    return (T_base_brick * wrist - shoulder_base_).norm() < kReach_m;
  });
}

std::optional<ProblemMaker::Standing> ProblemMaker::drawStanding(const std::vector<BrickPlacement>& bricks,
                                                                 const BrickPlacement& aim, double from_rad,
                                                                 SeededRandom* random) const {
  double front_m = 0.0;
  double half_width_m = 0.0;
  for (const Eigen::Vector2d& corner : profile_.body.footprint_m) {
    front_m = std::max(front_m, corner.x());
    half_width_m = std::max(half_width_m, std::abs(corner.y()));
  }
  for (int attempt = 0; attempt < 30; ++attempt) {
    const double yaw_rad = from_rad + M_PI + random->uniform(-1.0, 1.0) * survey_.half_arc_rad;
    const double offset_m = random->uniform(-0.2, 0.2);
    const double standoff_m = random->uniform(kMinStandoff_m, kMaxStandoff_m);
    const Eigen::Isometry3d T_world_lane =
        standing(aim.T_map_brick.translation().head<2>(), yaw_rad) * Eigen::Translation3d(0.0, offset_m, 0.0);
    const std::optional<double> first_m =
        firstInLane(bricks, T_world_lane, -half_width_m - kSideGap_m, half_width_m + kSideGap_m);
    if (!first_m) continue;
    const Eigen::Isometry3d T = T_world_lane * Eigen::Translation3d(*first_m - standoff_m - front_m, 0.0, 0.0);
    if (isInReach(aim, T.inverse())) return Standing{T, standoff_m};
  }
  return std::nullopt;
}

std::vector<PlanningProblem> ProblemMaker::problemsOfPile(std::uint64_t seed, int max_stands, int max_targets) const {
  const simulated_world::PileSceneConfig& scene = scenes_[(seed - 1) % scenes_.size()];
  std::vector<BrickPlacement> bricks;
  try {
    bricks = simulated_world::settlePile(scene, seed).scene.bricks;
  } catch (const std::runtime_error&) {
    return {};  // five attempts, and none came to rest as it should
  }
  SeededRandom random(seed, 17, 0);
  const double from_rad = random.uniform(-M_PI, M_PI);
  Surveyor surveyor(survey_, bricks, T_base_camera_, seed);
  surveyor.comeFrom(from_rad);
  const std::vector<BrickPlacement> topmost = topmostOf(bricks);

  std::vector<PlanningProblem> problems;
  for (int s = 0; s < max_stands; ++s) {
    // Before a brick that lies on top: it is the one the robot came for, and whatever else is in reach from there.
    const BrickPlacement& aim = topmost[random.next() % topmost.size()];
    const std::optional<Standing> place = drawStanding(bricks, aim, from_rad, &random);
    if (!place) continue;
    const Eigen::Isometry3d T_base_world = place->T_world_base.inverse();

    auto stand = std::make_shared<Stand>();
    stand->scene = scene.name;
    stand->seed = seed;
    stand->T_map_base = mapFromWorld() * place->T_world_base;
    stand->standoff_m = place->standoff_m;
    stand->bricks = bricks;
    for (BrickPlacement& brick : stand->bricks) brick.T_map_brick = mapFromWorld() * brick.T_map_brick;
    if (survey_.stand_looks > 1) surveyor.look(place->T_world_base * Eigen::Translation3d(-1.0, 0.0, 0.0));
    if (survey_.stand_looks > 0) surveyor.look(place->T_world_base);
    surveyor.report(stand.get());

    int taken = 0;
    for (const BrickPlacement& brick : topmost) {
      if (taken == max_targets) break;
      if (!isInReach(brick, T_base_world)) continue;
      PlanningProblem problem;
      problem.name =
          scene.name + "_" + std::to_string(seed) + "_stand" + std::to_string(s) + "_brick" + std::to_string(brick.id);
      problem.stand = stand;
      problem.target.brick_id = brick.id;
      problem.target.T_map_brick = mapFromWorld() * brick.T_map_brick;
      problem.target.type = &catalogue_.type(brick.type.name);
      problem.target.faces = facesToTry(T_base_world * brick.T_map_brick);
      problems.push_back(problem);
      ++taken;
    }
  }
  return problems;
}

}  // namespace experiments
