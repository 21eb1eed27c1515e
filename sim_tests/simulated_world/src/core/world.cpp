// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/world.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>
#include <tuple>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/formatted.h>

#include "simulated_world/field_section.h"
#include "simulated_world/world_observation.h"
#include "world_mjcf.h"

namespace simulated_world {

namespace {

// Taken-away bricks and obstacles that are not there wait high up: out of sight of camera and scanner, touching nothing.
const Eigen::Vector3d kStoreroom(0.0, 0.0, 1000.0);
// An overload shorter than this is one of the solver's spikes at a contact's first steps, not a force.
constexpr double kOverloadTime_s = 0.01;
constexpr double kTraction_Nm = 300.0;  // what the tyres take about the vertical before they slide
constexpr double kRestSpeed_m_s = 0.03;
constexpr double kRestSpeed_rad_s = 0.3;
// Of things put somewhere by hand: so much deeper than bricks at rest sink into each other is inside.
constexpr double kInside_m = 0.005;
constexpr double kFarthest_m = 100.0;

int jointId(const mjModel& model, const std::string& name, mjtJoint type) {
  const int joint = requireId(model, mjOBJ_JOINT, name);
  if (model.jnt_type[joint] != type) {
    throw std::invalid_argument("joint \"" + name + "\" of the robot model is of another type than expected");
  }
  return joint;
}

std::string nameOf(const mjModel& model, mjtObj type, int id) {
  const char* name = mj_id2name(&model, type, id);
  return name != nullptr ? name : "";
}

// Of two boxes MuJoCo tells half of the depth, of a box and a cylinder or a plane all of it.
bool isInside(const mjModel& model, const mjContact& contact) {
  const bool are_boxes = model.geom_type[contact.geom1] == mjGEOM_BOX && model.geom_type[contact.geom2] == mjGEOM_BOX;
  return contact.dist <= -kInside_m * (are_boxes ? 0.5 : 1.0);
}

// Entry (row, column) of the joint space inertia. MuJoCo stores, for every degree of freedom, the entries along the
// path to the root.
double inertiaEntry(const mjModel& model, const mjData& data, int row, int column) {
  if (row < column) {
    std::swap(row, column);
  }
  int address = model.dof_Madr[row];
  for (int dof = row; dof >= 0; dof = model.dof_parentid[dof], ++address) {
    if (dof == column) {
      return data.qM[address];
    }
  }
  return 0.0;
}

mjtByte& weldIsActive(mjModel& model, mjData& data, int weld) {
#if mjVERSION_HEADER >= 300
  (void)model;
  return data.eq_active[weld];
#else
  (void)data;
  return model.eq_active[weld];
#endif
}

std::uint64_t hashBytes(std::uint64_t hash, const void* bytes, std::size_t count) {  // FNV-1a
  const auto* byte = static_cast<const unsigned char*>(bytes);
  for (std::size_t i = 0; i < count; ++i) {
    hash = (hash ^ byte[i]) * 0x100000001B3ULL;
  }
  return hash;
}

std::vector<std::string> brickProblems(const std::vector<WorldBrick>& bricks) {
  std::vector<std::string> problems;
  std::set<int> ids;
  for (const WorldBrick& brick : bricks) {
    const BrickPlacement& placement = brick.placement;
    const std::string name = "brick " + std::to_string(placement.id);
    if (placement.id < 0 || !ids.insert(placement.id).second) {
      problems.push_back(name + ": ids must be unique and not negative");
    }
    const Eigen::Vector3d& size_m = placement.type.size_m;
    if (!size_m.allFinite() || size_m.minCoeff() < 0.01 || size_m.maxCoeff() > 5.0) {
      problems.push_back(name + ": size must be in [0.01, 5] m");
    }
    if (!(placement.type.mass_kg > 0.0 && placement.type.mass_kg <= 1000.0)) {
      problems.push_back(name + ": mass must be in (0, 1000] kg");
    }
    if (!(placement.type.friction > 0.0 && placement.type.friction <= 5.0)) {
      problems.push_back(name + ": friction must be in (0, 5]");
    }
    if (!placement.T_map_brick.matrix().allFinite()) {
      problems.push_back(name + ": pose is not finite");
    }
  }
  return problems;
}

/// On the magnet.
struct Load {
  const char* name;
  double value;
  double held;  // as much, and no more
  const char* unit;

  std::string describe() const {
    return interactive_mapping::formatted("%s of %.2f %s, held are %.2f %s", name, value, unit, std::max(0.0, held),
                                          unit);
  }
};

}  // namespace

void WorldConfig::physicsFields(WorldConfig& c, interactive_mapping::Fields& f) {
  // Above 4 ms the arm's servo (80 rad/s) and contacts of a kilogram are no longer stable; MuJoCo does not keep a contact
  // stiffer than two steps.
  f("timestep_s", c.physics.timestep_s, 1e-4, std::min(0.004, 0.5 * c.physics.contact_time_constant_s), "s",
    "step of the dynamics; at most half of the contacts' time constant");
  fieldSection(f, "sleep", [&] {
    f("enabled", c.has_sleep, "true: bricks at rest leave the dynamics until something touches them");
    BrickSleepConfig::fields(c.sleep, f);
  });
}

void WorldConfig::armFields(WorldConfig& c, interactive_mapping::Fields& f) {
  f("bandwidth_rad_s", c.servo.arm_bandwidth_rad_s, 1.0, 0.25 / c.physics.timestep_s, "rad/s",
    "bandwidth of the joints' servos, critically damped; at most 0.25 / physics/timestep_s");
}

void WorldConfig::baseFields(WorldConfig& c, interactive_mapping::Fields& f) {
  f("bandwidth_rad_s", c.servo.base_bandwidth_rad_s, 1.0, 0.25 / c.physics.timestep_s, "rad/s",
    "bandwidth of the base's servo; at most 0.25 / physics/timestep_s");
  f("traction_N", c.servo.traction_N, 1.0, 1e5, "N", "force at which the tyres slide");
}

std::vector<std::string> WorldConfig::validate() const {
  WorldConfig copy = *this;
  interactive_mapping::FieldChecker check;
  fieldSection(check, "physics", [&] { physicsFields(copy, check); });
  check.section("magnet", copy.magnet);
  fieldSection(check, "arm", [&] { armFields(copy, check); });
  fieldSection(check, "base", [&] { baseFields(copy, check); });
  interactive_mapping::RangeCheck fixed("servo/");
  fixed("arm_effort_Nm (least)", servo.arm_effort_Nm.minCoeff(), 0.1, 1e4, "N m");
  fixed("max_slide_m", servo.max_slide_m, 1e-4, 1.0, "m");
  fixed("max_slide_rad", servo.max_slide_rad, 1e-4, 1.0, "rad");
  std::vector<std::string> problems = check.problems;
  problems.insert(problems.end(), fixed.problems().begin(), fixed.problems().end());
  return problems;
}

World::World(const std::string& robot_mjcf, const std::string& assets_mjcf, const std::vector<WorldBrick>& bricks,
             const Pose2d& robot_start, const ArmVector& arm_start_rad, const WorldConfig& config,
             const std::vector<Wall>& walls)
    : config_(config) {
  interactive_mapping::refuseIfAny("world:", config.validate());
  interactive_mapping::refuseIfAny("world:", brickProblems(bricks));
  model_ = compileModel(worldMjcf(robot_mjcf, assets_mjcf, bricks, walls, config));
  data_ = makeData(*model_);

  findRobot();
  findBricks(bricks);
  findObstacles();
  findContainer();
  standAt(robot_start, arm_start_rad);
  for (ObstacleSlot& slot : obstacles_) placeObstacle(slot, false, kStoreroom);
  mj_forward(model_.get(), data_.get());
  weighTool();
}

void World::findRobot() {
  const int base = requireId(*model_, mjOBJ_BODY, "base_link");
  magnet_body_ = requireId(*model_, mjOBJ_BODY, "magnet");
  tip_site_ = requireId(*model_, mjOBJ_SITE, "magnet_tip");
  wrist_site_ = requireId(*model_, mjOBJ_SITE, "wrist_ft");
  force_sensor_ = model_->sensor_adr[requireId(*model_, mjOBJ_SENSOR, "wrist_force")];
  torque_sensor_ = model_->sensor_adr[requireId(*model_, mjOBJ_SENSOR, "wrist_torque")];
  const std::array<const char*, 3> base_joints{{"base_x", "base_y", "base_yaw"}};
  for (int i = 0; i < 3; ++i) {
    const int joint = jointId(*model_, base_joints[i], i < 2 ? mjJNT_SLIDE : mjJNT_HINGE);
    base_qpos_[i] = model_->jnt_qposadr[joint];
    base_dof_[i] = model_->jnt_dofadr[joint];
  }
  for (int i = 0; i < kNumArmJoints; ++i) {
    const int joint = jointId(*model_, kArmJoints[i], mjJNT_HINGE);
    arm_qpos_[i] = model_->jnt_qposadr[joint];
    arm_dof_[i] = model_->jnt_dofadr[joint];
  }
  const std::array<const char*, 2> wheels{{"wheel_front_left_joint", "wheel_front_right_joint"}};
  for (int i = 0; i < 2; ++i) {
    const int joint = mj_name2id(model_.get(), mjOBJ_JOINT, wheels[i]);
    if (joint >= 0) {
      wheel_qpos_[i] = model_->jnt_qposadr[joint];
      wheel_dof_[i] = model_->jnt_dofadr[joint];
    }
  }
  is_robot_geom_.assign(model_->ngeom, 0);
  is_magnet_geom_.assign(model_->ngeom, 0);
  for (int geom = 0; geom < model_->ngeom; ++geom) {
    for (int body = model_->geom_bodyid[geom]; body > 0; body = model_->body_parentid[body]) {
      is_robot_geom_[geom] |= body == base;
      is_magnet_geom_[geom] |= body == magnet_body_;
    }
  }
}

void World::findBricks(const std::vector<WorldBrick>& bricks) {
  slot_of_geom_.assign(model_->ngeom, -1);
  for (const WorldBrick& brick : bricks) {
    BrickSlot slot{};
    slot.brick = brick;
    const std::string name = brickBodyName(brick.placement.id);
    slot.body = requireId(*model_, mjOBJ_BODY, name);
    slot.geom = requireId(*model_, mjOBJ_GEOM, name);
    slot.qpos = model_->jnt_qposadr[model_->body_jntadr[slot.body]];
    slot.dof = model_->jnt_dofadr[model_->body_jntadr[slot.body]];
    slots_.push_back(slot);
  }
  std::sort(slots_.begin(), slots_.end(),
            [](const BrickSlot& a, const BrickSlot& b) { return a.brick.placement.id < b.brick.placement.id; });
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    slot_of_geom_[slots_[i].geom] = static_cast<int>(i);
  }
  if (config_.has_sleep && !slots_.empty()) {
    std::vector<int> ids;
    for (const BrickSlot& slot : slots_) {
      ids.push_back(slot.brick.placement.id);
    }
    sleep_ = std::make_unique<BrickSleep>(*model_, ids, config_.sleep);
  }
  weld_ = slots_.empty() ? -1 : requireId(*model_, mjOBJ_EQUALITY, "magnet_hold");
}

void World::findObstacles() {
  for (int i = 0; i < kMaxObstacles; ++i) {
    ObstacleSlot slot{};
    slot.geom = requireId(*model_, mjOBJ_GEOM, obstacleBodyName(i));
    slot.mocap = model_->body_mocapid[requireId(*model_, mjOBJ_BODY, obstacleBodyName(i))];
    obstacles_.push_back(slot);
  }
}

void World::findContainer() {
  container_body_ = mj_name2id(model_.get(), mjOBJ_BODY, "container");
  // Its walls are its extent.
  for (int geom = 0; geom < model_->ngeom; ++geom) {
    if (container_body_ < 0 || model_->geom_bodyid[geom] != container_body_ || model_->geom_contype[geom] == 0) {
      continue;
    }
    const Eigen::Map<const Eigen::Vector3d> centre(model_->geom_pos + 3 * geom);
    const Eigen::Matrix3d R = quaternionFrom(model_->geom_quat + 4 * geom).toRotationMatrix();
    const Eigen::Vector3d reach = R.cwiseAbs() * Eigen::Map<const Eigen::Vector3d>(model_->geom_size + 3 * geom);
    container_inside_.extend(centre + reach);
    container_inside_.extend(centre - reach);
  }
}

void World::standAt(const Pose2d& robot_start, const ArmVector& arm_start_rad) {
  data_->qpos[base_qpos_[0]] = robot_start.x_m;
  data_->qpos[base_qpos_[1]] = robot_start.y_m;
  data_->qpos[base_qpos_[2]] = robot_start.yaw_rad;
  for (int i = 0; i < kNumArmJoints; ++i) {
    data_->qpos[arm_qpos_[i]] = arm_start_rad[i];
  }
  base_reference_ = robot_start;
  arm_reference_ = arm_start_rad;
}

void World::weighTool() {
  const int tool = model_->site_bodyid[wrist_site_];
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (int body = tool; body < model_->nbody; ++body) {
    bool is_tool = false;
    for (int ancestor = body; ancestor > 0; ancestor = model_->body_parentid[ancestor]) {
      is_tool |= ancestor == tool;
    }
    if (is_tool) {
      tool_mass_kg_ += model_->body_mass[body];
      moment += model_->body_mass[body] * Eigen::Map<const Eigen::Vector3d>(data_->xipos + 3 * body);
    }
  }
  if (tool_mass_kg_ > 0.0) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data_->site_xmat + 9 * wrist_site_);
    tool_centre_m_ = R.transpose() *
                     (moment / tool_mass_kg_ - Eigen::Map<const Eigen::Vector3d>(data_->site_xpos + 3 * wrist_site_));
  }
}

void World::setArmReference(const ArmVector& position_rad, const ArmVector& velocity_rad_s,
                            const ArmVector& acceleration_rad_s2) {
  arm_reference_acceleration_ = acceleration_rad_s2;
  arm_reference_ = position_rad;
  arm_reference_velocity_ = velocity_rad_s;
}

void World::setWheelAngles(double left_rad, double right_rad) {
  const std::array<double, 2> angles{{left_rad, right_rad}};
  for (int i = 0; i < 2; ++i) {
    if (wheel_qpos_[i] >= 0) {
      data_->qpos[wheel_qpos_[i]] = angles[i];
      data_->qvel[wheel_dof_[i]] = 0.0;
    }
  }
}

void World::setMagnet(bool is_on) {
  if (!is_on) {
    is_magnet_spent_ = false;
    if (held_ >= 0) {
      letGo(ReleaseReason::kSwitchedOff);
    }
  }
  is_magnet_on_ = is_on;
}

void World::setPayload(double mass_kg, const Eigen::Vector3d& centre_m) {
  payload_kg_ = mass_kg;
  payload_centre_m_ = centre_m;
}

void World::step() {
  mjModel* model = model_.get();
  mjData* data = data_.get();
  mj_step1(model, data);
  commandBase();
  commandArm();
  mj_step2(model, data);
  keepStoredBricks();
  updateMagnet();
  collectTouches();
  if (sleep_) {
    sleep_->update(*model_, *data_);
  }
  for (const mjtWarning warning : {mjWARN_CONTACTFULL, mjWARN_CNSTRFULL}) {
    if (data->warning[warning].number > 0) {
      throw std::runtime_error(std::string("the simulated world is too crowded at ") + std::to_string(data->time) +
                               " s: " + mju_warningText(warning, data->warning[warning].lastinfo));
    }
  }
  for (int i = 0; i < model->nq; ++i) {
    if (!std::isfinite(data->qpos[i])) {
      throw std::runtime_error("the simulated world diverged at " + std::to_string(data->time) + " s: joint " +
                               nameOf(*model, mjOBJ_JOINT, std::min(i, model->njnt - 1)) + " is not finite");
    }
  }
}

void World::refreshPoses() {
  mj_kinematics(model_.get(), data_.get());
  mj_comPos(model_.get(), data_.get());
  mj_camlight(model_.get(), data_.get());
}

void World::takePosesFrom(const World& other) {
  if (other.model_->nq != model_->nq || other.model_->nmocap != model_->nmocap) {
    throw std::invalid_argument("world: " + std::to_string(other.model_->nq) + " coordinates and " +
                                std::to_string(other.model_->nmocap) + " obstacles, must be " +
                                std::to_string(model_->nq) + " and " + std::to_string(model_->nmocap));
  }
  std::copy_n(other.data_->qpos, model_->nq, data_->qpos);
  std::copy_n(other.data_->mocap_pos, 3 * model_->nmocap, data_->mocap_pos);
  std::copy_n(other.data_->mocap_quat, 4 * model_->nmocap, data_->mocap_quat);
  refreshPoses();
}

void World::commandBase() {
  mjData* data = data_.get();
  const double dt = config_.physics.timestep_s;
  base_reference_ = moveAlongArc(base_reference_, base_twist_, dt);
  const Eigen::Vector3d position(data->qpos[base_qpos_[0]], data->qpos[base_qpos_[1]], data->qpos[base_qpos_[2]]);
  const Eigen::Vector3d velocity(data->qvel[base_dof_[0]], data->qvel[base_dof_[1]], data->qvel[base_dof_[2]]);

  // Tyres slide rather than stretch.
  Eigen::Vector2d slide(base_reference_.x_m - position.x(), base_reference_.y_m - position.y());
  if (slide.norm() > config_.servo.max_slide_m) {
    slide *= config_.servo.max_slide_m / slide.norm();
    base_reference_.x_m = position.x() + slide.x();
    base_reference_.y_m = position.y() + slide.y();
  }
  base_reference_.yaw_rad = position.z() + std::clamp(base_reference_.yaw_rad - position.z(),
                                                      -config_.servo.max_slide_rad, config_.servo.max_slide_rad);

  const double c = std::cos(base_reference_.yaw_rad);
  const double s = std::sin(base_reference_.yaw_rad);
  const Eigen::Vector3d target_velocity(c * base_twist_.linear_m_s, s * base_twist_.linear_m_s,
                                        base_twist_.angular_rad_s);
  const double along = (base_twist_.linear_m_s - previous_base_twist_.linear_m_s) / dt;
  const double centripetal = base_twist_.linear_m_s * base_twist_.angular_rad_s;
  const Eigen::Vector3d target_acceleration(c * along - s * centripetal, s * along + c * centripetal,
                                            (base_twist_.angular_rad_s - previous_base_twist_.angular_rad_s) / dt);
  previous_base_twist_ = base_twist_;

  const double w = config_.servo.base_bandwidth_rad_s;
  const Eigen::Vector3d target(base_reference_.x_m, base_reference_.y_m, base_reference_.yaw_rad);
  const Eigen::Vector3d acceleration =
      target_acceleration + w * w * (target - position) + 2.0 * w * (target_velocity - velocity);
  Eigen::Vector3d force;
  for (int i = 0; i < 3; ++i) {
    force[i] = data->qfrc_bias[base_dof_[i]];
    for (int j = 0; j < 3; ++j) {
      force[i] += inertiaEntry(*model_, *data, base_dof_[i], base_dof_[j]) * acceleration[j];
    }
  }
  const double pull = force.head<2>().norm();
  if (pull > config_.servo.traction_N) {
    force.head<2>() *= config_.servo.traction_N / pull;
  }
  force.z() = std::clamp(force.z(), -kTraction_Nm, kTraction_Nm);
  for (int i = 0; i < 3; ++i) {
    data->qfrc_applied[base_dof_[i]] = force[i];
  }
}

// Computed torque: tau = M (qdd_ref + w^2 e + 2 w de) + h, with the weight of the declared payload, within the joints'
// limits.
void World::commandArm() {
  mjData* data = data_.get();
  const double w = config_.servo.arm_bandwidth_rad_s;
  const ArmVector acceleration = arm_reference_acceleration_ + w * w * (arm_reference_ - armPosition()) +
                                 2.0 * w * (arm_reference_velocity_ - armVelocity());
  ArmVector torque;
  for (int i = 0; i < kNumArmJoints; ++i) {
    torque[i] = data->qfrc_bias[arm_dof_[i]];
    for (int j = 0; j < kNumArmJoints; ++j) {
      torque[i] += inertiaEntry(*model_, *data, arm_dof_[i], arm_dof_[j]) * acceleration[j];
    }
  }
  if (payload_kg_ != 0.0) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data->site_xmat + 9 * wrist_site_);
    const Eigen::Vector3d point =
        Eigen::Map<const Eigen::Vector3d>(data->site_xpos + 3 * wrist_site_) + R * payload_centre_m_;
    const Eigen::Vector3d weight = payload_kg_ * Eigen::Map<const Eigen::Vector3d>(model_->opt.gravity);
    for (int i = 0; i < kNumArmJoints; ++i) {
      const int joint = model_->dof_jntid[arm_dof_[i]];
      const Eigen::Map<const Eigen::Vector3d> axis(data->xaxis + 3 * joint);
      const Eigen::Map<const Eigen::Vector3d> anchor(data->xanchor + 3 * joint);
      torque[i] -= axis.dot((point - anchor).cross(weight));
    }
  }
  arm_torque_ = torque.cwiseMin(config_.servo.arm_effort_Nm).cwiseMax(-config_.servo.arm_effort_Nm);
  for (int i = 0; i < kNumArmJoints; ++i) {
    data->qfrc_applied[arm_dof_[i]] = arm_torque_[i];
  }
}

// 0 ... 1: how much of the magnet's force acts on this brick where it is now.
double World::holdFactor(const BrickSlot& slot) const {
  const mjData* data = data_.get();
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R_tip(data->site_xmat + 9 * tip_site_);
  const Eigen::Map<const Eigen::Vector3d> tip(data->site_xpos + 3 * tip_site_);
  const Eigen::Isometry3d T_brick_map = bodyPose(*data, slot.body).inverse();
  const Eigen::Vector3d axis = T_brick_map.linear() * R_tip.col(2);
  int face = 0;
  axis.cwiseAbs().maxCoeff(&face);
  const double tilt = std::acos(std::min(1.0, std::abs(axis[face])));
  // The tool's axis points into the brick: against the normal of the face that it touches.
  const bool has_plate = slot.brick.has_plate[static_cast<std::size_t>(2 * face + (axis[face] > 0.0 ? 1 : 0))];
  if (!has_plate || tilt >= config_.magnet.max_tilt_rad) {
    return 0.0;
  }
  const auto on_plate = [&slot, face](const Eigen::Vector3d& point) {
    for (int k = 0; k < 3; ++k) {
      if (k != face && std::abs(point[k]) > 0.5 * slot.brick.plate_edge_m) {
        return false;
      }
    }
    return true;
  };
  if (!on_plate(T_brick_map * tip)) {
    return 0.0;
  }
  for (int i = 0; i < data->ncon; ++i) {
    const mjContact& contact = data->contact[i];
    const bool joins = (is_magnet_geom_[contact.geom1] != 0 && contact.geom2 == slot.geom) ||
                       (is_magnet_geom_[contact.geom2] != 0 && contact.geom1 == slot.geom);
    if (!joins) {
      continue;
    }
    // The tool's flank beside the face does not hold: the point must be near the tip's plane.
    const Eigen::Vector3d point = Eigen::Map<const Eigen::Vector3d>(contact.pos);
    const double behind_tip = R_tip.col(2).dot(tip - point);
    if (std::abs(behind_tip) < 0.004 && on_plate(T_brick_map * point)) {
      const double share = tilt / config_.magnet.max_tilt_rad;
      return 1.0 - share * share;
    }
  }
  return 0.0;
}

void World::setWeld(bool is_active) {
  mjModel* model = model_.get();
  weldIsActive(*model, *data_, weld_) = is_active ? 1 : 0;
  if (!is_active) {
    return;
  }
  const BrickSlot& slot = slots_[static_cast<std::size_t>(held_)];
  const Eigen::Isometry3d T_magnet_brick = bodyPose(*data_, magnet_body_).inverse() * bodyPose(*data_, slot.body);
  model->eq_obj2id[weld_] = slot.body;
  // Layout of a weld: anchor (3), position (3) and orientation (4) of the second body in the first, torque scale.
  mjtNum* values = model->eq_data + static_cast<std::ptrdiff_t>(mjNEQDATA) * weld_;
  std::fill_n(values, 3, 0.0);
  std::copy_n(T_magnet_brick.translation().data(), 3, values + 3);
  quaternionTo(Eigen::Quaterniond(T_magnet_brick.linear()), values + 6);
}

void World::letGo(ReleaseReason reason, const std::string& load) {
  release_ = Release{slots_[static_cast<std::size_t>(held_)].brick.placement.id, reason, load};
  setWeld(false);
  held_ = -1;
  overload_steps_ = 0;
}

void World::toolOnBrick(const BrickSlot& slot, Eigen::Vector3d& force, Eigen::Vector3d& moment) const {
  const mjData* data = data_.get();
  // Generalised force of the weld on the brick's free joint: a force along the map's axes, a moment along the brick's.
  Eigen::Matrix<double, 6, 1> weld = Eigen::Matrix<double, 6, 1>::Zero();
  const bool is_sparse = mj_isSparse(model_.get()) != 0;
  for (int row = 0; row < data->nefc; ++row) {
    if (data->efc_type[row] != mjCNSTR_EQUALITY || data->efc_id[row] != weld_) {
      continue;
    }
    if (is_sparse) {
      for (int k = 0; k < data->efc_J_rownnz[row]; ++k) {
        const int address = data->efc_J_rowadr[row] + k;
        const int dof = data->efc_J_colind[address] - slot.dof;
        if (dof >= 0 && dof < 6) {
          weld[dof] += data->efc_J[address] * data->efc_force[row];
        }
      }
    } else {
      for (int dof = 0; dof < 6; ++dof) {
        weld[dof] += data->efc_J[row * model_->nv + slot.dof + dof] * data->efc_force[row];
      }
    }
  }
  const Eigen::Isometry3d T_map_brick = bodyPose(*data, slot.body);
  const Eigen::Map<const Eigen::Vector3d> tip(data->site_xpos + 3 * tip_site_);
  force = weld.head<3>();
  moment = T_map_brick.linear() * weld.tail<3>() + (T_map_brick.translation() - tip).cross(force);
  // The tool also pushes: what the weld pulls against its own contact is no load on the magnet.
  for (int i = 0; i < data->ncon; ++i) {
    const mjContact& contact = data->contact[i];
    const bool is_second = contact.geom2 == slot.geom && is_magnet_geom_[contact.geom1] != 0;
    const bool is_first = contact.geom1 == slot.geom && is_magnet_geom_[contact.geom2] != 0;
    if (!is_first && !is_second) {
      continue;
    }
    mjtNum in_contact_frame[6];
    mj_contactForce(model_.get(), data, i, in_contact_frame);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> axes(contact.frame);
    const double sign = is_second ? 1.0 : -1.0;
    const Eigen::Vector3d push = sign * (axes.transpose() * Eigen::Map<const Eigen::Vector3d>(in_contact_frame));
    const Eigen::Vector3d twist = sign * (axes.transpose() * Eigen::Map<const Eigen::Vector3d>(in_contact_frame + 3));
    force += push;
    moment += twist + (Eigen::Map<const Eigen::Vector3d>(contact.pos) - tip).cross(push);
  }
}

void World::updateMagnet() {
  if (held_ >= 0) {
    const BrickSlot& slot = slots_[static_cast<std::size_t>(held_)];
    Eigen::Vector3d force;
    Eigen::Vector3d moment;
    toolOnBrick(slot, force, moment);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R_tip(data_->site_xmat + 9 * tip_site_);
    const Eigen::Vector3d axis = R_tip.col(2);
    const MagnetConfig& magnet = config_.magnet;
    // Disc on plate: pull left over after the load carries shear and twist by friction and tilting over the rim.
    const double pull_N = magnet.holding_force_N * magnet_strength_ * hold_factor_ + axis.dot(force);
    const double shear_N = (force - axis.dot(force) * axis).norm();
    const double tilt_Nm = (moment - axis.dot(moment) * axis).norm();
    const double twist_Nm = std::abs(axis.dot(moment));
    const std::array<Load, 4> loads{
        {{"pull", -axis.dot(force), magnet.holding_force_N * magnet_strength_ * hold_factor_, "N"},
         {"shear", shear_N, magnet.friction * pull_N, "N"},
         {"tilting moment", tilt_Nm, magnet.radius_m * pull_N, "Nm"},
         {"twisting moment", twist_Nm, 2.0 / 3.0 * magnet.friction * magnet.radius_m * pull_N, "Nm"}}};
    const auto over = std::find_if(loads.begin(), loads.end(), [](const Load& load) { return load.value > load.held; });
    overload_steps_ = over != loads.end() ? overload_steps_ + 1 : 0;
    if (overload_steps_ * config_.physics.timestep_s > kOverloadTime_s) {
      letGo(ReleaseReason::kPulledOff, over->describe());
      is_magnet_spent_ = true;
    }
    return;
  }
  if (!is_magnet_on_ || is_magnet_spent_) {
    return;
  }
  double best = 0.0;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const double factor = slots_[i].is_present ? holdFactor(slots_[i]) : 0.0;
    if (factor > best) {
      best = factor;
      held_ = static_cast<int>(i);
    }
  }
  if (held_ >= 0) {
    hold_factor_ = best;
    setWeld(true);
  }
}

void World::keepStoredBricks() {
  for (const BrickSlot& slot : slots_) {
    if (!slot.is_present) {
      std::copy_n(kStoreroom.data(), 3, data_->qpos + slot.qpos);
      std::fill_n(data_->qvel + slot.dof, 6, 0.0);
    }
  }
}

int World::numAwake() const {
  return static_cast<int>(std::count_if(slots_.begin(), slots_.end(), [this](const BrickSlot& slot) {
    return slot.is_present && (!sleep_ || !sleep_->isAsleep(slot.brick.placement.id));
  }));
}

int World::numContacts() const {
  return data_->ncon;
}

bool World::dropHeldBrick() {
  if (held_ < 0) {
    return false;
  }
  letGo(ReleaseReason::kFault);
  is_magnet_spent_ = true;
  return true;
}

void World::collectTouches() {
  const mjData* data = data_.get();
  const int held_geom = held_ >= 0 ? slots_[static_cast<std::size_t>(held_)].geom : -1;
  Eigen::Vector3d on_tool = Eigen::Vector3d::Zero();
  for (int i = 0; i < data->ncon; ++i) {
    const mjContact& contact = data->contact[i];
    const bool is_of_robot = is_robot_geom_[contact.geom1] != 0 || is_robot_geom_[contact.geom2] != 0;
    const bool first = is_robot_geom_[contact.geom1] != 0 || (!is_of_robot && contact.geom1 == held_geom);
    if ((!first && !is_of_robot && contact.geom2 != held_geom) || contact.efc_address < 0) {
      continue;
    }
    mjtNum force[6];
    mj_contactForce(model_.get(), data, i, force);
    if (force[0] <= 0.0) {
      continue;  // within the margin, or about to part
    }
    const int robot_geom = first ? contact.geom1 : contact.geom2;
    const int other_geom = first ? contact.geom2 : contact.geom1;
    if (is_magnet_geom_[robot_geom] != 0 && other_geom != held_geom) {
      const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> axes(contact.frame);
      on_tool += (first ? -1.0 : 1.0) * (axes.transpose() * Eigen::Map<const Eigen::Vector3d>(force));
    }
    RobotTouch touch;
    touch.robot_body = nameOf(*model_, mjOBJ_BODY, model_->geom_bodyid[robot_geom]);
    if (!is_of_robot) touch.load_id = slots_[static_cast<std::size_t>(held_)].brick.placement.id;
    const int slot = slot_of_geom_[other_geom];
    touch.brick_id = slot >= 0 ? slots_[static_cast<std::size_t>(slot)].brick.placement.id : -1;
    touch.other_body = slot >= 0 ? brickBodyName(touch.brick_id)
                       : model_->geom_bodyid[other_geom] == 0
                           ? nameOf(*model_, mjOBJ_GEOM, other_geom)
                           : nameOf(*model_, mjOBJ_BODY, model_->geom_bodyid[other_geom]);
    touch.force_N = Eigen::Map<const Eigen::Vector3d>(force).norm();
    touch.p_map = Eigen::Map<const Eigen::Vector3d>(contact.pos);
    const auto known = std::find_if(touches_.begin(), touches_.end(), [&touch](const RobotTouch& other) {
      return other.robot_body == touch.robot_body && other.other_body == touch.other_body;
    });
    if (known == touches_.end()) {
      touches_.push_back(touch);
    } else if (touch.force_N > known->force_N) {
      *known = touch;
    }
  }
  tool_push_N_ = on_tool.norm();
}

std::vector<RobotTouch> World::takeTouches() {
  std::vector<RobotTouch> taken;
  taken.swap(touches_);
  std::sort(taken.begin(), taken.end(), [](const RobotTouch& a, const RobotTouch& b) {
    return std::tie(a.robot_body, a.other_body) < std::tie(b.robot_body, b.other_body);
  });
  return taken;
}

std::optional<World::Release> World::takeRelease() {
  std::optional<Release> taken;
  taken.swap(release_);
  return taken;
}

ArmVector World::armPosition() const {
  ArmVector position;
  for (int i = 0; i < kNumArmJoints; ++i) {
    position[i] = data_->qpos[arm_qpos_[i]];
  }
  return position;
}

ArmVector World::armPush() const {
  ArmVector push;
  for (int i = 0; i < kNumArmJoints; ++i) {
    push[i] = data_->qfrc_constraint[arm_dof_[i]];
  }
  return push;
}

ArmVector World::armVelocity() const {
  ArmVector velocity;
  for (int i = 0; i < kNumArmJoints; ++i) {
    velocity[i] = data_->qvel[arm_dof_[i]];
  }
  return velocity;
}

ToolWrench World::toolWrench() const {
  // MuJoCo's sensor gives what the wrist exerts on the tool. Standing still, surroundings + wrist + weight = 0.
  const Eigen::Map<const Eigen::Vector3d> force(data_->sensordata + force_sensor_);
  const Eigen::Map<const Eigen::Vector3d> torque(data_->sensordata + torque_sensor_);
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data_->site_xmat + 9 * wrist_site_);
  const Eigen::Vector3d gravity = R.transpose() * Eigen::Map<const Eigen::Vector3d>(model_->opt.gravity);
  ToolWrench wrench;
  wrench.force_N = -force - (tool_mass_kg_ + payload_kg_) * gravity;
  wrench.torque_Nm = -torque - (tool_mass_kg_ * tool_centre_m_ + payload_kg_ * payload_centre_m_).cross(gravity);
  return wrench;
}

Pose2d World::basePose() const {
  return {data_->qpos[base_qpos_[0]], data_->qpos[base_qpos_[1]], data_->qpos[base_qpos_[2]]};
}

Twist2d World::baseTwist() const {
  const double yaw = data_->qpos[base_qpos_[2]];
  return {std::cos(yaw) * data_->qvel[base_dof_[0]] + std::sin(yaw) * data_->qvel[base_dof_[1]],
          data_->qvel[base_dof_[2]]};
}

Eigen::Isometry3d World::linkPose(const std::string& link) const {
  return bodyPose(*data_, requireId(*model_, mjOBJ_BODY, link));
}

std::vector<BrickMotion> World::bricks() const {
  std::vector<BrickMotion> result;
  for (const BrickSlot& slot : slots_) {
    if (slot.is_present) {
      result.push_back({slot.brick.placement.id, bodyPose(*data_, slot.body),
                        Eigen::Map<const Eigen::Vector3d>(data_->qvel + slot.dof)});
    }
  }
  return result;
}

std::optional<BrickMotion> World::brick(int id) const {
  for (const BrickMotion& motion : bricks()) {
    if (motion.id == id) {
      return motion;
    }
  }
  return std::nullopt;
}

std::optional<int> World::heldBrick() const {
  return held_ < 0 ? std::nullopt : std::optional<int>(slots_[static_cast<std::size_t>(held_)].brick.placement.id);
}

std::vector<World::StowedBrick> World::bricksInContainer() const {
  constexpr double kOverRim_m = 0.5;  // a brick that is let go hangs lower
  constexpr double kSeated_m = 0.03;  // of the lowest corner over the floor's underside; the floor has 1 cm
  constexpr double kSeated_cosine =
      0.99;  // of an upright edge: 8 degrees, less than a brick leans that lies on another
  std::vector<StowedBrick> result;
  if (container_body_ < 0) {
    return result;
  }
  const Eigen::Isometry3d T_container_map = bodyPose(*data_, container_body_).inverse();
  const Twist2d base = baseTwist();
  Eigen::AlignedBox3d space = container_inside_;
  space.max().z() += kOverRim_m;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const BrickSlot& slot = slots_[i];
    const Eigen::Isometry3d T_container_brick = T_container_map * bodyPose(*data_, slot.body);
    if (!slot.is_present || static_cast<int>(i) == held_ || !space.contains(T_container_brick.translation())) {
      continue;
    }
    const Eigen::Map<const Eigen::Vector3d> velocity(data_->qvel + slot.dof);
    const Eigen::Map<const Eigen::Vector3d> spin(data_->qvel + slot.dof + 3);
    const double allowed_m_s = kRestSpeed_m_s + std::abs(base.linear_m_s) + std::abs(base.angular_rad_s);
    const double allowed_rad_s = kRestSpeed_rad_s + std::abs(base.angular_rad_s);
    const Eigen::RowVector3d up = T_container_brick.linear().row(2).cwiseAbs();
    const double lowest_m = T_container_brick.translation().z() - 0.5 * up.dot(slot.brick.placement.type.size_m);
    result.push_back({slot.brick.placement.id, velocity.norm() < allowed_m_s && spin.norm() < allowed_rad_s,
                      lowest_m < container_inside_.min().z() + kSeated_m && up.maxCoeff() > kSeated_cosine});
  }
  return result;
}

std::size_t World::indexOf(int id) const {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (slots_[i].brick.placement.id == id) {
      return i;
    }
  }
  throw std::invalid_argument("there is no brick " + std::to_string(id) + " in the world");
}

bool World::knowsBrick(int id) const {
  return std::any_of(slots_.begin(), slots_.end(),
                     [id](const BrickSlot& slot) { return slot.brick.placement.id == id; });
}

std::string World::obstacleAt(int id, const Eigen::Isometry3d& T_map_brick) {
  const std::size_t index = indexOf(id);
  const BrickSlot& slot = slots_[index];
  if (!T_map_brick.matrix().allFinite() || T_map_brick.translation().cwiseAbs().maxCoeff() > kFarthest_m) {
    throw std::invalid_argument("brick " + std::to_string(id) + ": its position must be finite and within +-100 m");
  }
  // On a copy: asking changes nothing.
  const DataPtr trial(mj_copyData(nullptr, model_.get(), data_.get()));
  std::copy_n(T_map_brick.translation().data(), 3, trial->qpos + slot.qpos);
  quaternionTo(Eigen::Quaterniond(T_map_brick.linear()).normalized(), trial->qpos + slot.qpos + 3);
  const int contype = model_->geom_contype[slot.geom];
  const int conaffinity = model_->geom_conaffinity[slot.geom];
  // A sleeping brick collides with none that sleeps, one that was taken away with nothing.
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = 1;
  mj_forward(model_.get(), trial.get());
  model_->geom_contype[slot.geom] = contype;
  model_->geom_conaffinity[slot.geom] = conaffinity;
  for (int i = 0; i < trial->ncon; ++i) {
    const mjContact& contact = trial->contact[i];
    if ((contact.geom1 != slot.geom && contact.geom2 != slot.geom) || !isInside(*model_, contact)) {
      continue;
    }
    const int other = contact.geom1 == slot.geom ? contact.geom2 : contact.geom1;
    return model_->geom_bodyid[other] == 0 ? nameOf(*model_, mjOBJ_GEOM, other)
                                           : nameOf(*model_, mjOBJ_BODY, model_->geom_bodyid[other]);
  }
  return "";
}

void World::moveBrick(int id, const Eigen::Isometry3d& T_map_brick) {
  BrickSlot& slot = slots_[indexOf(id)];
  if (!T_map_brick.matrix().allFinite()) {
    throw std::invalid_argument("brick " + std::to_string(id) + ": the pose to move it to is not finite");
  }
  if (heldBrick() == id) {
    letGo(ReleaseReason::kFault);
    is_magnet_spent_ = true;
  }
  if (sleep_) {
    sleep_->wake(*model_, *data_, id);  // and what leaned on it
  }
  slot.is_present = true;
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = 1;
  std::copy_n(T_map_brick.translation().data(), 3, data_->qpos + slot.qpos);
  quaternionTo(Eigen::Quaterniond(T_map_brick.linear()).normalized(), data_->qpos + slot.qpos + 3);
  std::fill_n(data_->qvel + slot.dof, 6, 0.0);
  std::fill_n(data_->qacc_warmstart + slot.dof, 6, 0.0);
  mj_forward(model_.get(), data_.get());
}

std::string World::thingAt(const Eigen::Vector2d& xy_map) {
  if (!xy_map.allFinite() || xy_map.cwiseAbs().maxCoeff() > kFarthest_m) {
    throw std::invalid_argument("obstacle: its position must be finite and within +-100 m");
  }
  // Bodies that stand still have no contact with each other.
  for (const Obstacle& other : obstacles()) {
    if ((other.xy_map - xy_map).norm() < 2.0 * kObstacleRadius_m - kInside_m) {
      return obstacleBodyName(other.index);
    }
  }
  // On a copy, in which any of them may stand for the new one: asking changes nothing.
  const ObstacleSlot& slot = obstacles_.front();
  const DataPtr trial(mj_copyData(nullptr, model_.get(), data_.get()));
  const Eigen::Vector3d middle(xy_map.x(), xy_map.y(), 0.5 * kObstacleHeight_m);
  std::copy_n(middle.data(), 3, trial->mocap_pos + 3 * slot.mocap);
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = 1;
  mj_forward(model_.get(), trial.get());
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = slot.is_present ? 1 : 0;
  for (int i = 0; i < trial->ncon; ++i) {
    const mjContact& contact = trial->contact[i];
    if ((contact.geom1 == slot.geom || contact.geom2 == slot.geom) && isInside(*model_, contact)) {
      const int other = contact.geom1 == slot.geom ? contact.geom2 : contact.geom1;
      return model_->geom_bodyid[other] == 0 ? nameOf(*model_, mjOBJ_GEOM, other)
                                             : nameOf(*model_, mjOBJ_BODY, model_->geom_bodyid[other]);
    }
  }
  return "";
}

void World::placeObstacle(ObstacleSlot& slot, bool is_present, const Eigen::Vector3d& base_map) {
  slot.is_present = is_present;
  const Eigen::Vector3d middle = base_map + Eigen::Vector3d(0.0, 0.0, 0.5 * kObstacleHeight_m);
  std::copy_n(middle.data(), 3, data_->mocap_pos + 3 * slot.mocap);
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = is_present ? 1 : 0;
}

int World::addObstacle(const Eigen::Vector2d& xy_map) {
  if (!xy_map.allFinite() || xy_map.cwiseAbs().maxCoeff() > kFarthest_m) {
    throw std::invalid_argument("obstacle: its position must be finite and within +-100 m");
  }
  for (std::size_t i = 0; i < obstacles_.size(); ++i) {
    if (!obstacles_[i].is_present) {
      placeObstacle(obstacles_[i], true, {xy_map.x(), xy_map.y(), 0.0});
      mj_forward(model_.get(), data_.get());
      return static_cast<int>(i);
    }
  }
  throw std::logic_error("World: " + std::to_string(kMaxObstacles) + " obstacles stand already");
}

void World::takeAwayObstacle(int index) {
  if (index < 0 || index >= kMaxObstacles || !obstacles_[static_cast<std::size_t>(index)].is_present) {
    throw std::invalid_argument("there is no obstacle " + std::to_string(index) + " in the world");
  }
  placeObstacle(obstacles_[static_cast<std::size_t>(index)], false, kStoreroom);
  mj_forward(model_.get(), data_.get());
}

std::vector<Obstacle> World::obstacles() const {
  std::vector<Obstacle> standing;
  for (std::size_t i = 0; i < obstacles_.size(); ++i) {
    if (obstacles_[i].is_present) {
      const mjtNum* middle = data_->mocap_pos + 3 * obstacles_[i].mocap;
      standing.push_back({static_cast<int>(i), {middle[0], middle[1]}});
    }
  }
  return standing;
}

void World::takeAwayBrick(int id) {
  if (!brick(id)) {
    throw std::invalid_argument("there is no brick " + std::to_string(id) + " in the world any more");
  }
  Eigen::Isometry3d away = Eigen::Isometry3d::Identity();
  away.translation() = kStoreroom;
  moveBrick(id, away);
  BrickSlot& slot = slots_[indexOf(id)];
  slot.is_present = false;
  // All that are there lie in one place: each pair of them would cost the solver as much as a pile.
  model_->geom_contype[slot.geom] = model_->geom_conaffinity[slot.geom] = 0;
}

std::uint64_t World::digest() const {
  std::uint64_t hash = 0xCBF29CE484222325ULL;
  hash = hashBytes(hash, &data_->time, sizeof(mjtNum));
  hash = hashBytes(hash, data_->qpos, sizeof(mjtNum) * static_cast<std::size_t>(model_->nq));
  hash = hashBytes(hash, data_->mocap_pos, sizeof(mjtNum) * 3 * static_cast<std::size_t>(model_->nmocap));
  return hashBytes(hash, data_->qvel, sizeof(mjtNum) * static_cast<std::size_t>(model_->nv));
}

}  // namespace simulated_world
