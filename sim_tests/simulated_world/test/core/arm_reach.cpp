// SPDX-License-Identifier: BSD-3-Clause
#include "arm_reach.h"

#include <algorithm>
#include <limits>

#include "simulated_world/box_separation.h"

namespace simulated_world {
namespace test {
namespace {

constexpr double kStandoffs_m[] = {0.05, 0.15, 0.30};
constexpr double kOffsets_m[] = {0.0, 0.15, -0.15, 0.3, -0.3};  // of the brick from the robot's middle line, sideways
constexpr double kSideGap_m = 0.05;                             // the robot's sides to bricks
constexpr int kHeadings = 24;
constexpr int kToolTurns = 12;  // about the face's normal
constexpr int kRandomStarts = 2;

// The UR5e (Denavit-Hartenberg table of the maker): from the shoulder to the origin of wrist 3, stretched out.
const double kShoulderToWrist_m = std::hypot(0.425 + 0.3922 + 0.0997, 0.1333);
constexpr double kWristToTip_m = 0.0996 + 0.10;  // flange and magnet, along the tool's axis
const Eigen::Vector3d kShoulder_base(0.186, 0.0, 0.50 + 0.1625);

Eigen::Isometry3d toIsometry(const Pose2d& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << pose.x_m, pose.y_m, 0.0;
  T.rotate(Eigen::AngleAxisd(pose.yaw_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

KDL::Frame toKdl(const Eigen::Isometry3d& T) {
  KDL::Frame frame;
  for (int row = 0; row < 3; ++row) {
    frame.p[row] = T.translation()[row];
    for (int col = 0; col < 3; ++col) frame.M(row, col) = T.linear()(row, col);
  }
  return frame;
}

// Tip frames on a grasp, turned about the tool's axis.
std::vector<Eigen::Isometry3d> tipPoses(const Grasp& grasp) {
  std::vector<Eigen::Isometry3d> result;
  result.reserve(kToolTurns);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = grasp.point_map;
  // Not Eigen's FromTwoVectors: some 1e-6 rad from opposite, as a brick is that physics has laid down, it cancels.
  T.linear().col(2) = -grasp.normal_map;
  T.linear().col(0) = grasp.normal_map.unitOrthogonal();
  T.linear().col(1) = T.linear().col(2).cross(T.linear().col(0));
  for (int turn = 0; turn < kToolTurns; ++turn) {
    result.push_back(T * Eigen::AngleAxisd(2.0 * M_PI * turn / kToolTurns, Eigen::Vector3d::UnitZ()));
  }
  return result;
}

}  // namespace

std::vector<Eigen::Vector2d> ArmReach::cornersSeenFromAbove(const BrickPlacement& brick) {
  std::vector<Eigen::Vector2d> corners;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign((corner & 1) != 0 ? 0.5 : -0.5, (corner & 2) != 0 ? 0.5 : -0.5,
                               (corner & 4) != 0 ? 0.5 : -0.5);
    corners.push_back((brick.T_map_brick * sign.cwiseProduct(brick.type.size_m)).head<2>());
  }
  return corners;
}

void ArmReach::ignoreBricksAmongThemselves() {
  mjModel& model = world_.mutableModel();
  const int ground = requireId(model, mjOBJ_GEOM, "ground");
  std::set<int> brick_geoms;
  for (const BrickPlacement& brick : bricks_) {
    brick_geoms.insert(requireId(model, mjOBJ_GEOM, brickBodyName(brick.id)));
  }
  for (int geom = 0; geom < model.ngeom; ++geom) {
    if (brick_geoms.count(geom) > 0) {
      model.geom_contype[geom] = 0;
      model.geom_conaffinity[geom] = 2;
      model.geom_margin[geom] = kClearance_m;
    } else if (geom != ground && model.geom_contype[geom] != 0) {
      model.geom_contype[geom] = 3;
    }
  }
}

bool ArmReach::isTopmost(const BrickPlacement& brick) const {
  constexpr double kGrazing_m = 0.005;  // bricks stand side by side, not quite parallel
  for (double lift_m = 0.1; lift_m < 1.0; lift_m += 0.1) {
    const Eigen::Isometry3d T_map_lifted = Eigen::Translation3d(0.0, 0.0, lift_m) * brick.T_map_brick;
    for (const BrickPlacement& other : bricks_) {
      const bool is_higher = other.T_map_brick.translation().z() > brick.T_map_brick.translation().z() + 0.05;
      if (is_higher &&
          boxSeparation(T_map_lifted, brick.type.size_m, other.T_map_brick, other.type.size_m) < -kGrazing_m) {
        return false;
      }
    }
  }
  return true;
}

std::vector<Grasp> ArmReach::grasps(const BrickPlacement& brick) {
  std::vector<Grasp> result;
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const Eigen::Vector3d normal_map = (face % 2 == 0 ? 1.0 : -1.0) * brick.T_map_brick.linear().col(axis);
    const Eigen::Vector3d point_map = brick.T_map_brick.translation() + 0.5 * brick.type.size_m[axis] * normal_map;
    const bool is_top = normal_map.z() > std::cos(kMaxTopTilt_rad);
    if (is_top || std::abs(normal_map.z()) < std::sin(kMaxSideTilt_rad)) {
      result.insert(is_top ? result.begin() : result.end(), {point_map, normal_map});
    }
  }
  return result;
}

std::vector<Pose2d> ArmReach::standingPoses(const BrickPlacement& brick) const {
  double front_m = -1e9;
  double left_m = -1e9;
  double right_m = 1e9;
  for (const Eigen::Vector2d& corner : profile_.body.footprint_m) {
    front_m = std::max(front_m, corner.x());
    left_m = std::max(left_m, corner.y());
    right_m = std::min(right_m, corner.y());
  }
  std::vector<std::pair<double, Pose2d>> poses;
  const Eigen::Vector2d target = brick.T_map_brick.translation().head<2>();
  for (int heading = 0; heading < kHeadings; ++heading) {
    const Eigen::Rotation2Dd R_map_base(2.0 * M_PI * heading / kHeadings);
    const Eigen::Rotation2Dd R_base_map = R_map_base.inverse();
    for (const double offset_m : kOffsets_m) {
      for (const double standoff_m : kStandoffs_m) {
        // In a frame at the target with the base's axes, the base's middle line is at y = -offset: how far along x until
        // a lane a little wider than the robot meets a brick? Edges of the bricks' outlines are
        // among the lines between all pairs of corners, and the other lines are inside.
        const double lane_left_m = left_m + kSideGap_m - offset_m;
        const double lane_right_m = right_m - kSideGap_m - offset_m;
        double first_m = std::numeric_limits<double>::infinity();
        for (const BrickPlacement& other : bricks_) {
          const std::vector<Eigen::Vector2d> corners = cornersSeenFromAbove(other);
          for (std::size_t i = 0; i < corners.size(); ++i) {
            for (std::size_t j = 0; j < i; ++j) {
              const Eigen::Vector2d a = R_base_map * (corners[i] - target);
              const Eigen::Vector2d b = R_base_map * (corners[j] - target);
              const double low_m = std::max(std::min(a.y(), b.y()), lane_right_m);
              const double high_m = std::min(std::max(a.y(), b.y()), lane_left_m);
              if (low_m > high_m) continue;
              const bool is_along_y = std::abs(b.y() - a.y()) > 1e-9;
              for (const double y_m : {low_m, high_m}) {
                const double share = is_along_y ? (y_m - a.y()) / (b.y() - a.y()) : (a.x() < b.x() ? 0.0 : 1.0);
                first_m = std::min(first_m, a.x() + share * (b.x() - a.x()));
              }
            }
          }
        }
        const Eigen::Vector2d base_target(first_m - standoff_m - front_m, -offset_m);
        const Eigen::Vector2d base_map = target + R_map_base * base_target;
        const double distance_m = (base_target + kShoulder_base.head<2>()).norm();
        poses.push_back({distance_m, {base_map.x(), base_map.y(), R_map_base.angle()}});
      }
    }
  }
  std::sort(poses.begin(), poses.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Pose2d> result;
  result.reserve(poses.size());
  for (const auto& pose : poses) result.push_back(pose.second);
  return result;
}

void ArmReach::bend(const Reach& reach) {
  const mjModel& model = world_.model();
  const auto set = [&](const std::string& joint, double value) {
    data_->qpos[model.jnt_qposadr[requireId(model, mjOBJ_JOINT, joint)]] = value;
  };
  set("base_x", reach.base.x_m);
  set("base_y", reach.base.y_m);
  set("base_yaw", reach.base.yaw_rad);
  for (int i = 0; i < kNumArmJoints; ++i) set(kArmJoints[static_cast<std::size_t>(i)], reach.arm_rad[i]);
  mj_kinematics(&model, data_.get());
}

std::set<std::string> ArmReach::collisions(const Reach& reach, int target_id) {
  const mjModel& model = world_.model();
  bend(reach);
  mj_collision(&model, data_.get());
  const auto body = [&](int geom) { return std::string(mj_id2name(&model, mjOBJ_BODY, model.geom_bodyid[geom])); };
  std::set<std::string> result;
  for (int i = 0; i < data_->ncon; ++i) {
    std::string a = body(data_->contact[i].geom1);
    std::string b = body(data_->contact[i].geom2);
    if (b < a) std::swap(a, b);
    if (a != brickBodyName(target_id) || b != mp700_ur5e_description::kMagnetLink)
      result.insert(a.append(" - ").append(b));
  }
  return result;
}

Eigen::Isometry3d ArmReach::tip(const Reach& reach) {
  bend(reach);
  const int site = requireId(world_.model(), mjOBJ_SITE, mp700_ur5e_description::kMagnetTipFrame);
  Eigen::Isometry3d T_map_tip = Eigen::Isometry3d::Identity();
  T_map_tip.translation() = Eigen::Map<const Eigen::Vector3d>(data_->site_xpos + 3 * site);
  T_map_tip.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data_->site_xmat + 9 * site);
  return T_map_tip;
}

std::optional<ArmVector> ArmReach::solve(const Eigen::Isometry3d& T_base_tip, const ArmVector& start_rad) {
  KDL::ChainIkSolverPos_LMA solver(chain_, 1e-7, 60);
  KDL::JntArray start(kNumArmJoints);
  KDL::JntArray solution(kNumArmJoints);
  start.data = start_rad;
  if (solver.CartToJnt(start, toKdl(T_base_tip), solution) < 0) return std::nullopt;
  ArmVector q;
  for (int i = 0; i < kNumArmJoints; ++i) q[i] = std::remainder(solution(static_cast<unsigned>(i)), 2.0 * M_PI);
  if ((q.array() < lower_rad_.array()).any() || (q.array() > upper_rad_.array()).any()) return std::nullopt;
  return q;
}

bool ArmReach::isMagnetFree(const Grasp& grasp, int target_id) const {
  const Eigen::Vector3d core_m(0.04, 0.04, 0.1);  // a box inside the magnet
  Eigen::Isometry3d T_map_core = Eigen::Isometry3d::Identity();
  T_map_core.translation() = grasp.point_map + 0.5 * core_m.z() * grasp.normal_map;
  T_map_core.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), grasp.normal_map).matrix();
  return std::none_of(bricks_.begin(), bricks_.end(), [&](const BrickPlacement& brick) {
    return brick.id != target_id && boxSeparation(T_map_core, core_m, brick.T_map_brick, brick.type.size_m) < 0.0;
  });
}

std::optional<Reach> ArmReach::find(const BrickPlacement& brick) {
  const std::vector<Pose2d> poses = standingPoses(brick);
  for (const Grasp& grasp : grasps(brick)) {
    if (!isMagnetFree(grasp, brick.id)) continue;
    const Eigen::Vector3d wrist_map = grasp.point_map + kWristToTip_m * grasp.normal_map;
    for (const Pose2d& base : poses) {
      const Eigen::Isometry3d T_base_map = toIsometry(base).inverse();
      const Eigen::Vector3d wrist_shoulder = T_base_map * wrist_map - kShoulder_base;
      if (wrist_shoulder.norm() > kShoulderToWrist_m) continue;
      for (const Eigen::Isometry3d& T_map_tip : tipPoses(grasp)) {
        const double pan_rad = std::atan2(wrist_shoulder.y(), wrist_shoulder.x());
        // Elbow up, tool down, to both sides of the hand; then anywhere.
        std::vector<ArmVector> starts;
        starts.push_back((ArmVector() << pan_rad, -1.2, 1.6, -2.0, -M_PI_2, 0.0).finished());
        starts.push_back((ArmVector() << pan_rad, -1.2, 1.6, 1.2, M_PI_2, 0.0).finished());
        std::uniform_real_distribution<double> angle(-M_PI, M_PI);
        for (int i = 0; i < kRandomStarts; ++i) {
          starts.push_back(ArmVector::NullaryExpr([&](Eigen::Index) { return angle(random_); }));
        }
        for (const ArmVector& start_rad : starts) {
          const std::optional<ArmVector> arm_rad = solve(T_base_map * T_map_tip, start_rad);
          if (arm_rad && collisions({base, *arm_rad}, brick.id).empty()) return Reach{base, *arm_rad};
        }
      }
    }
  }
  return std::nullopt;
}

}  // namespace test
}  // namespace simulated_world
