// SPDX-License-Identifier: BSD-3-Clause
// Program fit_manipulability as it is called.
#include <unistd.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gmock/gmock.h>

#include "motion_planning/manipulability_sector.h"

namespace motion_planning {
namespace {

namespace fs = std::filesystem;
using mp700_ur5e_description::RobotModel;
using testing::HasSubstr;

class FitManipulability : public testing::Test {
 protected:
  FitManipulability() : folder_(fs::temp_directory_path() / ("fit_manipulability_" + std::to_string(getpid()))) {
    // What ROS knows as package motion_planning has a sectors file already.
    fs::create_directories(folder_ / "motion_planning" / "config");
    write("motion_planning/package.xml",
          "<package format=\"2\"><name>motion_planning</name><version>0.0.0</version><description/>"
          "<maintainer email=\"a@example.org\">a</maintainer><license>BSD</license></package>");
    write("motion_planning/config/manipulability_sectors.yaml", "precious\n");
  }
  ~FitManipulability() override { fs::remove_all(folder_); }

  void write(const std::string& name, const std::string& content) const { std::ofstream(folder_ / name) << content; }
  std::string content(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(folder_ / name).rdbuf();
    return text.str();
  }
  /// Exit code.
  int run(const std::string& arguments) const {
    const std::string command = "ROS_PACKAGE_PATH=" + folder_.string() + " " FIT_MANIPULABILITY " " + arguments +
                                " > " + (folder_ / "stdout").string() + " 2> " + (folder_ / "stderr").string();
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  const fs::path folder_;
};

// Coarse: what is looked at is where the result goes.
const std::string kCoarse = " --quiet --joint-step 0.35 --urdf " URDF_FILE;

TEST_F(FitManipulability, WithoutOutNothingIsWritten) {
  EXPECT_EQ(run(kCoarse), 1);
  EXPECT_THAT(content("stderr"), HasSubstr("'--out' is required"));
  EXPECT_EQ(content("motion_planning/config/manipulability_sectors.yaml"), "precious\n");
  EXPECT_EQ(run("--out '' " + kCoarse), 1);
  EXPECT_THAT(content("stderr"), HasSubstr("--out is empty, must be a file to write"));
}

TEST_F(FitManipulability, HelpNeedsNoOut) {
  EXPECT_EQ(run("--help"), 0);
  EXPECT_THAT(content("stdout"), HasSubstr("Usage: fit_manipulability --out FILE"));
}

TEST_F(FitManipulability, WritesSectorsOfThisRobotWhereItIsTold) {
  ASSERT_EQ(run("--out " + (folder_ / "mine.yaml").string() + kCoarse), 0) << content("stderr");
  const auto robot = RobotModel::load(URDF_FILE);
  const ManipulabilitySectors sectors = ManipulabilitySectors::load((folder_ / "mine.yaml").string(), *robot);
  EXPECT_NEAR(sectors.config.joint_step_rad, 0.35, 1e-12);
  EXPECT_EQ(content("motion_planning/config/manipulability_sectors.yaml"), "precious\n");
}

}  // namespace
}  // namespace motion_planning
