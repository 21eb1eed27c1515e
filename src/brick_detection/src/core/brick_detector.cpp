// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_detector.h"

#include <algorithm>
#include <stdexcept>

#include <interactive_mapping_common/stopwatch.h>
#include <opencv2/imgproc.hpp>

namespace brick_detection {
namespace {

namespace description = mp700_ur5e_description;

/// The one family that neither libapriltag nor OpenCV decodes.
constexpr char kAlvar[] = "ALVAR_5X5";

/// What the map said of a brick holds while its pose is still that well known: half the sampling of its inside.
constexpr double kSamePlace_m = 0.02;
constexpr double kSamePlace_rad = 0.1;

std::unique_ptr<TagDetector> makeDetector(const std::string& family, TagDetectorConfig config) {
  if (family == kAlvar) return nullptr;
  config.family = family;
  return makeTagDetector(config);
}

bool isSamePlace(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d T = a.inverse() * b;
  return T.translation().norm() < kSamePlace_m && Eigen::AngleAxisd(T.linear()).angle() < kSamePlace_rad;
}

}  // namespace

BrickDetector::BrickDetector(const description::BrickCatalogue& catalogue, const BrickDetectionConfig& config)
    : config_(interactive_mapping::requireValid("impossible settings:", config)),
      detector_(makeDetector(catalogue.tags.family, config.detector)),
      estimator_(catalogue, config.pose),
      tracker_(catalogue, config.tracker) {}

BrickDetector::Look BrickDetector::look(const cv::Mat& image, const cv::Mat& depth_m, const CameraModel& camera,
                                        const Eigen::Isometry3d& T_map_camera, double stamp_s) {
  if (!detector_) {
    throw std::invalid_argument("tags of family " + catalogue().tags.family + " are not decoded here");
  }
  if (image.type() != CV_8UC1 && image.type() != CV_8UC3) {
    throw std::invalid_argument("image is of OpenCV type " + std::to_string(image.type()) +
                                ", must be CV_8UC1 or CV_8UC3");
  }
  Look look;
  interactive_mapping::Stopwatch stopwatch;
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const std::vector<TagObservation> tags = detector_->detect(grey);
  look.detect_ms = stopwatch.lapMs();
  look.found = estimator_.estimate(tags, camera, depth_m, grey);
  look.has_depth = !depth_m.empty();
  look.pose_ms = stopwatch.lapMs();
  track(T_map_camera, stamp_s, &look);
  look.track_ms = stopwatch.lapMs();
  return look;
}

BrickDetector::Look BrickDetector::addMarkers(const std::vector<MarkerObservation>& markers,
                                              const Eigen::Isometry3d& T_map_camera, double stamp_s) {
  Look look;
  interactive_mapping::Stopwatch stopwatch;
  look.found = sightingsOfMarkers(markers, catalogue(), config_.alvar);
  look.pose_ms = stopwatch.lapMs();
  track(T_map_camera, stamp_s, &look);
  look.track_ms = stopwatch.lapMs();
  return look;
}

void BrickDetector::track(const Eigen::Isometry3d& T_map_camera, double stamp_s, Look* look) {
  look->seen = tracker_.addLook(stamp_s, T_map_camera, look->found.bricks);
}

const description::BrickType& BrickDetector::typeOf(const TrackedBrick& brick) const {
  return catalogue().typeOf(brick.id);
}

std::vector<FaceAccess> BrickDetector::graspableFaces(std::size_t index) const {
  const TrackedBrick& brick = bricks().at(index);
  std::vector<BrickBox> others;
  for (std::size_t i = 0; i < bricks().size(); ++i) {
    if (i != index) others.push_back({bricks()[i].T_map_brick, typeOf(bricks()[i]).size_m});
  }
  const auto found = approaches_.find({brick.id, brick.instance});
  if (found == approaches_.end() || !isSamePlace(found->second.T_map_brick, brick.T_map_brick)) {
    return brick_detection::graspableFaces(brick.T_map_brick, typeOf(brick), others, nullptr, config_.access);
  }
  // At the pose that was asked about, so that the same faces are gone through in the same order.
  const Approach& approach = found->second;
  std::size_t next = 0;
  std::vector<FaceAccess> faces = brick_detection::graspableFaces(
      approach.T_map_brick, typeOf(brick), others,
      [&](const Eigen::Matrix3Xd& points) {
        const auto begin = approach.states.begin() + static_cast<std::ptrdiff_t>(next);
        next += static_cast<std::size_t>(points.cols());
        return std::vector<SpaceState>(begin, approach.states.begin() + static_cast<std::ptrdiff_t>(next));
      },
      config_.access);
  for (FaceAccess& face : faces) face.T_map_plate = brick.T_map_brick * description::tagPose(typeOf(brick), face.face);
  return faces;
}

BrickDetector::MapQuestion BrickDetector::mapQuestion() const {
  MapQuestion question;
  std::vector<Eigen::Matrix3Xd> parts = tracker_.insidePoints();
  Eigen::Index num_points = 0;
  for (std::size_t i = 0; i < bricks().size(); ++i) {
    const TrackedBrick& brick = bricks()[i];
    MapQuestion::OfBrick of_brick;
    of_brick.id = brick.id;
    of_brick.instance = brick.instance;
    of_brick.T_map_brick = brick.T_map_brick;
    of_brick.num_inside = static_cast<std::size_t>(parts[i].cols());
    // What it asks is what it will be told.
    const auto note = [&](const Eigen::Matrix3Xd& points) {
      Eigen::Matrix3Xd joined(3, parts[i].cols() + points.cols());
      joined << parts[i], points;
      parts[i] = joined;
      return std::vector<SpaceState>(static_cast<std::size_t>(points.cols()), SpaceState::kUnknown);
    };
    brick_detection::graspableFaces(brick.T_map_brick, typeOf(brick), {}, note, config_.access);
    of_brick.num_approach = static_cast<std::size_t>(parts[i].cols()) - of_brick.num_inside;
    num_points += parts[i].cols();
    question.bricks.push_back(of_brick);
  }
  question.points_map.resize(3, num_points);
  Eigen::Index column = 0;
  for (const Eigen::Matrix3Xd& part : parts) {
    question.points_map.middleCols(column, part.cols()) = part;
    column += part.cols();
  }
  return question;
}

std::vector<int> BrickDetector::takeMapAnswer(const MapQuestion& question, const std::vector<SpaceState>& states,
                                              double map_stamp_s) {
  if (states.size() != static_cast<std::size_t>(question.points_map.cols())) {
    throw std::invalid_argument(std::to_string(states.size()) + " states, must be one for each of " +
                                std::to_string(question.points_map.cols()) + " points");
  }
  std::vector<double> free_share(bricks().size(), 0.0);
  approaches_.clear();
  auto state = states.begin();
  for (const MapQuestion::OfBrick& asked : question.bricks) {
    const auto inside_end = state + static_cast<std::ptrdiff_t>(asked.num_inside);
    const auto end = inside_end + static_cast<std::ptrdiff_t>(asked.num_approach);
    const auto found = std::find_if(bricks().begin(), bricks().end(), [&](const TrackedBrick& brick) {
      return brick.id == asked.id && brick.instance == asked.instance &&
             isSamePlace(brick.T_map_brick, asked.T_map_brick);
    });
    if (found != bricks().end() && asked.num_inside > 0) {
      free_share[static_cast<std::size_t>(found - bricks().begin())] =
          static_cast<double>(std::count(state, inside_end, SpaceState::kFree)) / static_cast<double>(asked.num_inside);
      approaches_[{asked.id, asked.instance}] = {asked.T_map_brick, std::vector<SpaceState>(inside_end, end)};
    }
    state = end;
  }
  return tracker_.dropFree(free_share, map_stamp_s);
}

void BrickDetector::clear() {
  tracker_.clear();
  approaches_.clear();
}

}  // namespace brick_detection
