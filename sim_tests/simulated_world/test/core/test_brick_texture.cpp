// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/brick_texture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

#include "mjcf_of_scene.h"
#include "simulated_world/mujoco_model.h"
#include "simulated_world/offscreen_renderer.h"
#include "simulated_world/tag_cells.h"

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/apriltag_pose.h>
#include <apriltag/tag36h11.h>
}

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

const synthetic_depth::CameraModel kCamera{640, 480, 525.0, 525.0, 319.5, 239.5};
const synthetic_depth::CameraModel kSharpCamera{1280, 960, 1050.0, 1050.0, 639.5, 479.5};

/// Pose of a face's tag in the brick's frame, written down face by face: columns right, up, out.
Eigen::Isometry3d tagOnBrick(const Eigen::Vector3d& size_m, std::size_t face) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX();
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  const std::array<std::array<Eigen::Vector3d, 3>, 6> axes{
      {{y, z, x}, {-y, z, -x}, {-x, z, y}, {x, z, -y}, {x, y, z}, {-x, y, -z}}};
  for (int column = 0; column < 3; ++column) {
    pose.linear().col(column) = axes[face][static_cast<std::size_t>(column)];
  }
  pose.translation() = 0.5 * size_m.cwiseProduct(axes[face][2]);
  return pose;
}

struct SeenTag {
  int hamming{-1};
  Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};
};

/// The AprilTag with the given id, if it is in the picture exactly once.
std::optional<SeenTag> findAprilTag(const cv::Mat& rgb, const synthetic_depth::CameraModel& camera, int id,
                                    double edge_m) {
  cv::Mat grey;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  image_u8_t image{grey.cols, grey.rows, static_cast<int32_t>(grey.step), grey.data};
  const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family(tag36h11_create(), tag36h11_destroy);
  const std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector(apriltag_detector_create(),
                                                                                      apriltag_detector_destroy);
  apriltag_detector_add_family(detector.get(), family.get());
  detector->quad_decimate = 1.0F;
  const std::unique_ptr<zarray_t, void (*)(zarray_t*)> found(apriltag_detector_detect(detector.get(), &image),
                                                             apriltag_detections_destroy);
  apriltag_detection_t* detection = nullptr;
  for (int i = 0; i < zarray_size(found.get()); ++i) {
    apriltag_detection_t* candidate = nullptr;
    zarray_get(found.get(), i, &candidate);
    if (candidate->id == id) {
      if (detection != nullptr) {
        return std::nullopt;
      }
      detection = candidate;
    }
  }
  if (detection == nullptr) {
    return std::nullopt;
  }
  // The library's pixel centres are at halves.
  apriltag_detection_info_t info{detection, edge_m, camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5};
  apriltag_pose_t pose;
  estimate_tag_pose(&info, &pose);
  SeenTag seen;
  seen.hamming = detection->hamming;
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  // The library's tag has y down and z into the tag.
  seen.T_camera_tag.linear() = Eigen::Map<const RowMajor>(pose.R->data) * Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  seen.T_camera_tag.translation() = Eigen::Map<const Eigen::Vector3d>(pose.t->data);
  std::free(pose.R);  // what matd_destroy() does; Debian's library does not export it
  std::free(pose.t);
  return seen;
}

/// A brick with drawn faces in an even light, at any pose.
struct BrickWorld {
  BrickWorld(const BrickAppearance& appearance, const Eigen::Isometry3d& T_world_brick)
      : model(compileModel("<mujoco><visual><headlight ambient='0.4 0.4 0.4' diffuse='0.5 0.5 0.5'/></visual><asset>" +
                           brickTextureXml("brick", kBrickFace_px) + "</asset><worldbody><geom type='box' size='" +
                           std::to_string(0.5 * appearance.size_m.x()) + ' ' +
                           std::to_string(0.5 * appearance.size_m.y()) + ' ' +
                           std::to_string(0.5 * appearance.size_m.z()) + "' material='brick'" +
                           test::poseXml(T_world_brick) + "/></worldbody></mujoco>")),
        data(makeData(*model)) {
    uploadBrickTexture(*model, "brick", drawBrickFaces(appearance, kBrickFace_px, 1));
    mj_forward(model.get(), data.get());
    RendererConfig config;
    config.max_width_px = kSharpCamera.width_px;
    config.max_height_px = kSharpCamera.height_px;
    renderer = std::make_unique<OffscreenRenderer>(*model, config);
  }

  cv::Mat lookFrom(const Eigen::Isometry3d& T_world_camera, const synthetic_depth::CameraModel& camera) {
    cv::Mat rgb;
    renderer->render(*data, T_world_camera, camera, {}, &rgb, nullptr);
    return rgb;
  }

  ModelPtr model;
  DataPtr data;
  std::unique_ptr<OffscreenRenderer> renderer;
};

const Eigen::Isometry3d kBrickPose =
    synthetic_depth::poseFromXyzRpy(Eigen::Vector3d(0.4, -0.3, 0.7), Eigen::Vector3d(0.3, -0.5, 2.1));

/// In front of a face at `distance_m`, `tilt_rad` off its normal towards the face's right and up, somewhat rolled.
Eigen::Isometry3d cameraBefore(const Eigen::Isometry3d& T_world_tag, double distance_m, double tilt_rad) {
  const Eigen::Vector3d towards(std::sin(tilt_rad) * 0.8, std::sin(tilt_rad) * 0.6, std::cos(tilt_rad));
  // Not quite at the tag: it shall not be in the middle of the image.
  return synthetic_depth::lookAt(T_world_tag * (distance_m * towards), T_world_tag * Eigen::Vector3d(0.03, 0.05, 0.0));
}

TEST(BrickTexture, EveryFaceShowsItsTagWhereTheTagsFrameIs) {
  BrickAppearance appearance;
  appearance.tag_ids = {17, 586, 3, 200, 41, 0};
  BrickWorld world(appearance, kBrickPose);
  double largest_shift_m = 0.0;
  double largest_turn_rad = 0.0;
  for (std::size_t face = 0; face < 6; ++face) {
    for (const double tilt_rad : {0.3, 0.6, -0.5}) {  // head-on, a tag's tilt can hardly be seen
      const Eigen::Isometry3d T_world_tag = kBrickPose * tagOnBrick(appearance.size_m, face);
      const Eigen::Isometry3d T_world_camera = cameraBefore(T_world_tag, 1.0, tilt_rad);
      const std::optional<SeenTag> seen = findAprilTag(world.lookFrom(T_world_camera, kSharpCamera), kSharpCamera,
                                                       appearance.tag_ids[face], appearance.tag_edge_m);
      ASSERT_TRUE(seen) << "face " << face;
      EXPECT_EQ(seen->hamming, 0);
      const Eigen::Isometry3d error = (T_world_camera.inverse() * T_world_tag).inverse() * seen->T_camera_tag;
      largest_shift_m = std::max(largest_shift_m, error.translation().norm());
      largest_turn_rad = std::max(largest_turn_rad, Eigen::AngleAxisd(error.linear()).angle());
    }
  }
  std::printf("largest error %.2f mm, %.3f deg\n", 1e3 * largest_shift_m, largest_turn_rad * 180.0 / M_PI);
  // 126 px of tag, found by its edges to a tenth of a pixel: 0.1 % of the distance and, seen at an angle, below 0.5 deg.
  EXPECT_LT(largest_shift_m, 0.001);
  EXPECT_LT(largest_turn_rad, 0.5 * M_PI / 180.0);
}

TEST(BrickTexture, TagsCanBeReadFromTwoMetres) {
  const BrickAppearance appearance;
  BrickWorld world(appearance, kBrickPose);
  for (std::size_t face = 0; face < 6; ++face) {
    for (const double tilt_rad : {0.0, 0.7}) {
      const Eigen::Isometry3d T_world_tag = kBrickPose * tagOnBrick(appearance.size_m, face);
      const std::optional<SeenTag> seen =
          findAprilTag(world.lookFrom(cameraBefore(T_world_tag, 2.0, tilt_rad), kCamera), kCamera,
                       appearance.tag_ids[face], appearance.tag_edge_m);
      EXPECT_TRUE(seen) << "face " << face << ", tilt " << tilt_rad;
    }
  }
}

TEST(BrickTexture, ShowsArucoMarkersUpright) {
  BrickAppearance appearance;
  appearance.family = "DICT_5X5_1000";
  appearance.tag_ids = {10, 11, 12, 13, 14, 999};
  BrickWorld world(appearance, kBrickPose);
  for (std::size_t face = 0; face < 6; ++face) {
    const Eigen::Isometry3d T_world_tag = kBrickPose * tagOnBrick(appearance.size_m, face);
    const Eigen::Isometry3d T_world_camera = cameraBefore(T_world_tag, 1.0, 0.3);
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(world.lookFrom(T_world_camera, kCamera),
                             cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_1000), corners, ids);
    const auto found = std::find(ids.begin(), ids.end(), appearance.tag_ids[face]);
    ASSERT_NE(found, ids.end()) << "face " << face;
    const std::vector<cv::Point2f>& seen = corners[static_cast<std::size_t>(found - ids.begin())];
    // Corners go clockwise from the upper left one of the upright marker.
    const double half = 0.5 * appearance.tag_edge_m;
    const std::array<Eigen::Vector3d, 4> p_tag{
        {{-half, half, 0.0}, {half, half, 0.0}, {half, -half, 0.0}, {-half, -half, 0.0}}};
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector3d p = T_world_camera.inverse() * T_world_tag * p_tag[i];
      // Without refinement the detector's corners are whole pixels.
      EXPECT_NEAR(seen[i].x, kCamera.fx_px * p.x() / p.z() + kCamera.cx_px, 1.5) << "face " << face;
      EXPECT_NEAR(seen[i].y, kCamera.fy_px * p.y() / p.z() + kCamera.cy_px, 1.5) << "face " << face;
    }
  }
}

TEST(BrickTexture, TagIsSquareInMetresOnFacesThatAreNot) {
  const BrickAppearance appearance;
  const cv::Mat front = drawBrickFaces(appearance, kBrickFace_px, 1)[3];  // 0.30 m wide, 0.20 m high
  const auto countBlack = [](const cv::Mat& line) {
    int count = 0;
    for (auto pixel = line.begin<cv::Vec3b>(); pixel != line.end<cv::Vec3b>(); ++pixel) {
      count += (*pixel)[0] < 90 ? 1 : 0;
    }
    return count;
  };
  // Along the middle of the border's rows and columns: half a cell, 0.0075 m, inside its outer edge. Whole pixels.
  const int row = static_cast<int>((0.10 - 0.06 + 0.0075) / 0.20 * kBrickFace_px);
  const int column = static_cast<int>((0.15 - 0.06 + 0.0075) / 0.30 * kBrickFace_px);
  EXPECT_NEAR(countBlack(front.row(row)), 0.12 / 0.30 * kBrickFace_px, 1.5);
  EXPECT_NEAR(countBlack(front.col(column)), 0.12 / 0.20 * kBrickFace_px, 1.5);
}

TEST(BrickTexture, ShowsPlatesWhereThereAreSome) {
  BrickAppearance appearance;
  appearance.has_plate = {true, false, true, true, true, true};
  const auto faces = drawBrickFaces(appearance, 160, 1);
  // Between paper (0.15 m) and plate edge (0.17 m) on faces 0.20 m wide: steel is grey, clay is red.
  const int at_px = static_cast<int>((0.5 - 0.08 / 0.20) * 160);
  const cv::Vec3b steel = faces[0].at<cv::Vec3b>(80, at_px);
  const cv::Vec3b clay = faces[1].at<cv::Vec3b>(80, at_px);
  EXPECT_NEAR(steel[0], steel[2], 3);
  EXPECT_GT(clay[0], clay[2] + 40);
}

TEST(BrickTexture, IsFixedByItsSeed) {
  const auto first = drawBrickFaces({}, 64, 1);
  const auto again = drawBrickFaces({}, 64, 1);
  const auto other = drawBrickFaces({}, 64, 2);
  for (std::size_t face = 0; face < 6; ++face) {
    EXPECT_EQ(std::memcmp(first[face].data, again[face].data, 64 * 64 * 3), 0);
    EXPECT_NE(std::memcmp(first[face].data, other[face].data, 64 * 64 * 3), 0);
  }
}

TEST(BrickTexture, RefusesWhatDoesNotFit) {
  BrickAppearance appearance;
  appearance.tag_edge_m = 0.14;  // 0.175 m with its margin, on a plate of 0.17 m
  appearance.plate_edge_m = 0.17;
  appearance.colour_rgb.x() = 1.5;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { drawBrickFaces(appearance, kBrickFace_px, 1); }),
              AllOf(HasSubstr("tag_edge_m = 0.14"), HasSubstr("colour_rgb[0] = 1.5")));
  appearance = {};
  appearance.plate_edge_m = 0.25;
  EXPECT_THROW(drawBrickFaces(appearance, kBrickFace_px, 1), std::invalid_argument);
  appearance = {};
  appearance.tag_ids[2] = 587;
  EXPECT_THROW(drawBrickFaces(appearance, kBrickFace_px, 1), std::invalid_argument);
  appearance = {};
  appearance.family = "tag16h5";
  EXPECT_THROW(drawBrickFaces(appearance, kBrickFace_px, 1), std::invalid_argument);
  EXPECT_THROW(drawBrickFaces({}, 8, 1), std::invalid_argument);
}

TEST(BrickTexture, RefusesFacesOfAnotherSizeThanTheTexture) {
  const ModelPtr model = compileModel("<mujoco><asset>" + brickTextureXml("brick", 64) + "</asset></mujoco>");
  EXPECT_THROW(uploadBrickTexture(*model, "brick", drawBrickFaces({}, 32, 1)), std::invalid_argument);
  EXPECT_THROW(uploadBrickTexture(*model, "no_brick", drawBrickFaces({}, 64, 1)), std::invalid_argument);
}

TEST(TagCells, HaveABlackBorder) {
  for (const char* family : {"tag36h11", "DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000"}) {
    const cv::Mat cells = tagCells(family, 1);
    ASSERT_EQ(cells.rows, cells.cols);
    EXPECT_EQ(cv::countNonZero(cells), cv::countNonZero(cells(cv::Rect(1, 1, cells.cols - 2, cells.rows - 2))));
    EXPECT_GT(cv::countNonZero(cells), 0);
  }
  EXPECT_EQ(tagCells("tag36h11", 0).cols, 8);
  EXPECT_EQ(tagCells("DICT_5X5_1000", 0).cols, 7);
}

}  // namespace
}  // namespace simulated_world
