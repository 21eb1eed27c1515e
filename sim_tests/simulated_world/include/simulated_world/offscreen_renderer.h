// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mujoco/mujoco.h>
#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace simulated_world {

/// What is fixed when the graphics context is made.
struct RendererConfig {
  int max_width_px{640};    ///< of any image
  int max_height_px{480};   ///< of any image
  int samples{0};           ///< per pixel; 0 = one, at its centre. More smooth edges, and make depth there arbitrary
  int shadow_map_px{4096};  ///< edge of the shadow map
  int quads_per_edge{1};    ///< of a box's face. More make light near to it look right, and cost a quarter of a frame

  std::vector<std::string> validate() const;
};

/// What a picture shows. The default is what a sensor needs, at the least cost.
struct RenderOptions {
  bool has_shadows{false};
  bool has_reflections{false};
  bool has_skybox{false};                                                              ///< black background without
  std::array<bool, mjNGROUP> shows_geom_group{true, true, true, false, false, false};  ///< 2 visual, 3 collision
  double near_m{0.01};                                                                 ///< what is nearer is cut away
  double far_m{50.0};  ///< what is farther is background

  std::vector<std::string> validate() const;
};

/// Draws a MuJoCo model into memory, on EGL without any display. Needs no graphics card: Mesa's software renderer will do.
/// Belongs to the thread that made it: any other use throws std::logic_error. Several may live in one thread.
class OffscreenRenderer {
 public:
  /// Uploads the model's textures and meshes, which takes some 0.1 s; later changes of them are not seen. The model must
  /// outlive the renderer. Throws std::invalid_argument for a bad config or a model with more textures than this MuJoCo
  /// can hold, and std::runtime_error with the reason if there is no EGL to draw on.
  explicit OffscreenRenderer(const mjModel& model, const RendererConfig& config = {});
  ~OffscreenRenderer();
  OffscreenRenderer(const OffscreenRenderer&) = delete;
  OffscreenRenderer& operator=(const OffscreenRenderer&) = delete;

  /// Draws the state `data` seen from `T_world_camera` (optical axes: z forward, x right, y down) by a pinhole camera
  /// whose pixel centres are at integers. `rgb` becomes CV_8UC3 in the order red, green, blue; `depth_m` becomes CV_32FC1,
  /// metres along the optical axis, +Inf where nothing is nearer than far_m. Either may be null and is then not read back.
  /// Depth is quantised to z^2 / near_m / 2^24: 0.05 mm at 3 m by default.
  /// Kinematics of `data` must be up to date (mj_forward, mj_step). MuJoCo's scratch stack inside `data` is used, so
  /// nothing else may use it at the same time.
  /// Throws std::invalid_argument if the image is larger than the config allows, or fx differs from fy.
  void render(const mjData& data, const Eigen::Isometry3d& T_world_camera, const synthetic_depth::CameraModel& camera,
              const RenderOptions& options, cv::Mat* rgb, cv::Mat* depth_m);

  /// The same view by what is seen: `geom_ids` becomes CV_32SC1, the model's index of the geom at the middle of each
  /// pixel, -1 where nothing is nearer than far_m. Of `data` and errors as render(); throws std::invalid_argument, too, if
  /// the config has several samples per pixel, which would mix indices.
  void segmentation(const mjData& data, const Eigen::Isometry3d& T_world_camera,
                    const synthetic_depth::CameraModel& camera, const RenderOptions& options, cv::Mat* geom_ids);

  const mjModel& model() const { return model_; }

 private:
  void requireDrawable(const synthetic_depth::CameraModel& camera, const RenderOptions& options) const;

  class Context;  // EGL context and MuJoCo's objects in it

  const mjModel& model_;
  RendererConfig config_;
  std::unique_ptr<Context> context_;
};

}  // namespace simulated_world
