// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include <opencv2/calib3d.hpp>

#include "brick_detection/brick_pose.h"
#include "rotation.h"

namespace brick_detection {
namespace {

// Two starts that end this close together have found the same minimum: refinePose() stops at steps far below.
constexpr double kPlain_px = 1.0;  // residuals far below it: plain least squares

/// The square as a tag's printed side is seen: convex and going round clockwise (y down).
bool isClockwise(const PoseProblem& problem) {
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d a = problem.points[(i + 1) % 4].bearing - problem.points[i].bearing;
    const Eigen::Vector2d b = problem.points[(i + 2) % 4].bearing - problem.points[(i + 1) % 4].bearing;
    // A sine below 1e-3 is no corner; IPPE divides by it.
    if (!(cross(a, b) > 1e-3 * a.norm() * b.norm())) return false;
  }
  return true;
}

}  // namespace

std::array<Eigen::Vector3d, 4> tagCorners(double edge_m) {
  const double h = 0.5 * edge_m;
  return {{{-h, h, 0.0}, {h, h, 0.0}, {h, -h, 0.0}, {-h, -h, 0.0}}};
}

std::vector<TagPose> tagPoses(const std::array<Eigen::Vector2d, 4>& corners_px, double edge_m,
                              const CameraModel& camera) {
  if (!(edge_m > 0.0) || !std::isfinite(edge_m)) {
    throw std::invalid_argument("edge_m = " + std::to_string(edge_m) + " m, must be positive");
  }
  PoseProblem problem;
  const std::array<Eigen::Vector3d, 4> corners_tag = tagCorners(edge_m);  // the order that IPPE_SQUARE demands
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::optional<PointMeasurement> point = measurePoint(corners_tag[i], corners_px[i], camera, kPlain_px);
    if (!point) return {};
    problem.points.push_back(*point);
    object.emplace_back(corners_tag[i].x(), corners_tag[i].y(), 0.0);
    image.emplace_back(point->bearing.x(), point->bearing.y());
  }
  if (!isClockwise(problem)) return {};

  std::vector<cv::Mat> turns;
  std::vector<cv::Mat> shifts;
  cv::solvePnPGeneric(object, image, cv::Matx33d::eye(), cv::noArray(), turns, shifts, false, cv::SOLVEPNP_IPPE_SQUARE);
  std::vector<Eigen::Isometry3d> starts;
  for (std::size_t i = 0; i < turns.size(); ++i) {
    const Eigen::Vector3d turn(turns[i].at<double>(0), turns[i].at<double>(1), turns[i].at<double>(2));
    Vector6d step;
    step << shifts[i].at<double>(0), shifts[i].at<double>(1), shifts[i].at<double>(2), turn;
    if (!step.allFinite()) continue;
    const Eigen::Isometry3d pose = moved(Eigen::Isometry3d::Identity(), step);
    starts.push_back(pose);
    // For a square parallel to the image OpenCV's two poses may be one and the same. The other is the normal's mirror
    // image about the line of sight.
    const Eigen::Vector3d normal = pose.linear().col(2);
    const Eigen::Vector3d to_camera = -pose.translation().normalized();
    Eigen::Isometry3d mirrored = pose;
    mirrored.linear() = Eigen::Quaterniond::FromTwoVectors(normal, 2.0 * normal.dot(to_camera) * to_camera - normal)
                            .toRotationMatrix() *
                        pose.linear();
    starts.push_back(mirrored);
  }
  std::vector<TagPose> poses;
  for (const Eigen::Isometry3d& start : starts) {
    // IPPE's poses fit the square's homography; those that fit its corners are next to them.
    const std::optional<RefinedPose> refined = refinePose(problem, start);
    if (!refined) continue;
    const Eigen::Isometry3d& T_camera_tag = refined->T_camera_body;
    if (T_camera_tag.linear().col(2).dot(T_camera_tag.translation()) >= 0.0) continue;  // seen from behind
    const bool is_known = std::any_of(poses.begin(), poses.end(), [&T_camera_tag](const TagPose& other) {
      return stepBetween(other.T_camera_tag, T_camera_tag).tail<3>().norm() < kSameTurn_rad;
    });
    if (is_known) continue;
    double sum_squares = 0.0;
    for (const PointMeasurement& point : problem.points) {
      sum_squares += pointResidual(point, T_camera_tag).squaredNorm();
    }
    poses.push_back({T_camera_tag, std::sqrt(sum_squares / 4.0)});
  }
  std::sort(poses.begin(), poses.end(),
            [](const TagPose& a, const TagPose& b) { return a.reprojection_rms_px < b.reprojection_rms_px; });
  if (poses.size() > 2) poses.resize(2);
  return poses;
}

}  // namespace brick_detection
