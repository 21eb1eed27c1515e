// SPDX-License-Identifier: BSD-3-Clause
// Prints a URDF with a measured edge in place of a fixed joint's origin; for <param command="..."/> of launch files.
#include <cstdio>
#include <exception>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "mp700_ur5e_description/camera_calibration.h"

namespace {

std::string textOf(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  if (!(text << file.rdbuf())) throw std::invalid_argument("cannot read " + path);
  return text.str();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: calibrated_urdf <robot.urdf> <camera_calibration.yaml>\n");
    return 2;
  }
  try {
    const std::string urdf =
        mp700_ur5e_description::calibratedUrdf(textOf(argv[1]), mp700_ur5e_description::loadCameraCalibration(argv[2]));
    return std::fputs(urdf.c_str(), stdout) < 0 || std::fflush(stdout) != 0 ? 1 : 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "calibrated_urdf: %s\n", error.what());
    return 1;
  }
}
