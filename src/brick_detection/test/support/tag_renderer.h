// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"

/// Colour and depth images of tagged bricks whose poses are known: the truth that tests and benchmarks of this package
/// measure against. Rays are cast against exact boxes, and a pixel is the mean of many rays: no image is warped, and
/// nothing is shared with the code under test but CameraModel.
namespace brick_detection {

/// A box with plates and tags, as a brick of a catalogue or made up.
struct RenderBrick {
  mp700_ur5e_description::BrickType type;  ///< size, colour, plates
  std::map<int, mp700_ur5e_description::BrickTag> tags;
  Eigen::Isometry3d T_camera_brick{Eigen::Isometry3d::Identity()};
  /// Of the labels, about an axis in their plane: by so much the middle stands off the face; negative: both ends do.
  double label_bend_m{0.0};
  double label_bend_axis_rad{0.0};
};

/// A brick of the catalogue with all its tags. Throws std::invalid_argument for an id that the catalogue does not have.
RenderBrick catalogueBrick(const mp700_ur5e_description::BrickCatalogue& catalogue, int brick_id,
                           const Eigen::Isometry3d& T_camera_brick);

/// One tag alone on a thin board with `board_edge_m`: its pose is T_camera_tag.
RenderBrick tagBoard(int tag_id, double black_border_edge_m, double board_edge_m,
                     const Eigen::Isometry3d& T_camera_tag);

/// What stands in the way: a box of one colour.
struct RenderBox {
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
  Eigen::Isometry3d T_camera_box{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d color_rgb{0.5, 0.5, 0.5};
};

struct RenderScene {
  CameraModel camera;
  std::string family{"tag36h11"};
  double margin_cells{1.0};  ///< white paper round the tags
  std::vector<RenderBrick> bricks;
  std::vector<RenderBox> boxes;
  std::optional<Eigen::Isometry3d> T_camera_ground;  ///< z = 0 of this frame, without end
  // Colours are reflectances in [0, 1]; a brighter one than what the light makes of 1 saturates.
  Eigen::Vector3d ground_rgb{0.45, 0.44, 0.42};
  Eigen::Vector3d background_rgb{0.30, 0.32, 0.35};
  Eigen::Vector3d light_camera{-0.3, -0.8, -0.5};  ///< towards the light; its length does not matter
  double ambient{0.6};                             ///< share of the light that comes from everywhere
  int samples{32};                                 ///< rays per pixel where it shows more than one thing
};

/// What happens between scene and image; by default nothing but rounding to 8 bits. In this order:
struct RenderEffects {
  Eigen::Vector2d light_gradient{0.0, 0.0};  ///< relative change of brightness across the image, along u and v
  double exposure{1.0};                      ///< factor on all light: 0.1 is a dark room
  Eigen::Vector2d shadow_px{0.0, 0.0};       ///< a point on a shadow's edge
  Eigen::Vector2d shadow_normal{0.0, 0.0};   ///< into the shadow, unit; zero: no shadow
  double shadow_factor{0.5};                 ///< of the light in it
  double shadow_width_px{1.0};               ///< of its edge
  Eigen::Vector2d glare_px{0.0, 0.0};        ///< middle of a reflected lamp
  double glare_radius_px{0.0};               ///< to a third of its light
  double glare{0.0};                         ///< light there, of white paper's; 0: none
  Eigen::Vector2d motion_px{0.0, 0.0};       ///< the image moves by that during the exposure
  double blur_sigma_px{0.0};                 ///< lens
  double gamma{1.0};           ///< camera's tone curve, value^(1/gamma): above 1 blurred white eats into black
  double contrast{1.0};        ///< about middle grey
  double brightness{0.0};      ///< added [grey levels]
  double noise_std{0.0};       ///< of the sensor, the same for all colours [grey levels]
  double shot_noise{0.0};      ///< of the photons: variance per grey level of signal
  double depth_noise{0.0};     ///< standard deviation of inverse depth [1/m]: stereo
  double depth_noise_px{1.0};  ///< over which it is alike
  double depth_holes{0.0};     ///< share of pixels without depth, in blobs
};

/// A tag whose front is towards the camera and whose corners are before it, in the image or not.
struct RenderedTag {
  int id{0};
  std::size_t brick_index{0};  ///< into RenderScene::bricks
  Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};
  double corner_edge_m{0.0};                    ///< between the corners: TagLayout::cornerEdge()
  std::array<Eigen::Vector2d, 4> corners_px{};  ///< true ones, in the order of TagObservation
  double shortest_side_px{0.0};
  double visible_share{0.0};  ///< of the area between the corners: in the image and not hidden
};

struct RenderedView {
  cv::Mat color;    ///< CV_8UC3, order blue, green, red
  cv::Mat grey;     ///< CV_8UC1, of `color`
  cv::Mat depth_m;  ///< CV_32FC1 along the optical axis at the pixels' centres; NaN: nothing there, or a hole
  std::vector<RenderedTag> tags;  ///< in order of bricks and ids
};

/// The same scene, effects and seed give the same images. Throws std::invalid_argument for an impossible camera, an unknown
/// family or a tag id outside it. A pile of ten bricks at 640 x 480 takes about 0.1 s.
RenderedView render(const RenderScene& scene, const RenderEffects& effects, std::uint32_t seed);

/// Cells of a tag, row 0 at the top, 0 or 255, data outside the border included, as libapriltag and OpenCV draw it.
cv::Mat tagCells(const std::string& family, int id);

/// Pose of a tag (or brick) whose middle is seen at `pixel` at `distance_m` from the camera's centre. Its z axis points to
/// the camera but for `tilt_rad`, about an axis in the image plane at `tilt_axis_rad`; it is turned by `roll_rad` about
/// its own z.
Eigen::Isometry3d poseSeenAt(const CameraModel& camera, const Eigen::Vector2d& pixel, double distance_m,
                             double tilt_rad, double tilt_axis_rad, double roll_rad);

}  // namespace brick_detection
