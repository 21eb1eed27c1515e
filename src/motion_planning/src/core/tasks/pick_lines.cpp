// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "tasks/pick_stages.h"
#include "tasks/straight_line.h"

namespace motion_planning {
namespace {

PlanFailure blocked(const std::string& message) {
  return {PlanStatus::kApproachBlocked, message};
}

Result<JointPath> liftAlong(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                            const ArmVector& contact_rad, const Eigen::Vector3d& offset_base) {
  JointPath line = followLine(task, contact_rad, grip.T_base_contact, offset_base);
  const std::size_t shortest = numSteps(task.config, kMinLift_m);
  if (line.size() <= shortest) return blocked("the arm cannot follow the straight lift in one posture");
  // The lift ends where the brick has room to all sides, for the search that carries it away. Where it never has, the
  // lift ends as high as the brick is at least clear.
  std::size_t end = shortest;
  while (end < line.size() && !scene.withRoom().isFree(line[end])) ++end;
  if (end == line.size()) {
    Contact contact;
    Contact highest;  // the reason reported: below it is the pile
    do {
      contact = scene.carrying().check(line[--end]);
      if (end + 1 == line.size()) highest = contact;
    } while (contact && end > shortest);
    if (contact) {
      const double length_mm = 1000.0 * task.config.pick.cartesian_step_m * static_cast<double>(line.size() - 1);
      return blocked("at the end of the lift, " + std::to_string(std::lround(length_mm)) +
                     " mm on: " + highest.describe());
    }
  }
  line.resize(end + 1);
  Contact contact = scene.whileLifting().check(line.front());
  if (!contact) contact = firstContact(scene.whileLifting(), line);
  if (contact) return blocked("on the straight lift: " + contact.describe());
  return line;
}

}  // namespace

Result<JointPath> contactLine(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                              const ArmVector& contact_rad) {
  const MotionPlannerConfig& config = task.config;
  const Eigen::Vector3d back_base = -grip.T_base_contact.linear().col(2);
  JointPath line = followLine(task, contact_rad, grip.T_base_contact, config.pick.approach_m * back_base);
  if (line.size() <= numSteps(config, config.pick.approach_m)) {
    return blocked("the arm cannot follow the straight approach in one posture");
  }
  Contact contact = scene.beforeTouch().check(line.back());
  if (!contact) contact = firstContact(scene.touching(), line);
  if (contact) return blocked("on the straight approach: " + contact.describe());
  std::reverse(line.begin(), line.end());
  if (config.pick.overtravel_m <= 0.0) return line;
  // On to where the plate may still be: the bridge stops the arm at the contact. If the arm reached no farther than the
  // believed plate, a plate a millimetre behind it would never be met.
  const JointPath beyond = followLine(task, contact_rad, grip.T_base_contact, -config.pick.overtravel_m * back_base);
  if (beyond.size() <= numSteps(config, config.pick.overtravel_m)) {
    return blocked("the arm cannot follow the touch on beyond the plate");
  }
  contact = firstContact(scene.touching(), beyond);
  if (contact) return blocked("beyond the plate: " + contact.describe());
  line.insert(line.end(), std::next(beyond.begin()), beyond.end());
  return line;
}

std::vector<Eigen::Vector3d> liftOffsets(const Eigen::Vector3d& normal_base, double lift_m) {
  if (normal_base.z() >= 0.99) return {lift_m * normal_base};  // within 8 degrees both are one line
  if (normal_base.z() >= std::cos(0.25 * M_PI)) return {lift_m * normal_base, lift_m * Eigen::Vector3d::UnitZ()};
  const Eigen::Vector3d up_and_back = (normal_base + Eigen::Vector3d::UnitZ()).normalized();
  return {lift_m * up_and_back, lift_m * Eigen::Vector3d::UnitZ(), lift_m * normal_base};
}

Result<JointPath> liftLine(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                           const ArmVector& contact_rad, const std::vector<Eigen::Vector3d>& offsets_base) {
  PlanFailure why;
  for (const Eigen::Vector3d& offset_base : offsets_base) {
    Result<JointPath> line = liftAlong(task, scene, grip, contact_rad, offset_base);
    if (line) return line;
    why = line.failure();
  }
  return why;
}

}  // namespace motion_planning
