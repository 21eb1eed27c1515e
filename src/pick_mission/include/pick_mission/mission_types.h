// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Geometry>
#include <base_navigation/planar.h>
#include <interactive_mapping_enums/arm_outcome.h>
#include <interactive_mapping_enums/detect_bricks.h>
#include <interactive_mapping_enums/mission_state.h>
#include <interactive_mapping_enums/navigation_outcome.h>
#include <interactive_mapping_enums/plan_outcome.h>
#include <interactive_mapping_enums/selection_outcome.h>

/// Events and commands of a mission. Poses in the map unless the name has another frame; times are ROS time.
namespace pick_mission {

using base_navigation::Pose2d;
using interactive_mapping::ArmStatus;
using interactive_mapping::DetectionStatus;
using interactive_mapping::EndReason;
using interactive_mapping::Hand;
using interactive_mapping::NavigationStatus;
using interactive_mapping::PlanStatus;
using interactive_mapping::SelectionStatus;
using State = interactive_mapping::MissionState;
constexpr int kNumStates = interactive_mapping::kNumMissionState;
constexpr int kNumEndReasons = interactive_mapping::kNumEndReason;

bool isAction(State state);

/// Of waiting for new images in the map.
enum class LookStatus { kSuccess, kCancelled, kNoImage };
inline constexpr interactive_mapping::Names<LookStatus> kLookStatusNames = {
    {"success", LookStatus::kSuccess}, {"cancelled", LookStatus::kCancelled}, {"no image", LookStatus::kNoImage}};
constexpr const char* toString(LookStatus status) {
  return interactive_mapping::nameOf(status, kLookStatusNames);
}

/// Of waiting for the arm to take motion, or for time to pass.
enum class WaitStatus { kSuccess, kCancelled, kNotReady };
inline constexpr interactive_mapping::Names<WaitStatus> kWaitStatusNames = {
    {"success", WaitStatus::kSuccess}, {"cancelled", WaitStatus::kCancelled}, {"not ready", WaitStatus::kNotReady}};
constexpr const char* toString(WaitStatus status) {
  return interactive_mapping::nameOf(status, kWaitStatusNames);
}

/// Of telling the selection of views about a failure.
enum class ReportStatus { kSuccess, kRefused };
inline constexpr interactive_mapping::Names<ReportStatus> kReportStatusNames = {{"success", ReportStatus::kSuccess},
                                                                                {"refused", ReportStatus::kRefused}};
constexpr const char* toString(ReportStatus status) {
  return interactive_mapping::nameOf(status, kReportStatusNames);
}

/// A brick as brick_detection knows it.
struct SeenBrick {
  int id{0};
  std::string type;  // a name of bricks.yaml
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};  // edges; zero: not known
  std::vector<std::uint8_t> graspable_faces;        // easiest first
  bool has_duplicate{false};                        // another brick carries the same id
  bool is_in_sector{true};  // a graspable face lies in the arm's annulus sectors from where the robot stands
  bool is_seen_now{true};   // in the image of this look; else known from an earlier one
};

/// What ends a wait.
enum class WaitUntil {
  kLimit,
  kArmReady,    // idle, and it may move; fails if that is not so by the limit
  kArmIdle,     // its earlier commands have ended, or the limit
  kPlaceKnown,  // where the robot stands, or the limit
};

/// What is to be done. Each is answered by one Reply with its command's id, also after a Cancel. One at a time, but for
/// what looks for the next brick while a pick carries one away.
namespace command {
/// Out of the camera's view, or with what is held to where it is let go.
struct PlanArm {
  std::string place;  // frame over which what is held is let go; empty: out of the view
};
struct MoveArm {
  std::uint64_t plan{0};  // id of the PlanArm whose trajectory it is
};
/// Waits until so many images newer than now are in the map. Base and arm stand.
struct Look {
  int images{1};
  double timeout_s{0.0};
};
struct Detect {
  double timeout_s{0.0};
};
struct PlanPick {
  SeenBrick brick;
  double min_map_stamp_s{0.0};
  std::string place;          // frame over which it is let go
  bool is_after_pick{false};  // from where the running pick will end, with an empty hand
};
/// With letting go at the end.
struct Pick {
  SeenBrick brick;
  std::uint64_t plan{0};  // id of the PlanPick
};
struct LetGo {};
struct ReportFailure {
  Eigen::Vector3d position{Eigen::Vector3d::Zero()};
  double stamp_s{0.0};
  std::string reason;
};
struct Zone {
  Eigen::Vector2d center{Eigen::Vector2d::Zero()};
  double radius_m{0.0};
};
struct SelectView {
  std::string strategy;
  std::vector<Zone> excluded;
  double min_map_stamp_s{0.0};
  std::vector<Eigen::Vector2d> workspace;  // corners; empty: no ground is explored
  bool may_stay{false};                    // where the robot stands is a candidate, too
};
struct Drive {
  Pose2d T_map_base;
};
struct Recover {
  bool unlocks_protective_stop{false};
};
struct Wait {
  double limit_s{0.0};
  WaitUntil until{WaitUntil::kLimit};
  double at_least_s{0.0};  // of kPlaceKnown
};
// These are not answered.
struct Cancel {};   // the running action
struct Hold {};     // of the arm's bridge
struct Release {};  // of the same
}  // namespace command

struct Command {
  using Body = std::variant<command::PlanArm, command::MoveArm, command::Look, command::Detect, command::PlanPick,
                            command::Pick, command::LetGo, command::ReportFailure, command::SelectView, command::Drive,
                            command::Recover, command::Wait, command::Cancel, command::Hold, command::Release>;
  std::uint64_t id{0};  // of a Cancel: that of the action; 0: Hold and Release
  Body body;
  bool is_beside_pick{false};  // while a pick runs, which has its own reply
};
bool isControl(const Command& command);  // Cancel, Hold, Release

/// How an action ended; which belongs to which command is in Reply.
struct PlanResult {
  PlanStatus status{PlanStatus::kSuccess};
  std::uint8_t face{0};  // of the brick, to pick by: of a PlanPick
};
struct ArmResult {
  ArmStatus status{ArmStatus::kSuccess};
  bool is_lost_over_robot{false};  // the brick was, after the retreat from the pile: it may lie in the container
};
struct LookResult {
  LookStatus status{LookStatus::kSuccess};
  double map_stamp_s{0.0};  // of the newest image
};
struct DetectionResult {
  DetectionStatus status{DetectionStatus::kOk};
  std::vector<SeenBrick> bricks;  // all that are known now, in this look or before
};
struct ReportResult {
  ReportStatus status{ReportStatus::kSuccess};
};
struct SelectionResult {
  SelectionStatus status{SelectionStatus::kSuccess};
  std::optional<Pose2d> T_map_base;  // of the best segment, also with kLowUtility
  bool has_unseen{false};            // imaginary or frontier segments are left
  bool stays{false};                 // the best is where the robot stands
  double unseen_m2{0.0};             // ground of the workspace that can still be seen
};
struct NavigationResult {
  NavigationStatus status{NavigationStatus::kSuccess};
  std::optional<Pose2d> T_map_base;  // where it stands
};
struct WaitResult {
  WaitStatus status{WaitStatus::kSuccess};
};
/// The server is not there, went away, or did not even end when it was cancelled.
struct NoAnswer {};

using Result = std::variant<PlanResult, ArmResult, LookResult, DetectionResult, ReportResult, SelectionResult,
                            NavigationResult, WaitResult, NoAnswer>;
/// "success", or the status in words; "no answer".
std::string toString(const Result& result);
bool isSuccess(const Result& result);

/// The events of a mission.
namespace event {
struct Start {
  Pose2d T_map_base;
  Hand hand{Hand::kUnknown};
  std::optional<int> brick_in_hand;
  // Of an earlier mission of this node: places used in the container, and what workspace, survey and depot are relative to.
  int places_used{0};
  std::optional<Pose2d> start_pose;
};
/// PlanArm, PlanPick: PlanResult. MoveArm, Pick, LetGo, Recover: ArmResult. The others as their names say. Any: NoAnswer.
struct Reply {
  std::uint64_t id{0};
  Result result;
  std::string message;       // of the outcome, as it came
  std::optional<Hand> hand;  // what the bridge says now, if it does
};
/// What the bridge says about the magnet, whenever it changes.
struct HandReport {
  Hand hand{Hand::kUnknown};
  std::optional<int> brick_in_hand;
};
/// The running pick has its brick away from the pile, and the arm is leaving the camera's view.
struct PileLeft {
  std::uint64_t id{0};  // of the command
};
struct Tick {};   // now and then, for limits of time
struct Pause {};  // after the running action
/// From pause or hold, with a fresh inspection: robot and pile may have been moved.
struct Resume {
  std::optional<Pose2d> T_map_base;  // where it stands now; nothing: that is not known
};
struct Hold {};      // at once: nothing moves until Resume
struct Stop {};      // at once, and ends the mission
struct Unloaded {};  // the container was emptied
/// The clock was set: what it jumped by is no time that has passed. A jump back is seen without.
struct ClockJump {
  double by_s{0.0};
};
}  // namespace event

using Event = std::variant<event::Start, event::Reply, event::HandReport, event::PileLeft, event::Tick, event::Pause,
                           event::Resume, event::Hold, event::Stop, event::Unloaded, event::ClockJump>;

}  // namespace pick_mission
