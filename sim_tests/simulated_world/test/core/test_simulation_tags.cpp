// SPDX-License-Identifier: BSD-3-Clause
// Tags in the images of the simulated camera: what bricks.yaml says is what a detector reads, where the truth has it.
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include <gtest/gtest.h>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
}

#include "simulated_world/testing/robot_in_world.h"

namespace simulated_world {
namespace {

namespace description = mp700_ur5e_description;

// Middle of each tag in the image, by id.
using TagCentres = std::map<int, Eigen::Vector2d>;

TagCentres apriltagsIn(const cv::Mat& grey) {
  apriltag_family_t* family = tag36h11_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family_bits(detector, family, 1);
  detector->quad_decimate = 1.0F;
  image_u8_t image{grey.cols, grey.rows, static_cast<int32_t>(grey.step), grey.data};
  zarray_t* found = apriltag_detector_detect(detector, &image);
  TagCentres centres;
  for (int i = 0; i < zarray_size(found); ++i) {
    apriltag_detection_t* detection = nullptr;
    zarray_get(found, i, &detection);
    centres[detection->id] = {detection->c[0] - 0.5, detection->c[1] - 0.5};  // its pixels' corners are at integers
  }
  apriltag_detections_destroy(found);
  apriltag_detector_destroy(detector);
  tag36h11_destroy(family);
  return centres;
}

TagCentres arucoIn(const cv::Mat& grey) {
  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;
  cv::aruco::detectMarkers(grey, cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_1000), corners, ids);
  TagCentres centres;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    // Where the diagonals cross: the image of the square's middle, which the corners' mean is not.
    const auto at = [&corners, i](std::size_t k) { return Eigen::Vector3d(corners[i][k].x, corners[i][k].y, 1.0); };
    centres[ids[i]] = at(0).cross(at(2)).cross(at(1).cross(at(3))).hnormalized();
  }
  return centres;
}

SimulationConfig configWith(const std::string& bricks_file) {
  SimulationConfig config;
  config.description = descriptionFiles();
  config.description.bricks = bricks_file;
  config.scene = std::string(SIMULATED_WORLDS) + "/two_stacked.yaml";
  config.camera_rate_hz = 0.0;
  return config;
}

/// Two bricks on the ground before the camera, one turned.
cv::Mat imageOfTwo(Simulation& sim) {
  const Pose2d base = sim.world().basePose();
  for (const int id : {0, 1}) {
    Fault by_hand;
    by_hand.kind = FaultKind::kMoveBrick;
    by_hand.brick_id = id;
    const Pose2d there = compose(base, {1.1, id == 0 ? 0.35 : -0.15, id == 0 ? 0.4 : -0.9});
    by_hand.T_map_object.translation() = Eigen::Vector3d(there.x_m, there.y_m, 0.1);
    by_hand.T_map_object.rotate(Eigen::AngleAxisd(there.yaw_rad, Eigen::Vector3d::UnitZ()));
    sim.addFault(by_hand);
  }
  for (int i = 0; i < 100; ++i) {
    sim.tick();
  }
  cv::Mat grey;
  sim.requestImage();
  cv::cvtColor(sim.tick().images.at(0).frame.rgb, grey, cv::COLOR_RGB2GRAY);
  return grey;
}

/// What the detector finds against the true poses.
void expectTagsWhereTheyAre(const std::string& bricks_file, TagCentres (*detect)(const cv::Mat&), std::size_t least) {
  const SimulationConfig config = configWith(bricks_file);
  Simulation sim(config);
  const TagCentres centres = detect(imageOfTwo(sim));
  EXPECT_GE(centres.size(), least);

  const description::BrickCatalogue catalogue = description::loadBrickTypes(bricks_file);
  const Eigen::Isometry3d T_camera_map = sim.world().linkPose("camera_color_optical_frame").inverse();
  const synthetic_depth::CameraModel& camera = config.camera.camera;
  int tops = 0;
  for (const auto& [tag_id, centre] : centres) {
    const std::optional<description::BrickTag> tag = catalogue.brickOfTag(tag_id);
    ASSERT_TRUE(tag && tag->brick_id < 2) << tag_id;
    tops += tag->face == description::BrickFace::kPlusZ ? 1 : 0;
    const Eigen::Isometry3d T_map_brick = sim.world().brick(tag->brick_id)->T_map_brick;
    const Eigen::Isometry3d T_camera_tag =
        T_camera_map * T_map_brick * description::tagPose(catalogue.types.at(0), tag->face);
    EXPECT_LT(T_camera_tag.linear().col(2).dot(T_camera_tag.translation()), 0.0) << "seen from behind: " << tag_id;
    const Eigen::Vector3d p = T_camera_tag.translation();
    const Eigen::Vector2d expected(camera.fx_px * p.x() / p.z() + camera.cx_px,
                                   camera.fy_px * p.y() / p.z() + camera.cy_px);
    // Detectors place a tag of 40 pixels to some tenths of a pixel; the wrong face would be 30 pixels off.
    EXPECT_LT((centre - expected).norm(), 1.0)
        << "tag " << tag_id << " at " << centre.transpose() << ", not " << expected.transpose();
  }
  EXPECT_EQ(tops, 2);
}

TEST(SimulationTags, AprilTagsAreThoseOfTheCatalogueWhereTheTruthHasThem) {
  expectTagsWhereTheyAre(descriptionFiles().bricks, apriltagsIn, 4);  // two tops and a side of each
}

TEST(SimulationTags, AreOffWithTheSamePile) {
  SimulationConfig config = configWith(descriptionFiles().bricks);
  Simulation tagged(config);
  EXPECT_FALSE(apriltagsIn(imageOfTwo(tagged)).empty());
  config.has_tags = false;
  Simulation plain(config);
  EXPECT_TRUE(apriltagsIn(imageOfTwo(plain)).empty());
  EXPECT_EQ(plain.digest(), tagged.digest());
}

TEST(SimulationTags, ArucoIsAnOption) {
  std::ifstream shipped(descriptionFiles().bricks);
  std::ostringstream text;
  text << shipped.rdbuf();
  std::string bricks = text.str();
  const std::string family = "family: tag36h11";
  ASSERT_NE(bricks.find(family), std::string::npos);
  bricks.replace(bricks.find(family), family.size(), "family: DICT_5X5_1000");
  std::string folder = (std::filesystem::temp_directory_path() / "bricks_XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  std::ofstream(folder + "/bricks.yaml") << bricks;
  expectTagsWhereTheyAre(folder + "/bricks.yaml", arucoIn,
                         3);  // two tops and a side: the steeper one not by every OpenCV
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace simulated_world
