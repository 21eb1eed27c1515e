// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/face_access.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace brick_detection {

namespace description = mp700_ur5e_description;

Eigen::Matrix3Xd approachPoints(const Eigen::Isometry3d& T_map_plate, const FaceAccessConfig& config) {
  // A square grid cut to the circle, in layers; both ends of the way belong to it.
  const int half = static_cast<int>(std::floor(config.tool_radius_m / config.sample_m + 1e-9));
  const int layers = std::max(1, static_cast<int>(std::lround(config.corridor_m / config.sample_m)));
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k <= layers; ++k) {
    const double z = config.gap_m + config.corridor_m * k / layers;
    for (int i = -half; i <= half; ++i) {
      for (int j = -half; j <= half; ++j) {
        const Eigen::Vector2d xy = config.sample_m * Eigen::Vector2d(i, j);
        if (xy.norm() > config.tool_radius_m + 1e-9) continue;
        points.emplace_back(T_map_plate * Eigen::Vector3d(xy.x(), xy.y(), z));
      }
    }
  }
  Eigen::Matrix3Xd result(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) result.col(static_cast<Eigen::Index>(i)) = points[i];
  return result;
}

std::vector<FaceAccess> graspableFaces(const Eigen::Isometry3d& T_map_brick, const description::BrickType& type,
                                       const std::vector<BrickBox>& others,
                                       const std::function<std::vector<SpaceState>(const Eigen::Matrix3Xd&)>& state,
                                       const FaceAccessConfig& config) {
  interactive_mapping::requireValid("impossible access:", config);

  struct Box {
    Eigen::Isometry3d T_box_map;
    Eigen::Array3d half_size_m;
  };
  std::vector<Box> boxes;
  for (const BrickBox& other : others) boxes.push_back({other.T_map_brick.inverse(), 0.5 * other.size_m.array()});

  std::vector<FaceAccess> faces;
  for (const description::BrickFace face : description::kBrickFaces) {
    if (std::count(type.plate_faces.begin(), type.plate_faces.end(), face) == 0) continue;
    FaceAccess access;
    access.face = face;
    access.T_map_plate = T_map_brick * description::tagPose(type, face);
    const double upward = access.T_map_plate.linear()(2, 2);
    if (upward < -std::sin(config.max_down_rad)) continue;

    const Eigen::Matrix3Xd points = approachPoints(access.T_map_plate, config);
    std::vector<SpaceState> states(static_cast<std::size_t>(points.cols()), SpaceState::kUnknown);
    if (state) {
      states = state(points);
      if (states.size() != static_cast<std::size_t>(points.cols())) {
        throw std::invalid_argument("state() gave " + std::to_string(states.size()) +
                                    " answers, must be one for each of " + std::to_string(points.cols()) + " points");
      }
    }
    int num_free = 0;
    int num_unknown = 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const bool is_in_brick = std::any_of(boxes.begin(), boxes.end(), [&](const Box& box) {
        return ((box.T_box_map * points.col(i)).cwiseAbs().array() <= box.half_size_m).all();
      });
      if (is_in_brick) continue;
      num_free += states[static_cast<std::size_t>(i)] == SpaceState::kFree ? 1 : 0;
      num_unknown += states[static_cast<std::size_t>(i)] == SpaceState::kUnknown ? 1 : 0;
    }
    access.free_share = num_free / static_cast<double>(points.cols());
    access.unknown_share = num_unknown / static_cast<double>(points.cols());
    const double clear = access.free_share + config.unknown_weight * access.unknown_share;
    // Nothing known to be in the way is not yet a clear way, but with no map at all it is the best there is.
    const double least = state ? config.min_clear : config.min_clear * config.unknown_weight;
    if (clear < least) continue;
    access.accessibility = clear * 0.5 * (1.0 + upward);
    if (access.accessibility > 0.0) faces.push_back(access);
  }
  // Turning a brick by a hair must not change the order of what is equal.
  constexpr double kEqual = 1e-6;
  std::stable_sort(faces.begin(), faces.end(), [](const FaceAccess& a, const FaceAccess& b) {
    return std::round(a.accessibility / kEqual) > std::round(b.accessibility / kEqual);
  });
  return faces;
}

}  // namespace brick_detection
