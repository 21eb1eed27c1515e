// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_pose.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include <Eigen/Dense>

#include <interactive_mapping_common/config/schema.h>
#include "cell_fit.h"
#include "image_check.h"
#include "rotation.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickTag;

// Poses with their own uncertainty are compared at so many standard deviations.
constexpr double kSigmas = 3.0;
// Minima of one problem nearer to each other than that are one: refinePose() stops at steps far below.
constexpr double kMaxReprojection_px = 1.5;  // root mean square of a tag's corners
// Of the two poses that fit a flat square, the second may stand unless its corners fit worse than the first's by this
// chi-square (one degree of freedom): below it, depth or another tag must decide.
constexpr double kAmbiguityChi2 = 15.0;
// Between a tag and its depth plane, in distance and normal: standard deviations of the plane, systematic parts and what
// the corners leave open included. The final pose is held to the plane's own.
constexpr double kMaxDepthSigmas = 4.0;
// Of a tag's area that is neither black nor white where it should be.
constexpr double kMostDamaged = 0.15;

/// A tag that passed the gates, as a measurement of its brick.
struct Candidate {
  std::size_t index{0};  ///< in the tags given
  int tag_id{0};
  double side_px{0.0};
  BrickTag tag;
  std::vector<PointMeasurement> corners;  ///< body: the brick
  std::optional<PlaneMeasurement> plane;
  std::vector<RefinedPose> hypotheses;  ///< T_camera_brick by the corners alone, best first
};

/// Tags taken for one brick's, and where it then is.
struct Group {
  std::vector<const Candidate*> members;
  RefinedPose pose;
  std::vector<Eigen::Vector3d> possible_middles;  ///< of each pose that fits
  bool is_ambiguous{false};
};

double largestStd(const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, eigen.eigenvalues().maxCoeff()));
}

double rotationStd(const Matrix6d& covariance) {
  return largestStd(covariance.bottomRightCorner<3, 3>());
}

PoseProblem problemOf(const std::vector<const Candidate*>& members) {
  PoseProblem problem;
  for (const Candidate* member : members) {
    problem.points.insert(problem.points.end(), member->corners.begin(), member->corners.end());
    if (member->plane) problem.planes.push_back(*member->plane);
  }
  return problem;
}

double reprojectionRms(const std::vector<PointMeasurement>& points, const Eigen::Isometry3d& T_camera_brick) {
  double sum_squares = 0.0;
  for (const PointMeasurement& point : points) sum_squares += pointResidual(point, T_camera_brick).squaredNorm();
  return std::sqrt(sum_squares / static_cast<double>(points.size()));
}

/// What is left of a length in the image without what noise makes of nothing.
double beyondNoise(double length_px, double std_px) {
  constexpr double kNoiseSigmas = 2.5;  // of the largest of several
  const double noise_px = kNoiseSigmas * std_px;
  return std::sqrt(std::max(0.0, length_px * length_px - noise_px * noise_px));
}

/// Of a tag's corners, by how well its cells agree with them; nothing if they contradict each other.
std::optional<double> cornerStd(const TagObservation& tag, const CameraModel& camera, const cv::Mat& grey,
                                const BrickPoseConfig& config) {
  if (grey.empty() || tag.cells.empty()) return config.corner_std_px;
  const std::optional<CellFit> fit = fitCells(grey, camera, tag);
  if (!fit) return std::nullopt;
  double shift_px = 0.0;
  for (const Eigen::Vector2d& shift : fit->shift_px) shift_px = std::max(shift_px, shift.norm());
  // The middle goes half as far as a side that is shifted, or farther where the tag is bent.
  const double off_px =
      std::max(beyondNoise(shift_px, fit->shift_std_px), 2.0 * beyondNoise(fit->bend_px, fit->bend_std_px));
  if (!(off_px < kMaxReprojection_px) || fit->damaged_share > kMostDamaged) return std::nullopt;
  return std::hypot(config.corner_std_px, off_px);
}

/// Whether a pose is farther from its depth plane, in distance or normal, than the plane's own uncertainty and what
/// the pose leaves open explain. `pose_covariance` zero: of a pose that the plane took part in.
bool contradicts(const PlaneMeasurement& plane, const Eigen::Isometry3d& T_camera_brick,
                 const Matrix6d& pose_covariance, double max_sigmas) {
  Eigen::Matrix<double, 3, 6> jacobian;
  const Eigen::Vector3d residual = planeResidual(plane, T_camera_brick, &jacobian);
  const Eigen::Matrix3d covariance = plane.plane.covariance + jacobian * pose_covariance * jacobian.transpose();
  const Eigen::Vector2d tilt = residual.head<2>();
  return tilt.dot(covariance.topLeftCorner<2, 2>().ldlt().solve(tilt)) > max_sigmas * max_sigmas ||
         std::abs(residual.z()) > max_sigmas * std::sqrt(covariance(2, 2));
}

/// Whether one of a group's poses has the brick's middle near a place.
bool mayBeAt(const Group& group, const Eigen::Vector3d& p_camera, double distance_m) {
  return std::any_of(group.possible_middles.begin(), group.possible_middles.end(),
                     [&](const Eigen::Vector3d& middle) { return (middle - p_camera).norm() < distance_m; });
}

/// How far a hypothesis is from a pose in units of what one brick's poses may differ: up to 1 they are one brick's.
double disagreement(const RefinedPose& hypothesis, const Eigen::Isometry3d& T_camera_brick,
                    const BrickPoseConfig& config) {
  const Vector6d step = stepBetween(T_camera_brick, hypothesis.T_camera_body);
  const double allowed_m = config.same_brick_m + kSigmas * largestStd(hypothesis.covariance.topLeftCorner<3, 3>());
  const double allowed_rad = config.same_brick_rad + kSigmas * rotationStd(hypothesis.covariance);
  return std::max(step.head<3>().norm() / allowed_m, step.tail<3>().norm() / allowed_rad);
}

double disagreement(const Candidate& candidate, const Eigen::Isometry3d& T_camera_brick,
                    const BrickPoseConfig& config) {
  double least = std::numeric_limits<double>::infinity();
  for (const RefinedPose& hypothesis : candidate.hypotheses) {
    least = std::min(least, disagreement(hypothesis, T_camera_brick, config));
  }
  return least;
}

/// All poses that fit the members together, best first.
std::vector<RefinedPose> fits(const std::vector<const Candidate*>& members) {
  const PoseProblem problem = problemOf(members);
  std::vector<RefinedPose> found;
  for (const Candidate* member : members) {
    for (const RefinedPose& hypothesis : member->hypotheses) {
      const std::optional<RefinedPose> fit = refinePose(problem, hypothesis.T_camera_body);
      if (!fit) continue;
      const bool is_known = std::any_of(found.begin(), found.end(), [&fit](const RefinedPose& other) {
        return stepBetween(other.T_camera_body, fit->T_camera_body).tail<3>().norm() < kSameTurn_rad;
      });
      if (!is_known) found.push_back(*fit);
    }
  }
  std::sort(found.begin(), found.end(), [](const RefinedPose& a, const RefinedPose& b) { return a.cost < b.cost; });
  return found;
}

/// The tags among `open` that show the brick at a hypothesis of `first`, that one included.
std::vector<const Candidate*> gather(const std::vector<const Candidate*>& open, const Candidate* first,
                                     const RefinedPose& hypothesis, const BrickPoseConfig& config) {
  std::vector<const Candidate*> members = {first};
  std::set<int> taken = {first->tag_id};  // a brick has each of its tags once
  RefinedPose pose = hypothesis;
  while (true) {
    const Candidate* nearest = nullptr;
    double least = 1.0;
    for (const Candidate* other : open) {
      if (taken.count(other->tag_id) > 0) continue;
      const double off = disagreement(*other, pose.T_camera_body, config);
      if (off <= least) {
        nearest = other;
        least = off;
      }
    }
    if (!nearest) return members;
    members.push_back(nearest);
    taken.insert(nearest->tag_id);
    if (const auto refined = refinePose(problemOf(members), pose.T_camera_body)) pose = *refined;
  }
}

/// Of a pose by tags of one face, by how much the variance must grow. Seen from the front a tag's image hardly changes with
/// its tilt, and the information at the minimum says little of the cost away from it: it is compared with the cost's
/// true rise for tilts by one and by three of the standard deviations that it claims, in eight directions.
double flatness(const std::vector<const Candidate*>& members, const RefinedPose& pose) {
  constexpr int kDirections = 8;
  constexpr double kPinned_rad = 1e-4;  // far below any tilt that is asked about
  constexpr double kLoose_m = 100.0;
  constexpr double kLargestTilt_rad = 0.6;  // beyond it the tag would be seen as another shape in any case
  constexpr double kLeastRise = 1e-6;
  const BrickTag& tag = members.front()->tag;
  PlaneMeasurement pinned;  // holds the tilt, and leaves all else to the measurements
  pinned.p_body = tag.T_brick_tag.translation();
  pinned.n_body = tag.T_brick_tag.linear().col(2);
  const Eigen::Vector3d normal = pose.T_camera_body.linear() * pinned.n_body;
  const Eigen::Vector3d u = normal.unitOrthogonal();
  Eigen::Matrix<double, 3, 2> axes;
  axes << u, normal.cross(u);
  const Eigen::Matrix2d information = (axes.transpose() * pose.covariance.bottomRightCorner<3, 3>() * axes).inverse();
  double factor = 1.0;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = 2.0 * M_PI * i / kDirections;
    const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
    const double per_square = direction.dot(information * direction);
    for (const double sigmas : {1.0, kSigmas}) {
      const double tilt_rad = std::min(sigmas / std::sqrt(per_square), kLargestTilt_rad);
      Vector6d step = Vector6d::Zero();
      step.tail<3>() = tilt_rad * axes * direction;
      Eigen::Isometry3d tilted = moved(pose.T_camera_body, step);
      tilted.translation() += pose.T_camera_body * pinned.p_body - tilted * pinned.p_body;  // about the tag's middle
      pinned.plane.normal = tilted.linear() * pinned.n_body;
      pinned.plane.middle = tilted * pinned.p_body;
      pinned.plane.axis_u = pinned.plane.normal.unitOrthogonal();
      pinned.plane.axis_v = pinned.plane.normal.cross(pinned.plane.axis_u);
      pinned.plane.covariance =
          Eigen::Vector3d(kPinned_rad * kPinned_rad, kPinned_rad * kPinned_rad, kLoose_m * kLoose_m).asDiagonal();
      PoseProblem problem = problemOf(members);
      problem.planes.push_back(pinned);
      if (const std::optional<RefinedPose> fit = refinePose(problem, tilted)) {
        // All of the rise may be one residual's.
        const double expected = robustCost(tilt_rad * tilt_rad * per_square);
        factor = std::max(factor, expected / std::max(kLeastRise, fit->cost - pose.cost));
      }
    }
  }
  return factor;
}

/// A member of a group that its pose does not fit.
struct Misfit {
  const Candidate* member{nullptr};
  TagStatus status{TagStatus::kInconsistent};
};

/// The member whose corners are farthest off the final pose, if too far; else one whose depth plane contradicts it.
std::optional<Misfit> worstMisfit(const Group& group) {
  std::optional<Misfit> worst;
  double largest_px = kMaxReprojection_px;
  for (const Candidate* member : group.members) {
    const double rms_px = reprojectionRms(member->corners, group.pose.T_camera_body);
    if (rms_px <= largest_px) continue;
    largest_px = rms_px;
    worst = Misfit{member, TagStatus::kInconsistent};
  }
  if (worst) return worst;
  for (const Candidate* member : group.members) {
    if (member->plane && contradicts(*member->plane, group.pose.T_camera_body, Matrix6d::Zero(), kMaxDepthSigmas)) {
      return Misfit{member, TagStatus::kContradictsDepth};
    }
  }
  return std::nullopt;
}

/// How a label that is not quite flat, or not quite on its face, moves a brick that is seen by it alone: off the face by
/// `label_std_m`, and tilted as if one side were.
Matrix6d labelCovariance(const BrickTag& tag, const Eigen::Isometry3d& T_camera_brick, double label_std_m) {
  const Eigen::Isometry3d T_camera_tag = T_camera_brick * tag.T_brick_tag;
  const Eigen::Vector3d to_brick = T_camera_brick.translation() - T_camera_tag.translation();
  Eigen::Matrix<double, 6, 3> moves = Eigen::Matrix<double, 6, 3>::Zero();
  moves.col(2).head<3>() = label_std_m * T_camera_tag.linear().col(2);
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector3d tilt = label_std_m / tag.black_border_edge_m * T_camera_tag.linear().col(axis);
    moves.col(axis) << tilt.cross(to_brick), tilt;
  }
  return moves * moves.transpose();
}

/// The largest group that `first` is in, and its pose. Nothing if no pose fits.
std::optional<Group> groupOf(const std::vector<const Candidate*>& open, const Candidate* first,
                             const BrickPoseConfig& config) {
  Group group;
  std::vector<RefinedPose> poses;
  for (const RefinedPose& hypothesis : first->hypotheses) {
    std::vector<const Candidate*> members = gather(open, first, hypothesis, config);
    std::vector<RefinedPose> found = fits(members);
    // A member that the pose of all leaves aside is another brick's, or badly seen.
    while (members.size() > 1 && !found.empty()) {
      const auto worst = std::max_element(members.begin() + 1, members.end(), [&](const auto* a, const auto* b) {
        return disagreement(*a, found.front().T_camera_body, config) <
               disagreement(*b, found.front().T_camera_body, config);
      });
      if (disagreement(**worst, found.front().T_camera_body, config) <= 1.0) break;
      members.erase(worst);
      found = fits(members);
    }
    if (found.empty()) continue;
    const bool is_better = poses.empty() || members.size() > group.members.size() ||
                           (members.size() == group.members.size() && found.front().cost < poses.front().cost);
    if (!is_better) continue;
    group.members = std::move(members);
    poses = std::move(found);
  }
  if (poses.empty()) return std::nullopt;

  group.pose = poses.front();
  const bool is_one_face = std::all_of(group.members.begin(), group.members.end(), [&group](const Candidate* member) {
    return member->tag.face == group.members.front()->tag.face;
  });
  if (is_one_face) group.pose.covariance *= flatness(group.members, group.pose);
  for (const RefinedPose& other : poses) {
    if (other.cost - poses.front().cost >= kAmbiguityChi2) continue;
    group.possible_middles.emplace_back(other.T_camera_body.translation());
    const Vector6d step = stepBetween(poses.front().T_camera_body, other.T_camera_body);
    if (step.tail<3>().norm() > config.max_rotation_std_rad) {
      group.is_ambiguous = true;
    } else {
      group.pose.covariance += step * step.transpose();
    }
  }
  group.is_ambiguous = group.is_ambiguous || rotationStd(group.pose.covariance) > config.max_rotation_std_rad;
  if (group.members.size() == 1) {
    group.pose.covariance += labelCovariance(group.members.front()->tag, group.pose.T_camera_body, config.label_std_m);
  }
  return group;
}

/// The largest group of all; of equal ones that of the largest tag. `open` is in order of size.
std::optional<Group> largestGroup(const std::vector<const Candidate*>& open, const BrickPoseConfig& config) {
  std::optional<Group> largest;
  for (const Candidate* first : open) {
    if (largest && std::count(largest->members.begin(), largest->members.end(), first) > 0) continue;
    std::optional<Group> group = groupOf(open, first, config);
    if (group && (!largest || group->members.size() > largest->members.size())) largest = std::move(group);
  }
  return largest;
}

/// By what the decoder says of a tag alone.
TagStatus gate(const TagObservation& tag, const BrickPoseConfig& config) {
  const bool is_finite = std::all_of(tag.corners_px.begin(), tag.corners_px.end(),
                                     [](const Eigen::Vector2d& corner) { return corner.allFinite(); });
  if (!is_finite) return TagStatus::kInconsistent;
  if (!(tag.margin >= config.min_margin) || tag.hamming > config.max_hamming) return TagStatus::kUnsure;
  if (tag.shortestSide() < config.min_side_px) return TagStatus::kTooSmall;
  return TagStatus::kUsed;
}

struct View {
  const CameraModel& camera;
  const cv::Mat& depth_m;  // may be empty
  const cv::Mat& grey;     // may be empty
};

/// Corners, poses and depth plane of a candidate whose tag is known. kUsed, or why it is no candidate.
TagStatus measure(const TagObservation& tag, double edge_m, const View& view, const BrickPoseConfig& config,
                  Candidate* candidate) {
  const TagStatus passed = gate(tag, config);
  if (passed != TagStatus::kUsed) return passed;
  candidate->side_px = tag.shortestSide();
  const std::optional<double> corner_std_px = cornerStd(tag, view.camera, view.grey, config);
  if (!corner_std_px) return TagStatus::kInconsistent;
  const Eigen::Isometry3d& T_brick_tag = candidate->tag.T_brick_tag;
  const std::array<Eigen::Vector3d, 4> corners_tag = tagCorners(edge_m);
  for (std::size_t corner = 0; corner < 4; ++corner) {
    const auto point =
        measurePoint(T_brick_tag * corners_tag[corner], tag.corners_px[corner], view.camera, *corner_std_px);
    if (point) candidate->corners.push_back(*point);
  }
  if (candidate->corners.size() < 4) return TagStatus::kInconsistent;
  PoseProblem problem;
  problem.points = candidate->corners;
  for (const TagPose& pose : tagPoses(tag.corners_px, edge_m, view.camera)) {
    if (pose.reprojection_rms_px > kMaxReprojection_px) continue;
    if (const auto refined = refinePose(problem, pose.T_camera_tag * T_brick_tag.inverse())) {
      candidate->hypotheses.push_back(*refined);
    }
  }
  if (candidate->hypotheses.empty()) return TagStatus::kInconsistent;

  const auto plane = fitDepthPlane(view.depth_m, view.camera, tag.corners_px, config.depth);
  if (!plane) return TagStatus::kUsed;
  candidate->plane = PlaneMeasurement{T_brick_tag.translation(), T_brick_tag.linear().col(2), *plane};
  const auto wrong =
      std::remove_if(candidate->hypotheses.begin(), candidate->hypotheses.end(), [&](const RefinedPose& pose) {
        return contradicts(*candidate->plane, pose.T_camera_body, pose.covariance, kMaxDepthSigmas);
      });
  candidate->hypotheses.erase(wrong, candidate->hypotheses.end());
  return candidate->hypotheses.empty() ? TagStatus::kContradictsDepth : TagStatus::kUsed;
}

/// The bricks that the candidates of one id show, and what became of their tags.
std::vector<Group> groupsOf(const std::vector<Candidate>& candidates, double clearance_m, const BrickPoseConfig& config,
                            std::vector<TagSighting>* tags) {
  std::vector<const Candidate*> open;
  for (const Candidate& candidate : candidates) open.push_back(&candidate);
  std::stable_sort(open.begin(), open.end(),
                   [](const Candidate* a, const Candidate* b) { return a->side_px > b->side_px; });
  std::vector<Group> groups;
  while (!open.empty()) {
    std::optional<Group> group = largestGroup(open, config);
    if (!group) break;  // kInconsistent
    // What the pose of all leaves aside took no part in it, or too much: it is found again without.
    if (const auto misfit = worstMisfit(*group)) {
      (*tags)[misfit->member->index].status = misfit->status;
      open.erase(std::find(open.begin(), open.end(), misfit->member));
      continue;
    }
    open.erase(std::remove_if(open.begin(), open.end(),
                              [&group](const Candidate* candidate) {
                                return std::count(group->members.begin(), group->members.end(), candidate) > 0;
                              }),
               open.end());
    // What stands where a brick of this id is already, but disagrees with it, is a badly seen tag and no second brick.
    const bool is_in_another = std::any_of(groups.begin(), groups.end(), [&](const Group& other) {
      return !other.is_ambiguous && mayBeAt(*group, other.pose.T_camera_body.translation(), clearance_m);
    });
    if (is_in_another) continue;  // kInconsistent
    for (const Candidate* member : group->members) {
      (*tags)[member->index].status = group->is_ambiguous ? TagStatus::kAmbiguous : TagStatus::kUsed;
    }
    groups.push_back(std::move(*group));
  }
  return groups;
}

BrickSighting sightingOf(const Group& group) {
  BrickSighting sighting;
  sighting.T_camera_brick = group.pose.T_camera_body;
  sighting.covariance = group.pose.covariance;
  const PoseProblem problem = problemOf(group.members);
  sighting.has_depth = !problem.planes.empty();
  sighting.reprojection_rms_px = reprojectionRms(problem.points, group.pose.T_camera_body);
  for (const Candidate* member : group.members) sighting.faces.push_back(member->tag.face);
  std::sort(sighting.faces.begin(), sighting.faces.end());
  sighting.faces.erase(std::unique(sighting.faces.begin(), sighting.faces.end()), sighting.faces.end());
  return sighting;
}

}  // namespace

BrickPoseEstimator::BrickPoseEstimator(const BrickCatalogue& catalogue, const BrickPoseConfig& config)
    : catalogue_(catalogue), config_(config) {
  interactive_mapping::requireValid("impossible poses of bricks:", config_);
}

BrickPoseEstimator::Result BrickPoseEstimator::estimate(const std::vector<TagObservation>& tags,
                                                        const CameraModel& camera, const cv::Mat& depth_m,
                                                        const cv::Mat& grey) const {
  interactive_mapping::refuseIfAny("impossible camera:", camera.validate());
  if (!depth_m.empty()) requireImageOf(camera, "depth", depth_m, CV_32FC1, "CV_32FC1");
  if (!grey.empty()) requireImageOf(camera, "grey", grey, CV_8UC1, "CV_8UC1");

  Result result;
  std::map<int, std::vector<Candidate>> candidates;  // by the brick's id
  for (std::size_t i = 0; i < tags.size(); ++i) {
    TagSighting sighting;
    sighting.tag = tags[i];
    sighting.status = TagStatus::kUnknownId;
    if (const std::optional<BrickTag> known = catalogue_.brickOfTag(tags[i].id)) {
      sighting.brick_id = known->brick_id;
      sighting.face = known->face;
      Candidate candidate;
      candidate.index = i;
      candidate.tag_id = tags[i].id;
      candidate.tag = *known;
      const double edge_m = catalogue_.tags.cornerEdge(known->black_border_edge_m);
      sighting.status = measure(tags[i], edge_m, {camera, depth_m, grey}, config_, &candidate);
      if (sighting.status == TagStatus::kUsed) {
        sighting.status = TagStatus::kInconsistent;  // unless a group takes it
        candidates[known->brick_id].push_back(std::move(candidate));
      }
    }
    result.tags.push_back(std::move(sighting));
  }

  for (const auto& [brick_id, of_brick] : candidates) {
    // Two bricks' middles are at least this far apart, however they lie: half of it is nobody's brick.
    const double clearance_m = 0.5 * catalogue_.typeOf(brick_id).size_m.minCoeff();
    const std::vector<Group> groups = groupsOf(of_brick, clearance_m, config_, &result.tags);
    for (const Group& group : groups) {
      if (group.is_ambiguous) continue;
      result.bricks.push_back(sightingOf(group));
      result.bricks.back().brick_id = brick_id;
      // One that cannot be told apart from this one is no evidence, one that is refused and stands elsewhere is.
      result.bricks.back().has_duplicate = std::any_of(groups.begin(), groups.end(), [&](const Group& other) {
        return &other != &group && !mayBeAt(other, group.pose.T_camera_body.translation(), clearance_m);
      });
    }
  }
  return result;
}

}  // namespace brick_detection
