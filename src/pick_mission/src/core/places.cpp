// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace pick_mission {
namespace {

/// A pose that changes by less is that of a robot at rest: localisation is no better.
constexpr double kSamePlace_m = 0.1;
constexpr double kSamePlace_rad = 0.1;

bool isSamePlace(const Pose2d& a, const Pose2d& b) {
  return (a.position() - b.position()).norm() < kSamePlace_m &&
         std::abs(base_navigation::wrapAngle(a.yaw_rad - b.yaw_rad)) < kSamePlace_rad;
}

}  // namespace

std::size_t numSurveyPoses(const Mission& mission) {
  return mission.config.survey.x_m.size();
}

Pose2d surveyPose(const Mission& mission, std::size_t index) {
  const MissionConfig& config = mission.config;
  return base_navigation::compose(*mission.memory.start_pose,
                                  {config.survey.x_m[index], config.survey.y_m[index], config.survey.yaw_rad[index]});
}

std::vector<Eigen::Vector2d> workspaceOf(const Mission& mission) {
  const WorkspaceConfig& workspace = mission.config.workspace;
  std::vector<Eigen::Vector2d> corners = workspace.corners();
  if (workspace.frame == WorkspaceFrame::kMap) return corners;
  for (Eigen::Vector2d& corner : corners) corner = base_navigation::transform(*mission.memory.start_pose, corner);
  return corners;
}

std::vector<command::Zone> zonesToKeepAwayFrom(const Mission& mission) {
  const BrickLedger& ledger = mission.memory.ledger;
  std::vector<command::Zone> zones;
  const ViewLimits& views = mission.config.views;
  const bool is_early = mission.memory.fruitless_views < views.leave_after;
  if (is_early || mission.approaches_tried_bricks || views.leave_radius_m == 0.0) return zones;
  const auto tries = [](const BrickRecord& record) { return record.plans_failed + record.picks_failed; };
  int fewest = std::numeric_limits<int>::max();
  for (const auto& [id, record] : ledger.bricks()) {
    if (record.is_there && !record.is_picked && !ledger.isExhausted(record)) fewest = std::min(fewest, tries(record));
  }
  for (const auto& [id, record] : ledger.bricks()) {
    if (record.is_there && !record.is_picked && tries(record) > fewest) {
      zones.push_back({record.seen.T_map_brick.translation().head<2>(), views.leave_radius_m});
    }
  }
  return zones;
}

void exclude(const Eigen::Vector2d& p_map, Mission& mission) {
  const double radius_m = mission.config.views.exclusion_radius_m;
  if (radius_m > 0.0) mission.memory.excluded.push_back({p_map, radius_m});
}

void excludeFruitlessView(Mission& mission) {
  if (!mission.is_view_untried || holds(Guard::kBrickHere, mission)) return;
  Memory& memory = mission.memory;
  mission.is_view_untried = false;
  ++memory.fruitless_views;
  exclude(memory.base.position(), mission);
  memory.reports.push_back(
      {{memory.base.x_m, memory.base.y_m, 0.0}, mission.now_s, "nothing could be picked from here"});
}

void reportFailedPlans(Mission& mission) {
  if (holds(Guard::kBrickHere, mission) && !holds(Guard::kChoiceDue, mission)) return;
  auto& plans = mission.plan_reports;
  std::move(plans.begin(), plans.end(), std::back_inserter(mission.memory.reports));
  plans.clear();
}

Eigen::Vector3d nearSideOf(const SeenBrick& brick, const Pose2d& T_map_base) {
  constexpr double kBeside_m = 0.3;  // a brick's length: its far side is out of the radius that a report has by default
  Eigen::Vector3d side = brick.T_map_brick.translation();
  const Eigen::Vector2d to_robot = T_map_base.position() - side.head<2>();
  const double distance_m = to_robot.norm();
  if (distance_m > kBeside_m) side.head<2>() += kBeside_m / distance_m * to_robot;
  return side;
}

void tryAgainFromHere(Mission& mission) {
  ++mission.memory.scene;
  mission.pick_failures_here = mission.plan_failures_here = 0;
}

void forgetTries(Mission& mission, const std::optional<Pose2d>& T_map_base) {
  Memory& memory = mission.memory;
  tryAgainFromHere(mission);
  mission.arm = ArmIs::kAnywhere;
  mission.is_place_chosen = mission.is_drive_due = false;
  if (!T_map_base || !isSamePlace(*T_map_base, memory.base)) mission.is_view_untried = false;
  if (T_map_base) memory.base = *T_map_base;
}

}  // namespace pick_mission
