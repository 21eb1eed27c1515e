// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/settle.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

#include "pile_generators.h"
#include "simulated_world/box_separation.h"
#include "simulated_world/pickable.h"
#include "simulated_world/world_observation.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

ModelPtr modelOf(const std::vector<BrickPlacement>& bricks, const PhysicsOptions& given,
                 const std::vector<Wall>& walls) {
  const PhysicsOptions options = given.forBricks(bricks.size());
  std::string mjcf =
      "<mujoco>\n<compiler angle=\"radian\"/>\n" + physicsXml(options) + "<worldbody>\n" + groundXml(options);
  for (std::size_t i = 0; i < walls.size(); ++i) mjcf += wallXml(i, walls[i], options);
  for (const BrickPlacement& brick : bricks) mjcf += brickXml(brick, options);
  return compileModel(mjcf + "</worldbody>\n</mujoco>\n");
}

int dofOf(const mjModel& model, const BrickPlacement& brick) {
  return model.body_dofadr[requireId(model, mjOBJ_BODY, brickBodyName(brick.id))];
}

const BrickPlacement& brickOf(const std::vector<BrickPlacement>& bricks, int id) {
  return *std::find_if(bricks.begin(), bricks.end(), [id](const BrickPlacement& brick) { return brick.id == id; });
}

/// Corners of a brick in a heap's frame reach so far along the heap's axes.
Eigen::Vector2d reachOf(const BrickPlacement& brick, const HeapConfig& heap) {
  const Eigen::Rotation2Dd R_heap_map(-heap.yaw_rad);
  const Eigen::Vector2d center = R_heap_map * (brick.T_map_brick.translation().head<2>() - heap.center_m);
  const Eigen::Matrix<double, 2, 3> axes = R_heap_map.toRotationMatrix() * brick.T_map_brick.linear().topRows<2>();
  return center.cwiseAbs() + 0.5 * axes.cwiseAbs() * brick.type.size_m;
}

/// A stack drops by its layers' gaps; what moved farther was hit, or falls.
constexpr double kStackShift_m = 0.05;

/// Shares of what counts as at rest, the larger one.
double unrestOf(const BrickPhysics& physics, int id, const SettleConfig& config) {
  return std::max(physics.speed(id) / config.rest_speed_m_per_s, physics.rate(id) / config.rest_rate_rad_per_s);
}

/// In a jumble a brick may rock or slide on edges for ever: it is dropped on the heap again, some other way round.
void dropRestlessBrick(BrickPhysics& physics, const PileScene& scene, const SettleConfig& config,
                       synthetic_depth::SeededRandom& random) {
  const std::vector<BrickPlacement> bricks = physics.bricks();
  const BrickPlacement* worst = nullptr;
  double top_m = 0.0;
  for (const BrickPlacement& brick : bricks) {
    top_m = std::max(top_m, brick.T_map_brick.translation().z() + 0.5 * brick.type.size_m.norm());
    const bool has_a_place =
        brick.decoy == Decoy::kWedged || brick.decoy == Decoy::kHeavy ||
        std::find(scene.stack_ids.begin(), scene.stack_ids.end(), brick.id) != scene.stack_ids.end();
    if (!has_a_place &&
        (worst == nullptr || unrestOf(physics, brick.id, config) > unrestOf(physics, worst->id, config))) {
      worst = &brick;
    }
  }
  if (worst == nullptr) return;
  Eigen::Isometry3d T_map_brick = worst->T_map_brick;
  T_map_brick.translation().z() = top_m + 0.5 * worst->type.size_m.norm();
  T_map_brick.linear() = anyOrientation(random);
  for (const Wall& wall : scene.walls) {
    if (boxSeparation(T_map_brick, worst->type.size_m, wall.pose(), wall.size_m) < 0.0) {
      T_map_brick.linear() = worst->T_map_brick.linear();  // straight up nothing is in the way
    }
  }
  physics.place(worst->id, T_map_brick);
}

/// Lets the bricks fall until all lie still; false if that takes longer than allowed.
bool waitForRest(BrickPhysics& physics, const PileScene& scene, const SettleConfig& config) {
  constexpr double kLook_s = 0.05;
  synthetic_depth::SeededRandom random(scene.seed, 0, 1);
  double moved_s = 0.0;
  double dropped_s = 0.0;
  while (physics.time() < (scene.has_tipped ? config.max_tipped_time_s : config.max_time_s)) {
    physics.run(kLook_s);
    if (scene.has_tipped && physics.time() - dropped_s > config.patience_s + config.rest_time_s &&
        physics.time() - moved_s < config.rest_time_s) {
      dropRestlessBrick(physics, scene, config, random);
      dropped_s = physics.time();
    }
    if (physics.maxSpeed() > config.rest_speed_m_per_s || physics.maxRate() > config.rest_rate_rad_per_s) {
      moved_s = physics.time();
    } else if (physics.time() - moved_s >= config.rest_time_s) {
      return true;
    }
  }
  return false;
}

}  // namespace

BrickPhysics::BrickPhysics(const std::vector<BrickPlacement>& bricks, const PhysicsOptions& options,
                           const std::vector<Wall>& walls)
    : bricks_(bricks), model_(modelOf(bricks, options, walls)), data_(makeData(*model_)) {
  mj_forward(model_.get(), data_.get());
}

void BrickPhysics::run(double duration_s) {
  const auto steps = static_cast<int>(std::ceil(duration_s / model_->opt.timestep - 1e-9));
  for (int i = 0; i < steps; ++i) {
    mj_step(model_.get(), data_.get());
  }
  for (int w = 0; w < mjNWARNING; ++w) {
    if (data_->warning[w].number > 0) {
      throw std::runtime_error(std::string("bricks: MuJoCo: ") + mju_warningText(w, data_->warning[w].lastinfo));
    }
  }
  mj_kinematics(model_.get(), data_.get());  // poses of the state after the last step
}

std::vector<BrickPlacement> BrickPhysics::bricks() const {
  std::vector<BrickPlacement> now = bricks_;
  for (BrickPlacement& brick : now) {
    brick.T_map_brick = bodyPose(*data_, requireId(*model_, mjOBJ_BODY, brickBodyName(brick.id)));
  }
  return now;
}

double BrickPhysics::speed(int id) const {
  return Eigen::Map<const Eigen::Vector3d>(data_->qvel + dofOf(*model_, brickOf(bricks_, id))).norm();
}

double BrickPhysics::rate(int id) const {
  return Eigen::Map<const Eigen::Vector3d>(data_->qvel + dofOf(*model_, brickOf(bricks_, id)) + 3).norm();
}

void BrickPhysics::place(int id, const Eigen::Isometry3d& T_map_brick) {
  const int body = requireId(*model_, mjOBJ_BODY, brickBodyName(id));
  mjtNum* const qpos = data_->qpos + model_->jnt_qposadr[model_->body_jntadr[body]];
  std::copy_n(T_map_brick.translation().data(), 3, qpos);
  quaternionTo(Eigen::Quaterniond(T_map_brick.linear()).normalized(), qpos + 3);
  std::fill_n(data_->qvel + model_->body_dofadr[body], 6, 0.0);
  mj_forward(model_.get(), data_.get());
}

double BrickPhysics::maxSpeed() const {
  double largest = 0.0;
  for (const BrickPlacement& brick : bricks_) {
    largest = std::max(largest, Eigen::Map<const Eigen::Vector3d>(data_->qvel + dofOf(*model_, brick)).norm());
  }
  return largest;
}

double BrickPhysics::maxRate() const {
  double largest = 0.0;
  for (const BrickPlacement& brick : bricks_) {
    largest = std::max(largest, Eigen::Map<const Eigen::Vector3d>(data_->qvel + dofOf(*model_, brick) + 3).norm());
  }
  return largest;
}

std::vector<std::string> SettleConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("rest_speed_m_per_s", rest_speed_m_per_s, 1e-6, 1.0, "m/s");
  check("rest_rate_rad_per_s", rest_rate_rad_per_s, 1e-6, 10.0, "rad/s");
  check("rest_time_s", rest_time_s, 0.001, 600.0, "s");
  check("max_time_s", max_time_s, rest_time_s, 3600.0, "s");
  check("patience_s", patience_s, 0.1, 3600.0, "s");
  check("max_tipped_time_s", max_tipped_time_s, rest_time_s, 3600.0, "s");
  check("extent_tolerance_m", extent_tolerance_m, 0.0, 10.0, "m");
  check("max_attempts", max_attempts, 1, 100, "");
  std::vector<std::string> problems = check.problems();
  for (const std::string& problem : physics.validate()) problems.push_back("physics/" + problem);
  return problems;
}

std::vector<std::string> faultsOfSettled(const PileScene& scene, const std::vector<BrickPlacement>& settled,
                                         double extent_tolerance_m) {
  std::vector<std::string> faults;
  const auto report = [&faults](const auto&... parts) {
    std::ostringstream line;
    (line << ... << parts);
    faults.push_back(line.str());
  };
  for (const BrickPlacement& dropped : scene.bricks) {
    const Eigen::Vector3d p_map = brickOf(settled, dropped.id).T_map_brick.translation();
    const double shift_m = (p_map - dropped.T_map_brick.translation()).head<2>().norm();
    if (shift_m > scene.max_shift_m) {
      report("brick ", dropped.id, " rolled ", shift_m, " m, must stay within ", scene.max_shift_m,
             " m of its position");
    }
  }
  for (std::size_t h = 0; h < scene.heaps.size(); ++h) {
    const HeapConfig& heap = scene.heaps[h];
    const Eigen::Vector2d allowed_m = (0.5 * heap.extent_m).array() + extent_tolerance_m;
    double needed_m = 0.0;
    double highest_m = 0.0;
    for (const int id : scene.heap_ids[h]) {
      const BrickPlacement& brick = brickOf(settled, id);
      const Eigen::Vector2d reach_m = reachOf(brick, heap);
      if ((reach_m - allowed_m).maxCoeff() > 0.0) {
        report("heaps[", h, "]: brick ", id, " reaches ", reach_m.transpose(), " m from the middle, must be within ",
               allowed_m.transpose(), " m");
      }
      // The centre of a brick in the top layer, but for a quarter of a brick.
      needed_m = (heap.layers - 0.75) * brick.type.size_m.z();
      highest_m = std::max(highest_m, brick.T_map_brick.translation().z());
    }
    if (highest_m < needed_m) {
      report("heaps[", h, "]: the highest brick is at ", highest_m, " m, must be above ", needed_m, " m for ",
             heap.layers, " layers");
    }
  }
  for (const int id : scene.stack_ids) {
    const double shift_m =
        (brickOf(settled, id).T_map_brick.translation() - brickOf(scene.bricks, id).T_map_brick.translation()).norm();
    if (shift_m > kStackShift_m) {
      report("stacks: brick ", id, " is ", shift_m, " m from its position, must be within ", kStackShift_m, " m");
    }
  }
  for (const BrickPlacement& brick : settled) {
    if (brick.decoy == Decoy::kWedged && carriedBy(brick.id, settled, Decoy::kHeavy).empty()) {
      report("decoys/wedged: brick ", brick.id, " lies free, must be under a heavy one");
    }
  }
  return faults;
}

std::uint64_t seedOfAttempt(std::uint64_t seed, int attempt) {
  return attempt == 0 ? seed : synthetic_depth::SeededRandom(seed, static_cast<std::uint64_t>(attempt), 0).next();
}

SettledPile settlePile(const PileSceneConfig& scene_config, std::uint64_t seed, const SettleConfig& config) {
  interactive_mapping::refuseIfAny("SettleConfig:", config.validate());
  SettledPile pile;
  for (int attempt = 0; attempt < config.max_attempts; ++attempt) {
    pile.attempts = attempt + 1;
    pile.scene = generateScene(scene_config, seedOfAttempt(seed, attempt));
    BrickPhysics physics(pile.scene.bricks, config.physics, pile.scene.walls);
    std::vector<std::string> faults;
    if (!waitForRest(physics, pile.scene, config)) {
      faults.push_back("not at rest after " + std::to_string(physics.time()) + " s: " +
                       std::to_string(physics.maxSpeed()) + " m/s, " + std::to_string(physics.maxRate()) + " rad/s");
    }
    const std::vector<BrickPlacement> settled = physics.bricks();
    for (const std::string& fault : faultsOfSettled(pile.scene, settled, config.extent_tolerance_m)) {
      faults.push_back(fault);
    }
    PileScene at_rest = pile.scene;
    at_rest.bricks = settled;
    for (const std::string& fault : faultsOfStart(at_rest, scene_config.min_robot_distance_m)) faults.push_back(fault);
    if (faults.empty()) {
      pile.scene = at_rest;
      pile.settle_time_s = physics.time();
      return pile;
    }
    for (const std::string& fault : faults) {
      pile.refusals.push_back("attempt " + std::to_string(attempt) + ": " + fault);
    }
  }
  std::string message = "scene " + scene_config.name + ", seed " + std::to_string(seed) + ", does not settle:";
  for (const std::string& refusal : pile.refusals) message += "\n  " + refusal;
  throw std::runtime_error(message);
}

}  // namespace simulated_world
