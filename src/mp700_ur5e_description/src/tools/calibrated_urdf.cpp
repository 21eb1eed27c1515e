// SPDX-License-Identifier: BSD-3-Clause
// Prints a URDF with what was measured of this very robot in place of the drawing's, or how far they are apart; for
// people, and for <param command="..."/> of launch files.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/formatted.h>

#include "mp700_ur5e_description/arm_calibration.h"
#include "mp700_ur5e_description/camera_calibration.h"

namespace {

constexpr char kUsage[] =
    "usage: calibrated_urdf <robot.urdf> <camera_calibration.yaml>       the camera's measured mount\n"
    "       calibrated_urdf <robot.urdf> --arm <ur_calibration.yaml>     the arm's own kinematics\n"
    "       calibrated_urdf <robot.urdf> --compare <ur_calibration.yaml> how far the tip is off without them\n";

std::string outputFor(const std::string& urdf, const std::string& what, const std::string& path) {
  using namespace mp700_ur5e_description;
  if (what == "--arm") return calibratedUrdf(urdf, loadArmCalibration(path));
  if (what != "--compare") return calibratedUrdf(urdf, loadCameraCalibration(path));
  const ArmDifference difference = differenceOf(urdf, loadArmCalibration(path));
  return interactive_mapping::formatted("mean_mm: %.3f\nworst_mm: %.3f\nworst_deg: %.4f\n", 1e3 * difference.mean_m,
                                        1e3 * difference.worst_m, difference.worst_rad * 180.0 / M_PI);
}

}  // namespace

int main(int argc, char** argv) {
  const bool is_arm = argc == 4 && (std::strcmp(argv[2], "--arm") == 0 || std::strcmp(argv[2], "--compare") == 0);
  if (argc != 3 && !is_arm) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    const std::string output =
        outputFor(interactive_mapping::readTextFile(argv[1]), is_arm ? argv[2] : "", argv[argc - 1]);
    return std::fputs(output.c_str(), stdout) < 0 || std::fflush(stdout) != 0 ? 1 : 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "calibrated_urdf: %s\n", error.what());
    return 1;
  }
}
