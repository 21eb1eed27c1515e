// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/physics_options.h"

#include <algorithm>
#include <limits>
#include <sstream>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

#include "simulated_world/obstacle.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {
namespace {

/// All digits: a model that is written and read must be the same model.
std::ostringstream exactText() {
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  return text;
}

std::string contactAttributes(const PhysicsOptions& options, double sliding_friction, bool is_round = false) {
  // Flat faces touch in several points at once, which is all the resistance to turning that a brick needs (condim 3).
  // A round body would roll for ever: it has torsional and rolling friction [m].
  std::ostringstream text = exactText();
  text << "condim=\"" << (is_round ? 6 : 3) << "\" friction=\"" << sliding_friction << (is_round ? " 0.005 0.01" : "")
       << "\" solref=\"" << options.contact_time_constant_s << " 1\"";
  return text.str();
}

/// Shape of a brick's geom.
std::string shapeOf(const BrickPlacement& brick) {
  const Eigen::Vector3d half_m = 0.5 * brick.type.size_m;
  std::ostringstream text = exactText();
  if (brick.decoy == Decoy::kSphere) {
    text << "type=\"sphere\" size=\"" << half_m.x() << '"';
  } else if (brick.decoy == Decoy::kCylinder) {
    text << "type=\"cylinder\" size=\"" << half_m.x() << ' ' << half_m.z() << '"';
  } else {
    text << "type=\"box\" size=\"" << half_m.x() << ' ' << half_m.y() << ' ' << half_m.z() << '"';
  }
  return text.str();
}

}  // namespace

std::vector<std::string> PhysicsOptions::validate() const {
  interactive_mapping::RangeCheck check;
  check("timestep_s", timestep_s, 1e-5, 0.01, "s");
  check("impratio", impratio, 1.0, 1000.0, "");
  check("solver_iterations", solver_iterations, 1, 10000, "");
  check("solver_tolerance", solver_tolerance, 0.0, 1.0, "");
  // MuJoCo does not keep a contact stiffer than two steps.
  check("contact_time_constant_s", contact_time_constant_s, 2.0 * timestep_s, 1.0, "s");
  check("max_contacts", max_contacts, 1, 1000000, "");
  check("max_constraints", max_constraints, 1, 1000000, "");
  return check.problems();
}

PhysicsOptions PhysicsOptions::forBricks(std::size_t count) const {
  constexpr int kContacts = 22;               // of a brick: a heap of 80 that falls in a jumble
  constexpr std::size_t kDefaultBricks = 40;  // for which the buffers are made
  PhysicsOptions options = *this;
  if (count <= kDefaultBricks) return options;
  options.max_contacts = std::max(max_contacts, kContacts * static_cast<int>(count));
  options.max_constraints = std::max(max_constraints, 3 * options.max_contacts);
  return options;
}

std::string physicsXml(const PhysicsOptions& options) {
  interactive_mapping::refuseIfAny("PhysicsOptions:", options.validate());
  std::ostringstream text = exactText();
  // Conjugate gradients need 2 iterations for bricks in neat courses but 40 for heaps, where some corners bear nothing:
  // then Newton's method, which needs one for either, is the faster one. It also suits the robot's arm.
  text << "<option timestep=\"" << options.timestep_s << "\" cone=\"elliptic\" impratio=\"" << options.impratio
       << "\" solver=\"Newton\" iterations=\"" << options.solver_iterations << "\" tolerance=\""
       << options.solver_tolerance << "\"/>\n"
       << "<size nconmax=\"" << options.max_contacts << "\" njmax=\"" << options.max_constraints
       << "\" nstack=\"16000000\"/>\n";
  return text.str();
}

std::string groundXml(const PhysicsOptions& options, const std::string& geom_attributes) {
  // Of two geoms in contact, the larger friction counts.
  // Without conaffinity it collides with all but sleeping bricks (see BrickSleep), which have none either.
  return "<geom name=\"ground\" type=\"plane\" size=\"0 0 1\" conaffinity=\"0\" " + contactAttributes(options, 0.0) +
         " " + geom_attributes + "/>\n";
}

std::string wallXml(std::size_t index, const Wall& wall, const PhysicsOptions& options,
                    const std::string& geom_attributes) {
  constexpr double kFriction = 0.6;  // plaster
  const Eigen::Vector3d p = wall.pose().translation();
  std::ostringstream text = exactText();
  text << "<geom name=\"" << wallName(index) << "\" type=\"box\" pos=\"" << p.x() << ' ' << p.y() << ' ' << p.z()
       << "\" euler=\"0 0 " << wall.yaw_rad << "\" size=\"" << 0.5 * wall.size_m.x() << ' ' << 0.5 * wall.size_m.y()
       << ' ' << 0.5 * wall.size_m.z() << "\" conaffinity=\"0\" " << contactAttributes(options, kFriction) << ' '
       << geom_attributes << "/>\n";
  return text.str();
}

std::string brickXml(const BrickPlacement& brick, const PhysicsOptions& options, const std::string& geom_attributes) {
  const Eigen::Vector3d p = brick.T_map_brick.translation();
  const Eigen::Quaterniond q(brick.T_map_brick.linear());
  const std::string name = brickBodyName(brick.id);
  const bool is_round = brick.decoy == Decoy::kSphere || brick.decoy == Decoy::kCylinder;
  std::ostringstream text = exactText();
  text << "<body name=\"" << name << "\" pos=\"" << p.x() << ' ' << p.y() << ' ' << p.z() << "\" quat=\"" << q.w()
       << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << "\">\n"
       << "  <freejoint name=\"" << name << "_joint\"/>\n"
       << "  <geom name=\"" << name << "\" " << shapeOf(brick) << " mass=\"" << brick.type.mass_kg << "\" "
       << contactAttributes(options, brick.type.friction, is_round) << ' ' << geom_attributes << "/>\n"
       << "</body>\n";
  return text.str();
}

std::string obstacleXml(int index, const PhysicsOptions& options, const std::string& geom_attributes) {
  constexpr double kFriction = 0.5;  // clothes and soles; nothing that is measured depends on it
  const std::string name = obstacleBodyName(index);
  std::ostringstream text = exactText();
  text << "<body name=\"" << name << "\" mocap=\"true\" pos=\"0 0 " << 0.5 * kObstacleHeight_m << "\">\n"
       << "  <geom name=\"" << name << "\" type=\"cylinder\" size=\"" << kObstacleRadius_m << ' '
       << 0.5 * kObstacleHeight_m << "\" contype=\"0\" conaffinity=\"0\" " << contactAttributes(options, kFriction)
       << ' ' << geom_attributes << "/>\n"
       << "</body>\n";
  return text.str();
}

}  // namespace simulated_world
