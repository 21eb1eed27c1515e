// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>

#include "brick_detection/brick_detection_config.h"
#include "brick_detection/camera_model.h"

namespace brick_detection {

/// From images to bricks in the map: decodes tags, finds poses, follows bricks over time, asks the map. Not thread-safe.
class BrickDetector {
 public:
  struct Look {
    BrickPoseEstimator::Result found;
    /// For each of found.bricks its place in bricks(); none: held back, as it may have moved.
    std::vector<std::optional<std::size_t>> seen;
    bool has_depth{false};
    double detect_ms{0.0};
    double pose_ms{0.0};
    double track_ms{0.0};
  };

  /// What to ask the map, and what for.
  struct MapQuestion {
    Eigen::Matrix3Xd points_map;  ///< [m]

   private:
    friend class BrickDetector;
    struct OfBrick {
      int id{0};
      int instance{0};
      Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
      std::size_t num_inside{0};
      std::size_t num_approach{0};
    };
    std::vector<OfBrick> bricks;
  };

  /// Throws std::invalid_argument listing what is wrong with the config.
  BrickDetector(const mp700_ur5e_description::BrickCatalogue& catalogue, const BrickDetectionConfig& config);

  /// False for a family of tags that another program decodes: look() is of no use then, but addMarkers() is.
  bool decodesImages() const { return detector_ != nullptr; }

  /// Takes in one image. `image`: CV_8UC1 or CV_8UC3 (blue, green, red); `depth_m`: as fitDepthPlane() has it, of the
  /// camera's size; may be empty. Throws std::invalid_argument for bad arguments, and then nothing has changed.
  Look look(const cv::Mat& image, const cv::Mat& depth_m, const CameraModel& camera,
            const Eigen::Isometry3d& T_map_camera, double stamp_s);

  /// Takes in what another program has found in one image.
  Look addMarkers(const std::vector<MarkerObservation>& markers, const Eigen::Isometry3d& T_map_camera, double stamp_s);

  /// In order of id and instance.
  const std::vector<TrackedBrick>& bricks() const { return tracker_.bricks(); }

  /// Of bricks()[index], with all others as obstacles and by the map's answer about where it is now, if there was one.
  std::vector<FaceAccess> graspableFaces(std::size_t index) const;

  /// About all bricks. The answer may be taken in later, when other looks have come: it then counts for those bricks
  /// that are still where they were.
  MapQuestion mapQuestion() const;

  /// `states`: of points_map. Drops bricks whose place is free, remembers the ways to faces. Returns the dropped ids.
  /// Throws std::invalid_argument unless there is a state for each point.
  std::vector<int> takeMapAnswer(const MapQuestion& question, const std::vector<SpaceState>& states,
                                 double map_stamp_s);

  /// As BrickTracker has them.
  bool attach(int id, const Eigen::Vector3d& p_map) { return tracker_.attach(id, p_map); }
  void detach(double stamp_s) { tracker_.detach(stamp_s); }
  /// Forgets all bricks and the time. What is in the hand stays there.
  void clear();

  /// Forgets what the map has answered: faces are ranked by neighbours alone until it answers again.
  void forgetMap() { approaches_.clear(); }

  const mp700_ur5e_description::BrickCatalogue& catalogue() const { return estimator_.catalogue(); }
  const BrickDetectionConfig& config() const { return config_; }

 private:
  /// The ways to the faces of a brick, as the map knew them when it was asked.
  struct Approach {
    Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
    std::vector<SpaceState> states;
  };

  void track(const Eigen::Isometry3d& T_map_camera, double stamp_s, Look* look);
  const mp700_ur5e_description::BrickType& typeOf(const TrackedBrick& brick) const;

  BrickDetectionConfig config_;
  std::unique_ptr<TagDetector> detector_;
  BrickPoseEstimator estimator_;
  BrickTracker tracker_;
  std::map<std::pair<int, int>, Approach> approaches_;  // by id and instance
};

}  // namespace brick_detection
