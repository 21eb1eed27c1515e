// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/offscreen_renderer.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>

#include "egl_context.h"
#include "simulated_world/mujoco_model.h"

namespace simulated_world {
namespace {

void copyTo(const Eigen::Vector3d& vector, float* out) {
  for (int i = 0; i < 3; ++i) {
    out[i] = static_cast<float>(vector[i]);
  }
}

/// Pinhole camera to viewing frustum. The image's borders are half a pixel outside the outermost pixel centres. MuJoCo
/// derives the width from the height by the viewport's aspect, hence fx = fy.
mjvGLCamera toGlCamera(const Eigen::Isometry3d& T_world_camera, const synthetic_depth::CameraModel& camera,
                       const RenderOptions& options) {
  mjvGLCamera gl{};
  copyTo(T_world_camera.translation(), gl.pos);
  copyTo(T_world_camera.linear().col(2), gl.forward);
  copyTo(-T_world_camera.linear().col(1), gl.up);
  const double near_per_px = options.near_m / camera.fy_px;
  gl.frustum_center = static_cast<float>((0.5 * (camera.width_px - 1) - camera.cx_px) * near_per_px);
  gl.frustum_top = static_cast<float>((camera.cy_px + 0.5) * near_per_px);
  gl.frustum_bottom = static_cast<float>((camera.cy_px + 0.5 - camera.height_px) * near_per_px);
  gl.frustum_near = static_cast<float>(options.near_m);
  gl.frustum_far = static_cast<float>(options.far_m);
  return gl;
}

}  // namespace

std::vector<std::string> RendererConfig::validate() const {
  std::vector<std::string> problems;
  const auto requireBetween = [&problems](const char* key, int value, int low, int high, const char* unit) {
    if (value < low || value > high) {
      problems.push_back(std::string(key) + " = " + std::to_string(value) + unit + ", must be in [" +
                         std::to_string(low) + ", " + std::to_string(high) + "]" + unit);
    }
  };
  requireBetween("max_width_px", max_width_px, 1, 8192, " px");
  requireBetween("max_height_px", max_height_px, 1, 8192, " px");
  requireBetween("samples", samples, 0, 16, "");
  requireBetween("shadow_map_px", shadow_map_px, 1, 16384, " px");
  requireBetween("quads_per_edge", quads_per_edge, 1, 64, "");
  return problems;
}

std::vector<std::string> RenderOptions::validate() const {
  if (near_m > 0.0 && far_m > near_m && std::isfinite(far_m)) {
    return {};
  }
  return {"near_m = " + std::to_string(near_m) + " m, far_m = " + std::to_string(far_m) +
          " m, must be 0 < near_m < far_m, finite"};
}

class OffscreenRenderer::Context {
 public:
  Context(const mjModel& model, const RendererConfig& config) {
    installErrorHandlers();
    mjr_defaultContext(&context_);
    mjv_defaultScene(&scene_);
    // Checked here because MuJoCo 2.2 compares with another number than the size of its table.
    constexpr int kMaxTextures = static_cast<int>(std::size(mjrContext{}.texture));
    if (model.ntex > kMaxTextures) {
      throw std::invalid_argument("off-screen rendering: ntex = " + std::to_string(model.ntex) +
                                  " textures in the model, must be <= " + std::to_string(kMaxTextures));
    }
    mjModel sized = model;  // the arrays stay the model's own
    sized.vis.global.offwidth = config.max_width_px;
    sized.vis.global.offheight = config.max_height_px;
    sized.vis.quality.offsamples = config.samples;
    sized.vis.quality.shadowsize = config.shadow_map_px;
    sized.vis.quality.numquads = config.quads_per_edge;
    try {
      mjr_makeContext(&sized, &context_, mjFONTSCALE_100);
      mjr_setBuffer(mjFB_OFFSCREEN, &context_);
      if (context_.currentBuffer != mjFB_OFFSCREEN) {
        throw std::runtime_error("off-screen rendering: MuJoCo has no off-screen buffer of " +
                                 std::to_string(config.max_width_px) + " x " + std::to_string(config.max_height_px) +
                                 " px");
      }
      constexpr int kOtherGeoms = 100;  // lights, sites and the like
      mjv_makeScene(&model, &scene_, model.ngeom + kOtherGeoms);
    } catch (...) {
      free();
      throw;
    }
  }

  ~Context() {
    try {
      egl_.makeCurrent();
      free();
    } catch (const std::exception&) {
      mjv_freeScene(&scene_);  // another thread: what is in the graphics context goes with the context
    }
  }

  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  /// With `shows_ids`, colours are the numbers of the scene's geoms.
  void draw(const mjModel& model, const mjData& data, const mjvGLCamera& camera, const mjrRect& viewport,
            const RenderOptions& options, bool shows_ids = false) {
    egl_.makeCurrent();
    mjvOption visible;
    mjv_defaultOption(&visible);
    for (std::size_t group = 0; group < options.shows_geom_group.size(); ++group) {
      visible.geomgroup[group] = options.shows_geom_group[group] ? 1 : 0;
    }
    for (mjtByte* const group : {visible.sitegroup, visible.jointgroup, visible.tendongroup, visible.actuatorgroup}) {
      std::fill_n(group, mjNGROUP, mjtByte{0});
    }
    mjvCamera any_camera;  // replaced below: MuJoCo's own cameras have no principal point
    mjv_defaultFreeCamera(&model, &any_camera);
    setCamera(camera);  // endless planes are laid around it
    mjv_updateScene(&model, const_cast<mjData*>(&data), &visible, nullptr, &any_camera, mjCAT_STATIC | mjCAT_DYNAMIC,
                    &scene_);
    setCamera(camera);
    for (int i = 0; i < scene_.nlight; ++i) {
      if (scene_.lights[i].headlight != 0) {
        std::copy_n(camera.pos, 3, scene_.lights[i].pos);
        std::copy_n(camera.forward, 3, scene_.lights[i].dir);
      }
    }
    std::fill_n(scene_.flags, mjNRNDFLAG, mjtByte{0});
    scene_.flags[mjRND_SHADOW] = options.has_shadows ? 1 : 0;
    scene_.flags[mjRND_REFLECTION] = options.has_reflections ? 1 : 0;
    scene_.flags[mjRND_SKYBOX] = options.has_skybox ? 1 : 0;
    scene_.flags[mjRND_CULL_FACE] = 1;
    scene_.flags[mjRND_SEGMENT] = shows_ids ? 1 : 0;
    scene_.flags[mjRND_IDCOLOR] = shows_ids ? 1 : 0;
    mjr_render(viewport, &scene_, &context_);
  }

  /// Colours and depth [m] of what was drawn last.
  void read(const mjrRect& viewport, const RenderOptions& options, cv::Mat* rgb, cv::Mat* depth_m) {
    if (rgb != nullptr) {
      rgb_upwards_.create(viewport.height, viewport.width, CV_8UC3);
    }
    if (depth_m != nullptr) {
      window_depth_upwards_.create(viewport.height, viewport.width, CV_32FC1);
    }
    mjr_readPixels(rgb != nullptr ? rgb_upwards_.data : nullptr,
                   depth_m != nullptr ? window_depth_upwards_.ptr<float>() : nullptr, viewport, &context_);
    if (rgb != nullptr) {
      cv::flip(rgb_upwards_, *rgb, 0);
    }
    if (depth_m != nullptr) {
      depth_m->create(viewport.height, viewport.width, CV_32FC1);
      // Window depth (0 at the near plane, 1 at the far one) of a perspective projection solved for z; in double, because
      // 1 - d loses the bits that matter.
      const double slope = 1.0 - options.near_m / options.far_m;
      for (int v = 0; v < depth_m->rows; ++v) {
        const float* const from = window_depth_upwards_.ptr<float>(depth_m->rows - 1 - v);
        float* const to = depth_m->ptr<float>(v);
        for (int u = 0; u < depth_m->cols; ++u) {
          const double d = from[u];
          to[u] =
              d < 1.0 ? static_cast<float>(options.near_m / (1.0 - d * slope)) : std::numeric_limits<float>::infinity();
        }
      }
    }
  }

  /// Geoms of what was drawn last with ids.
  void readIds(const mjrRect& viewport, cv::Mat* geom_ids) {
    std::vector<int> geom_of_segment(static_cast<std::size_t>(scene_.ngeom) + 1, -1);  // 0 is the background
    for (int i = 0; i < scene_.ngeom; ++i) {
      const mjvGeom& geom = scene_.geoms[i];
      if (geom.objtype != mjOBJ_GEOM || geom.segid < 0) {
        continue;
      }
      geom_of_segment.at(static_cast<std::size_t>(geom.segid) + 1) = geom.objid;
    }
    rgb_upwards_.create(viewport.height, viewport.width, CV_8UC3);
    mjr_readPixels(rgb_upwards_.data, nullptr, viewport, &context_);
    geom_ids->create(viewport.height, viewport.width, CV_32SC1);
    for (int v = 0; v < geom_ids->rows; ++v) {
      const auto* const from = rgb_upwards_.ptr<cv::Vec3b>(geom_ids->rows - 1 - v);
      int* const to = geom_ids->ptr<int>(v);
      for (int u = 0; u < geom_ids->cols; ++u) {
        // segid + 1, lowest byte in red.
        to[u] = geom_of_segment.at(from[u][0] + 256U * from[u][1] + 65536U * from[u][2]);
      }
    }
  }

 private:
  void setCamera(const mjvGLCamera& camera) { scene_.camera[0] = scene_.camera[1] = camera; }

  void free() {
    mjv_freeScene(&scene_);
    mjr_freeContext(&context_);
  }

  EglContext egl_;  // first: it must be current while the others are made and freed
  mjrContext context_{};
  mjvScene scene_{};
  cv::Mat rgb_upwards_;  // OpenGL's rows begin at the bottom; kept to save the system's zeroing of new pages
  cv::Mat window_depth_upwards_;
};

OffscreenRenderer::OffscreenRenderer(const mjModel& model, const RendererConfig& config)
    : model_(model), config_(config) {
  interactive_mapping::refuseIfAny("off-screen rendering:", config.validate());
  context_ = std::make_unique<Context>(model, config);
}

OffscreenRenderer::~OffscreenRenderer() = default;

void OffscreenRenderer::requireDrawable(const synthetic_depth::CameraModel& camera,
                                        const RenderOptions& options) const {
  std::vector<std::string> problems = options.validate();
  if (camera.width_px < 1 || camera.width_px > config_.max_width_px || camera.height_px < 1 ||
      camera.height_px > config_.max_height_px) {
    problems.push_back("image = " + std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px) +
                       " px, must be in [1, " + std::to_string(config_.max_width_px) + "] x [1, " +
                       std::to_string(config_.max_height_px) + "] px");
  }
  if (!(camera.fx_px > 0.0) || !(std::abs(camera.fx_px - camera.fy_px) <= 1e-6 * camera.fx_px)) {
    problems.push_back("fx_px = " + std::to_string(camera.fx_px) + " px, fy_px = " + std::to_string(camera.fy_px) +
                       " px, must be equal and > 0 px");
  }
  interactive_mapping::refuseIfAny("off-screen rendering:", problems);
}

void OffscreenRenderer::render(const mjData& data, const Eigen::Isometry3d& T_world_camera,
                               const synthetic_depth::CameraModel& camera, const RenderOptions& options, cv::Mat* rgb,
                               cv::Mat* depth_m) {
  requireDrawable(camera, options);
  const mjrRect viewport{0, 0, camera.width_px, camera.height_px};
  context_->draw(model_, data, toGlCamera(T_world_camera, camera, options), viewport, options);
  context_->read(viewport, options, rgb, depth_m);
}

void OffscreenRenderer::segmentation(const mjData& data, const Eigen::Isometry3d& T_world_camera,
                                     const synthetic_depth::CameraModel& camera, const RenderOptions& options,
                                     cv::Mat* geom_ids) {
  requireDrawable(camera, options);
  if (config_.samples > 1) {
    interactive_mapping::refuseIfAny("segmentation:",
                                     {"samples = " + std::to_string(config_.samples) + ", must be 0 or 1"});
  }
  const mjrRect viewport{0, 0, camera.width_px, camera.height_px};
  RenderOptions plain = options;
  plain.has_shadows = plain.has_reflections = plain.has_skybox = false;  // colours are numbers
  context_->draw(model_, data, toGlCamera(T_world_camera, camera, plain), viewport, plain, true);
  context_->readIds(viewport, geom_ids);
}

}  // namespace simulated_world
