// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include <depth_camera/depth_image.h>
#include <depth_camera/depth_noise.h>
#include "mp700_ur5e_description/robot_model.h"

namespace depth_self_filter {

/// Nearer along the optical axis than this there is nothing that an image could show [m].
constexpr double kNear_m = 0.001;

/// How much more than the robot's shapes is taken out, and what the camera's measurements are like.
struct RobotMaskConfig {
  double padding_m{0.01};
  double padding_rad{0.004};
  double brick_padding_m{0.03};
  int edge_px{2};
  double baseline_m{0.075};
  double noise_sigmas{5.0};  // of a million pixels of the robot, 5 leave less than one
  depth_camera::DepthNoiseModel noise{0.0005, 0.0, 0.0038};

  struct Noise {
    depth_camera::DepthNoiseModel& noise;

    static void fields(Noise& c, interactive_mapping::Fields& f) {
      f("a_m", c.noise.a_m, 0.0, 0.1, "m", "standard deviation of depth z: a + b z + c z^2 [m], z in metres: a");
      f("b", c.noise.b, 0.0, 0.1, "", "b");
      f("c_per_m", c.noise.c_per_m, 0.0, 0.1, "1/m", "c");
    }
  };

  static void fields(RobotMaskConfig& c, interactive_mapping::Fields& f) {
    f("padding_m", c.padding_m, 0.0, 0.5, "m",
      "padding of every shape of the robot, for errors of joint angles and mounting and for what sticks out of the "
      "shapes");
    f("padding_rad", c.padding_rad, 0.0, 0.2, "rad",
      "padding added per metre from the camera, for the error of its direction");
    f("brick_padding_m", c.brick_padding_m, 0.0, 0.5, "m",
      "padding of the brick in the hand, in place of padding_m: it sits less exactly");
    f("edge_px", c.edge_px, 0, 20, "px",
      "pixels added all round: where a depth jumps, cameras give pixels the depth of their neighbours");
    f("baseline_m", c.baseline_m, 0.0, 1.0, "m",
      "second viewpoint or emitter to depth camera, along image x, which makes shadows beside the robot; 0: none");
    f("noise_sigmas", c.noise_sigmas, 0.0, 20.0, "sigma",
      "a pixel nearer than the robot by more standard deviations shows something in front of it");
    Noise noise{c.noise};
    f.section("noise", noise);
  }
};

/// What the magnet holds: a box, held by a link of the URDF.
struct HeldBrick {
  std::string frame;
  Eigen::Isometry3d T_frame_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};  // full edges
};

/// Why the brick cannot be held by this robot: what was seen, and what is allowed. Empty: it can.
std::string whyNotHeld(const mp700_ur5e_description::RobotModel& robot, const HeldBrick& brick);

/// A padded shape before the camera.
struct PlacedShape {
  mp700_ur5e_description::Shape shape;
  Eigen::Isometry3d T_camera_shape;  // optical frame
};

struct MaskStatistics {
  std::size_t masked_px{0};    // no information now: robot, brick, and what they hide
  std::size_t shadow_px{0};    // holes beside them, their shadows; not among the former
  std::size_t in_front_px{0};  // where the robot is, but something nearer was measured; kept
};

/// Takes the robot out of depth images: its pixels become NaN, "no information" (REP-117).
///
/// A pixel belongs to the robot if its ray, or that of a pixel up to edge_px beside it, enters a padded shape. It must
/// also not be measured clearly before the nearest such entry. Space that the robot hides is unknown; an object that
/// hides the robot is not. Holes, "no return" and "too close" within the silhouette become NaN, too. 0, the unexplained
/// hole of 16-bit images, becomes NaN within the width of a shadow beside the silhouette. Nothing in the image explains
/// it any more.
///
/// The camera's carrier does not blind it. A shape that holds the optical centre is the camera's housing and left out.
/// No padding is thicker than half the gap between shape and optical centre.
///
/// One thread at a time: keeps its buffers.
class RobotMask {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  RobotMask(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot, const RobotMaskConfig& config);

  /// The shapes that apply() takes out. `positions_rad` in the order of the robot's joints(). Throws
  /// std::invalid_argument for a wrong number of positions, what is not finite, or a brick that cannot be held.
  std::vector<PlacedShape> place(const Eigen::Isometry3d& T_root_camera, const Eigen::VectorXd& positions_rad,
                                 const std::optional<HeldBrick>& brick) const;

  /// Changes `image` in place. Throws std::invalid_argument as place() does, for an impossible camera, and if the image
  /// is not of the camera's size. The image then stays as it was. Some 3 ms for 640 x 480 px.
  MaskStatistics apply(const depth_camera::CameraModel& camera, const Eigen::Isometry3d& T_root_camera,
                       const Eigen::VectorXd& positions_rad, const std::optional<HeldBrick>& brick,
                       depth_camera::DepthImage* image);

  const mp700_ur5e_description::RobotModel& robot() const { return *robot_; }
  const RobotMaskConfig& config() const { return config_; }

 private:
  /// Pixels from `left` to `right` inclusive; none: left > right.
  struct Span {
    int left;
    int right;
  };

  /// Into spans_: a superset of the pixels whose rays meet the shape. False: none does.
  bool findSpans(const PlacedShape& placed, const depth_camera::CameraModel& camera);
  void enter(const PlacedShape& placed, const depth_camera::CameraModel& camera);
  float* entryRow(int v) { return &entry_m_[static_cast<std::size_t>(v) * stride_ + config_.edge_px]; }
  void spreadEntries(int width, int height);
  MaskStatistics blank(const depth_camera::CameraModel& camera, depth_camera::DepthImage* image);
  std::size_t blankShadows(const depth_camera::CameraModel& camera, depth_camera::DepthImage* image) const;

  const std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  const RobotMaskConfig config_;

  // Where the ray of each pixel enters the nearest shape: depth along the optical axis [m], +Inf where it does not. Rows
  // have a border of edge_px on both sides.
  std::vector<float> entry_m_;
  std::vector<float> spread_m_;  // the same after spreading along rows
  std::size_t stride_{0};
  std::vector<Span> spans_;
  int first_row_{0};  // of the silhouette; first > last: there is none
  int last_row_{-1};
};

/// Whether the joint's angle changes where any shape is. Of a joint that turns without end and moves nothing but shapes
/// of revolution about its own axis, such as wheels, it does not.
bool movesShapes(const mp700_ur5e_description::RobotModel& robot, std::size_t joint);

}  // namespace depth_self_filter
