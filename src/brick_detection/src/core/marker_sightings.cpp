// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/marker_sightings.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

#include "brick_detection/pose_refinement.h"
#include "rotation.h"

namespace brick_detection {
namespace {

namespace description = mp700_ur5e_description;

struct Member {
  Eigen::Isometry3d T_camera_brick{Eigen::Isometry3d::Identity()};
  Matrix6d information{Matrix6d::Identity()};
  int tag_id{0};
  description::BrickFace face{description::BrickFace::kPlusX};
};
using Members = std::vector<Member>;  // of one brick

bool isPose(const Eigen::Isometry3d& T) {
  return T.matrix().allFinite() &&
         (T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3 &&
         T.linear().determinant() > 0.0;
}

/// Error of the brick's pose from that of the marker's: its middle lies at the end of a lever.
Matrix6d brickCovariance(const Eigen::Isometry3d& T_camera_tag, const Eigen::Isometry3d& T_camera_brick,
                         const MarkerConfig& config) {
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -skew(T_camera_brick.translation() - T_camera_tag.translation());
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(config.position_std_m * config.position_std_m),
      Eigen::Vector3d::Constant(config.rotation_std_rad * config.rotation_std_rad);
  return J * variance.asDiagonal() * J.transpose();
}

/// Mean weighted by information, in the tangent space at the first member.
BrickSighting fuse(int brick_id, const Members& group) {
  BrickSighting brick;
  brick.brick_id = brick_id;
  const Eigen::Isometry3d& T_first = group.front().T_camera_brick;
  Matrix6d information = Matrix6d::Zero();
  Vector6d weighted = Vector6d::Zero();
  for (const Member& member : group) {
    information += member.information;
    weighted += member.information * stepBetween(T_first, member.T_camera_brick);
    brick.faces.push_back(member.face);
  }
  brick.covariance = information.inverse();
  brick.T_camera_brick = moved(T_first, brick.covariance * weighted);
  std::sort(brick.faces.begin(), brick.faces.end());
  return brick;
}

}  // namespace

BrickPoseEstimator::Result sightingsOfMarkers(const std::vector<MarkerObservation>& markers,
                                              const description::BrickCatalogue& catalogue,
                                              const MarkerConfig& config) {
  interactive_mapping::requireValid("impossible markers:", config);

  BrickPoseEstimator::Result result;
  std::map<int, std::vector<Members>> groups;  // by the brick's id
  for (const MarkerObservation& marker : markers) {
    TagSighting sighting;
    sighting.tag.id = marker.id;
    sighting.tag.corners_px.fill(Eigen::Vector2d::Zero());
    const std::optional<description::BrickTag> tag = catalogue.brickOfTag(marker.id);
    if (tag) {
      sighting.brick_id = tag->brick_id;
      sighting.face = tag->face;
    }
    sighting.status = !tag                           ? TagStatus::kUnknownId
                      : !isPose(marker.T_camera_tag) ? TagStatus::kInconsistent
                                                     : TagStatus::kUsed;
    result.tags.push_back(sighting);
    if (sighting.status != TagStatus::kUsed) continue;

    Member member;
    member.T_camera_brick = marker.T_camera_tag * tag->T_brick_tag.inverse();
    member.information = brickCovariance(marker.T_camera_tag, member.T_camera_brick, config).inverse();
    member.tag_id = marker.id;
    member.face = tag->face;
    Members* nearest = nullptr;
    double nearest_m = std::numeric_limits<double>::infinity();
    for (Members& group : groups[tag->brick_id]) {
      const bool has_this_tag =
          std::any_of(group.begin(), group.end(), [&](const Member& other) { return other.tag_id == marker.id; });
      const Eigen::Isometry3d T = group.front().T_camera_brick.inverse() * member.T_camera_brick;
      const double distance_m = T.translation().norm();
      if (has_this_tag || distance_m > config.same_brick_m || distance_m >= nearest_m ||
          rotationVector(T.linear()).norm() > config.same_brick_rad) {
        continue;
      }
      nearest = &group;
      nearest_m = distance_m;
    }
    if (nearest == nullptr) {
      groups[tag->brick_id].push_back({member});
    } else {
      nearest->push_back(member);
    }
  }
  for (const auto& [brick_id, of_brick] : groups) {
    for (const Members& group : of_brick) {
      BrickSighting brick = fuse(brick_id, group);
      brick.has_duplicate = of_brick.size() > 1;
      result.bricks.push_back(brick);
    }
  }
  return result;
}

}  // namespace brick_detection
