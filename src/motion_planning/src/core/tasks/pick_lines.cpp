// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "tasks/pick_stages.h"
#include "tasks/straight_line.h"

namespace motion_planning {
namespace {

constexpr double kRub_m = 0.08;       // of a lift to the side, on the wall that the brick stands against
constexpr double kMinAside_m = 0.12;  // so far beside its place an unseen neighbour is in the way
constexpr std::size_t kLooks = 4;     // along a lift

PlanFailure blocked(const std::string& message) {
  return {PlanStatus::kApproachBlocked, message};
}

Result<JointPath> liftAlong(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                            const ArmVector& contact_rad, const Eigen::Vector3d& offset_base, bool is_aside) {
  JointPath line = followLine(task, contact_rad, grip.T_base_contact, offset_base);
  const std::size_t shortest = numSteps(task.config, is_aside ? kMinAside_m : kMinLift_m);
  if (line.size() <= shortest) return blocked("the arm cannot follow the straight lift in one posture");
  // The lift ends where the brick has room to all sides, for the search that carries it away. Where it never has, the
  // lift ends as high as the brick is at least clear.
  const Contact highest = scene.carrying().check(line.back());
  const auto isHopeless = [&] {  // nowhere clear, as far as a few looks can tell
    for (std::size_t k = 1; k < kLooks; ++k) {
      if (scene.carrying().isFree(line[shortest + (line.size() - 1 - shortest) * k / kLooks])) return false;
    }
    return true;
  };
  std::size_t end = line.size();
  if (!highest || !isHopeless()) {
    end = shortest;
    while (end < line.size() && !scene.withRoom().isFree(line[end])) ++end;
    if (end == line.size()) {
      do --end;
      while (end > shortest && !scene.carrying().isFree(line[end]));
    }
  }
  if (end == line.size() || !scene.carrying().isFree(line[end])) {
    const double length_mm = 1000.0 * task.config.pick.cartesian_step_m * static_cast<double>(line.size() - 1);
    return blocked("at the end of the lift, " + std::to_string(std::lround(length_mm)) +
                   " mm on: " + highest.describe());  // below it is the pile
  }
  line.resize(end + 1);
  JointPath among_others = line;
  if (is_aside) {
    std::size_t clear = end;
    while (clear > 0 && scene.carrying().isFree(line[clear - 1])) --clear;
    if (clear > numSteps(task.config, kRub_m))
      return blocked("a lift to the side does not get clear of its neighbours");
    among_others.resize(clear + 1);
  }
  const CollisionChecker& lifting = is_aside ? scene.whileLiftingAside() : scene.whileLifting();
  Contact contact = lifting.check(line.front());
  if (!contact) contact = firstContact(lifting, among_others);
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
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<Eigen::Vector3d> directions = {normal_base};
  if (normal_base.z() < std::cos(0.25 * M_PI)) {
    directions = {(normal_base + up).normalized(), up, normal_base};
  } else if (normal_base.z() < 0.99) {  // within 8 degrees both are one line
    directions.push_back(up);
  }
  const std::vector<Eigen::Vector3d> aside = upAndAside();  // out of corners
  directions.insert(directions.end(), aside.begin(), aside.end());
  for (Eigen::Vector3d& direction : directions) direction *= lift_m;
  return directions;
}

Result<JointPath> liftLine(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                           const ArmVector& contact_rad, const std::vector<Eigen::Vector3d>& offsets_base) {
  std::optional<PlanFailure> why;  // of the best direction
  for (std::size_t i = 0; i < offsets_base.size(); ++i) {
    const bool is_aside = i + kSideways >= offsets_base.size() && offsets_base.size() > kSideways;
    Result<JointPath> line = liftAlong(task, scene, grip, contact_rad, offsets_base[i], is_aside);
    if (line) return line;
    if (!why) why = line.failure();
  }
  return *why;
}

}  // namespace motion_planning
