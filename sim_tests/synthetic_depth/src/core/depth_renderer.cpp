// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/depth_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace synthetic_depth {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kTile_px = 16;
// Tiles reach beyond the image: jittered rays and the second viewpoint's pixels lie outside it.
constexpr int kTileMargin_px = 64;
// A corner nearer than this to the image plane has no useful projection; such a box is put into every tile.
constexpr double kNearestProjection_m = 1e-3;

/// Entry of the ray o + t d into |x| <= h; +Inf if it misses, or if it starts inside.
inline double entryDistance(const Eigen::Vector3d& o, const Eigen::Vector3d& d, const Eigen::Vector3d& h) {
  double t_enter = -kInfinity;
  double t_leave = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) < 1e-15) {
      if (std::abs(o[axis]) > h[axis]) {
        return kInfinity;
      }
      continue;
    }
    const double inverse = 1.0 / d[axis];
    const double t_centre = -o[axis] * inverse;
    const double t_half = h[axis] * std::abs(inverse);
    t_enter = std::max(t_enter, t_centre - t_half);
    t_leave = std::min(t_leave, t_centre + t_half);
  }
  return t_enter > 0.0 && t_enter <= t_leave ? t_enter : kInfinity;
}

}  // namespace

ViewCaster::ViewCaster(const Scene& scene, int frame, const Eigen::Isometry3d& T_scene_view)
    : camera_(scene.camera),
      tile_columns_((scene.camera.width_px + 2 * kTileMargin_px + kTile_px - 1) / kTile_px),
      tile_rows_((scene.camera.height_px + 2 * kTileMargin_px + kTile_px - 1) / kTile_px),
      has_ground_(scene.has_ground),
      height_over_ground_m_(T_scene_view.translation().z()),
      ground_normal_view_(T_scene_view.linear().row(2).transpose()) {
  const Eigen::Isometry3d T_view_scene = T_scene_view.inverse(Eigen::Isometry);
  struct Rectangle {
    double u_min, u_max, v_min, v_max;
  };
  std::vector<ProjectedBox> boxes;
  std::vector<Rectangle> rectangles;
  for (const Box& box : scene.boxes) {
    if (!box.isPresent(frame)) {
      continue;
    }
    const Eigen::Isometry3d T_view_box = T_view_scene * box.T_scene_box;
    Rectangle rectangle{kInfinity, -kInfinity, kInfinity, -kInfinity};
    double nearest_z = kInfinity;
    double farthest_z = -kInfinity;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d sign((corner & 1) != 0 ? 1.0 : -1.0, (corner & 2) != 0 ? 1.0 : -1.0,
                                 (corner & 4) != 0 ? 1.0 : -1.0);
      const Eigen::Vector3d p_view = T_view_box * sign.cwiseProduct(box.half_extents_m);
      nearest_z = std::min(nearest_z, p_view.z());
      farthest_z = std::max(farthest_z, p_view.z());
      const double u = camera_.fx_px * p_view.x() / p_view.z() + camera_.cx_px;
      const double v = camera_.fy_px * p_view.y() / p_view.z() + camera_.cy_px;
      rectangle = {std::min(rectangle.u_min, u), std::max(rectangle.u_max, u), std::min(rectangle.v_min, v),
                   std::max(rectangle.v_max, v)};
    }
    if (farthest_z <= 0.0) {
      continue;
    }
    if (nearest_z < kNearestProjection_m) {
      rectangle = {-kInfinity, kInfinity, -kInfinity, kInfinity};
    }
    const Eigen::Isometry3d T_box_view = T_view_box.inverse(Eigen::Isometry);
    boxes.push_back({T_box_view.linear(), T_box_view.translation(), box.half_extents_m, nearest_z, box.id});
    rectangles.push_back(rectangle);
  }

  std::vector<std::size_t> order(boxes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&boxes](std::size_t a, std::size_t b) { return boxes[a].nearest_z_m < boxes[b].nearest_z_m; });

  tiles_.resize(static_cast<std::size_t>(tile_columns_ * tile_rows_));
  const auto toTile = [](double pixel, int num_tiles) {
    const double tile = std::floor((pixel + kTileMargin_px) / kTile_px);
    return static_cast<int>(std::clamp(tile, -1.0, static_cast<double>(num_tiles)));
  };
  constexpr double kSlack_px = 0.01;  // rounding of the projected corners
  for (const std::size_t source : order) {
    const int index = static_cast<int>(boxes_.size());
    boxes_.push_back(boxes[source]);
    all_boxes_.push_back(index);
    const Rectangle& rectangle = rectangles[source];
    const int first_column = std::max(0, toTile(rectangle.u_min - kSlack_px, tile_columns_));
    const int last_column = std::min(tile_columns_ - 1, toTile(rectangle.u_max + kSlack_px, tile_columns_));
    const int first_row = std::max(0, toTile(rectangle.v_min - kSlack_px, tile_rows_));
    const int last_row = std::min(tile_rows_ - 1, toTile(rectangle.v_max + kSlack_px, tile_rows_));
    for (int row = first_row; row <= last_row; ++row) {
      for (int column = first_column; column <= last_column; ++column) {
        tiles_[static_cast<std::size_t>(row * tile_columns_ + column)].push_back(index);
      }
    }
  }
}

const std::vector<int>& ViewCaster::candidates(double u_px, double v_px) const {
  const double column = std::floor((u_px + kTileMargin_px) / kTile_px);
  const double row = std::floor((v_px + kTileMargin_px) / kTile_px);
  if (!(column >= 0.0 && column < tile_columns_ && row >= 0.0 && row < tile_rows_)) {
    return all_boxes_;
  }
  return tiles_[static_cast<std::size_t>(static_cast<int>(row) * tile_columns_ + static_cast<int>(column))];
}

ViewCaster::Hit ViewCaster::cast(double u_px, double v_px) const {
  // With the direction's z at 1, the ray parameter is the depth along the optical axis.
  const Eigen::Vector3d direction((u_px - camera_.cx_px) / camera_.fx_px, (v_px - camera_.cy_px) / camera_.fy_px, 1.0);
  Hit hit{kInfinity, kNoReturnId};
  if (has_ground_) {
    const double descent = -ground_normal_view_.dot(direction);
    if (descent > 1e-12 && height_over_ground_m_ > 0.0) {
      hit = {height_over_ground_m_ / descent, kGroundId};
    }
  }
  for (const int index : candidates(u_px, v_px)) {
    const ProjectedBox& box = boxes_[static_cast<std::size_t>(index)];
    if (box.nearest_z_m >= hit.z_m) {
      break;  // sorted by nearest corner
    }
    const double z = entryDistance(box.view_in_box, box.R_box_view * direction, box.half_extents_m);
    if (z < hit.z_m) {
      hit = {z, box.id};
    }
  }
  return hit;
}

bool ViewCaster::isVisible(const Eigen::Vector3d& p_view, double tolerance_m) const {
  if (!(p_view.z() > 0.0)) {
    return false;
  }
  const double u = camera_.fx_px * p_view.x() / p_view.z() + camera_.cx_px;
  const double v = camera_.fy_px * p_view.y() / p_view.z() + camera_.cy_px;
  return cast(u, v).z_m >= p_view.z() - tolerance_m;
}

cv::Mat renderDepth(const Scene& scene, int frame, cv::Mat* box_ids) {
  if (frame < 0 || frame >= scene.numFrames()) {
    throw std::out_of_range("renderDepth: frame = " + std::to_string(frame) + ", must be in [0, " +
                            std::to_string(scene.numFrames()) + ")");
  }
  const ViewCaster caster(scene, frame, scene.T_scene_camera[static_cast<std::size_t>(frame)]);
  cv::Mat depth_m(scene.camera.height_px, scene.camera.width_px, CV_32FC1);
  if (box_ids != nullptr) {
    box_ids->create(depth_m.rows, depth_m.cols, CV_32SC1);
  }
  for (int v = 0; v < depth_m.rows; ++v) {
    float* const depth_row = depth_m.ptr<float>(v);
    int* const id_row = box_ids != nullptr ? box_ids->ptr<int>(v) : nullptr;
    for (int u = 0; u < depth_m.cols; ++u) {
      const ViewCaster::Hit hit = caster.cast(u, v);
      depth_row[u] = static_cast<float>(hit.z_m);
      if (id_row != nullptr) {
        id_row[u] = hit.id;
      }
    }
  }
  return depth_m;
}

}  // namespace synthetic_depth
