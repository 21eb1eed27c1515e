// SPDX-License-Identifier: BSD-3-Clause
#include "world_mjcf.h"

#include <iomanip>
#include <limits>
#include <sstream>

namespace simulated_world {

std::string brickName(int id) {
  return "brick_" + std::to_string(id);
}

std::string twinName(int id) {
  return brickName(id) + "_asleep";
}

std::string worldMjcf(const std::string& robot_mjcf, const std::string& assets_mjcf,
                      const std::vector<PhysicalBrick>& bricks, const WorldConfig& config) {
  std::ostringstream xml;
  xml << std::setprecision(std::numeric_limits<double>::max_digits10);
  xml << "<mujoco model=\"pile\">\n"
      << "  <compiler angle=\"radian\" inertiafromgeom=\"auto\"/>\n"
      << "  <option timestep=\"" << config.timestep_s << "\" solver=\"CG\" cone=\"elliptic\" impratio=\"10\"/>\n"
      << "  <size nconmax=\"1000\" njmax=\"3000\" nstack=\"16000000\"/>\n"
      << "  <asset>\n"
      << assets_mjcf << "  </asset>\n"
      << "  <worldbody>\n"
      << "    <light name=\"sky\" directional=\"true\" pos=\"0 0 10\" dir=\"-0.3 0.2 -1\"/>\n"
      << "    <geom name=\"ground\" type=\"plane\" size=\"50 50 1\" friction=\"0.8\"/>\n"
      << robot_mjcf;
  for (const PhysicalBrick& brick : bricks) {
    const Eigen::Vector3d p = brick.T_map_brick.translation();
    const Eigen::Quaterniond q(brick.T_map_brick.linear());
    const Eigen::Vector3d half = 0.5 * brick.size_m;
    xml << "    <body name=\"" << brickName(brick.id) << "\" pos=\"" << p.x() << ' ' << p.y() << ' ' << p.z()
        << "\" quat=\"" << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << "\"><freejoint/><geom name=\""
        << brickName(brick.id) << "\" type=\"box\" size=\"" << half.x() << ' ' << half.y() << ' ' << half.z()
        << "\" mass=\"" << brick.mass_kg << "\" friction=\"" << brick.friction << "\" group=\"1\"";
    if (!brick.material.empty()) {
      xml << " material=\"" << brick.material << '"';
    }
    xml << "/></body>\n";
    // Margin equal to gap: contacts are listed from that distance on, forces act from zero.
    xml << "    <body name=\"" << twinName(brick.id) << "\" mocap=\"true\" pos=\"0 0 -100\"><geom name=\""
        << twinName(brick.id) << "\" type=\"box\" size=\"" << half.x() << ' ' << half.y() << ' ' << half.z()
        << "\" friction=\"" << brick.friction << "\" margin=\"" << config.sleep.wake_distance_m << "\" gap=\""
        << config.sleep.wake_distance_m << "\" contype=\"0\" conaffinity=\"0\" group=\"4\" rgba=\"0 0 0 0\"/></body>\n";
  }
  xml << "  </worldbody>\n";
  if (!bricks.empty()) {
    xml << "  <equality><weld name=\"magnet_hold\" body1=\"magnet\" body2=\"" << brickName(bricks.front().id)
        << "\" active=\"false\" solref=\"0.005 1\" solimp=\"0.99 0.999 0.0001\"/></equality>\n";
  }
  xml << "  <sensor><force name=\"wrist_force\" site=\"wrist_ft\"/><torque name=\"wrist_torque\" site=\"wrist_ft\"/>"
      << "</sensor>\n</mujoco>\n";
  return xml.str();
}

}  // namespace simulated_world
