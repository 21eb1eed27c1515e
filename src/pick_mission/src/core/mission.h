// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "memory.h"
#include "pick_mission/mission_config.h"
#include "pick_mission/mission_log.h"
#include "pick_mission/reactions.h"

namespace pick_mission {

enum class HaltFor { kHold, kResume, kStop, kTimeUp, kTimeout };
enum class DriveFor { kSurvey, kView, kVantage, kDepot };
/// kOverPlace: over the place where it let a brick go, out of the camera's view; kFolded: out of it and fit to drive.
enum class ArmIs { kAnywhere, kOverPlace, kFolded };

/// All data of a mission. What works on it is declared below, by its file.
struct Mission {
  const MissionConfig config;
  const MissionInfo info;
  Memory memory;

  // The rest is lost with the process; a fresh inspection brings back what is needed of it.
  State state{State::kIdle};
  double state_since_s{0.0};
  double now_s{0.0};

  struct Running {
    std::uint64_t id;
    State action;
    std::optional<SeenBrick> brick{};  // of a pick and its plan
    bool is_looked_ahead{false};       // a pick: the next brick was looked for before it ended
  };
  std::optional<Running> running{};
  std::optional<Running> carrying{};  // a pick beside it, which carries its brick away
  HaltFor halt_for{HaltFor::kStop};   // in the state halting, and of the one before
  bool is_pause_wanted{false};        // when the running action has ended

  Hand hand{Hand::kUnknown};
  int unknown_hand_waits{0};
  ArmIs arm{ArmIs::kAnywhere};
  bool is_protective_stop{false};  // says the last reply
  int recoveries{0};               // since the arm last moved
  std::uint64_t plan_id{0};        // of the last plan that succeeded
  command::Wait wait{};            // the next one

  double map_stamp_s{0.0};
  std::optional<SeenBrick> candidate{};     // of the last plan of a pick; its first face is the planned one
  bool is_next_planned{false};              // its pick, while the one before went on
  SelectionResult selection{};              // the last one
  std::optional<double> least_unseen_m2{};  // ground of the workspace, of all selections
  struct Goal {
    DriveFor why{DriveFor::kSurvey};
    Pose2d T_map_base;
  } goal{};
  bool is_drive_due{false};             // to the goal, as soon as the arm is folded
  bool approaches_tried_bricks{false};  // nothing else was worth it since a brick was last stowed

  // From where the robot stands.
  bool is_place_chosen{false};  // by a selection; no pick since, and where plans failed others may be tried
  bool is_view_untried{false};  // a selected view from which nothing has been picked and that is not excluded yet
  int pick_failures_here{0};
  int plan_failures_here{0};
  std::deque<command::ReportFailure> plan_reports{};  // of plans that failed since the last pick and selection
};

MissionCounts countsOf(const Mission& mission);
int numPicked(const Memory& memory);        // also bricks without an id
int numNeverFound(const Mission& mission);  // of `bricks_total`; 0 if that is not known

// --- guards.cpp -----------------------------------------------------------------------------------------------------

bool holds(Guard guard, const Mission& mission);
/// It ended because nothing is left to do, not because something failed or somebody stopped it.
bool isOverOfItself(const Memory& memory);
/// With the magnet in play: without an answer nobody knows what hangs there.
bool handlesBrick(State action);

// --- effects.cpp ----------------------------------------------------------------------------------------------------

/// Why a transition is taken: for the log and the effect.
struct Cause {
  std::string event{};
  std::string reason{};
  State action{State::kIdle};           // whose result it is
  EndReason end{EndReason::kNotEnded};  // if that action is given up
  std::optional<Pose2d> T_map_base{};   // of a resume: where the robot stands, if that is known
};

/// What a transition from the mission's state does besides leading to the next one.
void apply(Effect effect, const Cause& cause, Mission& mission);

// --- results.cpp ----------------------------------------------------------------------------------------------------

/// Records what the result of an action says about robot, hand, bricks and views. `is_broken_off`: the mission itself
/// cancelled it, and a failure does not count.
void record(const Mission::Running& ended, const event::Reply& reply, const Reaction& reaction, bool is_broken_off,
            Mission& mission);

/// What the arm's bridge says. With an empty hand an open let go has succeeded, whatever else was answered.
void setHand(Hand hand, Mission& mission);

/// Failures of `action` in a row, if they are too many; else 0.
int tooManyInARow(State action, const Reaction& reaction, const Mission& mission);

// --- actions.cpp ----------------------------------------------------------------------------------------------------

/// A pick that goes on beside what looks for the next brick is the running action again.
void takeUpPick(Mission& mission);

/// Begins the action of the mission's state: what changes with it, and its command.
Command begin(Mission& mission);

// --- places.cpp -----------------------------------------------------------------------------------------------------

/// `index`: below their number.
std::size_t numSurveyPoses(const Mission& mission);
Pose2d surveyPose(const Mission& mission, std::size_t index);

/// Corners in the map.
std::vector<Eigen::Vector2d> workspaceOf(const Mission& mission);

/// After views without a pick: about the bricks that were tried more often than others. Empty if there are none, or
/// nothing else was worth it.
std::vector<command::Zone> zonesToKeepAwayFrom(const Mission& mission);

/// From selections, until a brick is picked, unless the configuration excludes nothing.
void exclude(const Eigen::Vector2d& p_map, Mission& mission);

/// A view with no brick to be tried from it is excluded and reported to the selection, once.
void excludeFruitlessView(Mission& mission);

/// The failed plans go to the selection, unless another brick is tried first: its pick would make them no failures.
void reportFailedPlans(Mission& mission);

/// Beside the brick, towards the robot: for a report of a failure, so that it may be tried from its other sides.
Eigen::Vector3d nearSideOf(const SeenBrick& brick, const Pose2d& T_map_base);

/// What was tried without success from here may be tried again.
void tryAgainFromHere(Mission& mission);

/// People may have moved robot and pile: what was tried from here may be tried again. Counts against the bricks stay,
/// and a view counts once while the robot stays there. `T_map_base`: where it is now, if that is known.
void forgetTries(Mission& mission, const std::optional<Pose2d>& T_map_base);

}  // namespace pick_mission
