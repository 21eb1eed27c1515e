// SPDX-License-Identifier: BSD-3-Clause
// The tool render_world as it is called from a shell.
#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include <boost/filesystem.hpp>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

namespace {

class RenderWorld : public testing::Test {
 protected:
  RenderWorld()
      : directory_(boost::filesystem::temp_directory_path() / boost::filesystem::unique_path("render_%%%%%%%%")) {
    boost::filesystem::create_directory(directory_);
  }
  ~RenderWorld() override { boost::filesystem::remove_all(directory_); }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  /// Exit code.
  int run(const std::string& arguments) const {
    const std::string command =
        std::string(RENDER_WORLD) + " " + arguments + " > " + path("stdout") + " 2> " + path("stderr");
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  /// Pixels in which red clearly outweighs the rest: a brick, but neither ground nor sky nor robot (its orange apart).
  static int brickPixels(const cv::Mat& bgr) {
    int count = 0;
    for (int row = 0; row < bgr.rows; ++row) {
      for (int column = 0; column < bgr.cols; ++column) {
        const cv::Vec3b pixel = bgr.at<cv::Vec3b>(row, column);
        count += pixel[2] > 1.5 * pixel[1] && pixel[2] > 1.5 * pixel[0] && pixel[2] > 40 ? 1 : 0;
      }
    }
    return count;
  }

  boost::filesystem::path directory_;
};

const std::string kBrick = SIMULATED_WORLDS "/single_brick.yaml";
// 1.4 m before the brick's face, where 120 rows show 0.75 m: the face is 32 px wide and high.
const std::string kLook = " --width 160 --height 120 --eye -1.5 0 0.5 --target 0 0 0.1 --fovy 30";

TEST_F(RenderWorld, ShowsTheBrickFromOutside) {
  ASSERT_EQ(run(kBrick + " --out " + path("near.png") + kLook), 0);
  const cv::Mat near = cv::imread(path("near.png"));
  ASSERT_EQ(near.size(), cv::Size(160, 120));
  EXPECT_GT(brickPixels(near), 300);  // 1024 of the face, 36 % of it under the tag, and more of the top
  ASSERT_EQ(run(kBrick + " --out " + path("away.png") + " --width 160 --height 120 --eye 1.5 0 0.5 --target 3 0 0.1"),
            0);
  EXPECT_EQ(brickPixels(cv::imread(path("away.png"))), 0);
}

TEST_F(RenderWorld, ShowsWhatTheRobotsCameraSees) {
  ASSERT_EQ(run(kBrick + " --view camera --out " + path("color.png") + " --config " + SIMULATION_CONFIG), 0);
  const cv::Mat color = cv::imread(path("color.png"));
  ASSERT_EQ(color.size(), cv::Size(640, 480));
  EXPECT_GT(brickPixels(color), 300);  // at 3 m a face is 35 px wide and high
  ASSERT_EQ(run(kBrick + " --view depth --out " + path("depth.png")), 0);
  const cv::Mat depth = cv::imread(path("depth.png"));
  EXPECT_EQ(depth.cols, 640);
  EXPECT_GT(depth.rows, 480);  // with its scale
}

TEST_F(RenderWorld, RefusesWhatItCannotDo) {
  const std::string out = " --out " + path("none.png");
  EXPECT_EQ(run(kBrick), 2);
  EXPECT_EQ(run(kBrick + out + " --view sideways"), 2);
  EXPECT_EQ(run(kBrick + out + " --eye 1 2"), 2);
  EXPECT_EQ(run(kBrick + out + " --seed -1"), 2);
  EXPECT_EQ(run("no_such_scene.yaml" + out), 1);
  EXPECT_EQ(run(kBrick + " --out /no/such/folder/a.png" + kLook), 1);
  EXPECT_FALSE(boost::filesystem::exists(path("none.png")));
}

}  // namespace
