// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <base_navigation/planar.h>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/geometry/polygon.h>

#include "pick_mission/brick_rules.h"

namespace pick_mission {

// More is a slip of the pen: a day, a hall.
constexpr double kLongest_s = 86400.0;
constexpr double kFarthest_m = 100.0;
constexpr int kMost = 1000;

/// Poses of base_link before the first selection, where nothing is seen from the start that a view can be selected by.
struct SurveyConfig {
  std::vector<double> x_m{};
  std::vector<double> y_m{};
  std::vector<double> yaw_rad{};

  static void fields(SurveyConfig& c, interactive_mapping::Fields& f) {
    f("x_m", c.x_m, -kFarthest_m, kFarthest_m, "m",
      "x of the poses of base_link before the first selection, in the frame of its pose at the start");
    f("y_m", c.y_m, -kFarthest_m, kFarthest_m, "m", "y, as many; none: one view from the start");
    f("yaw_rad", c.yaw_rad, -M_PI, M_PI, "rad", "yaw, as many");
    const auto size = [](const std::vector<double>& list) { return std::to_string(list.size()); };
    f.require(c.x_m.size() == c.y_m.size() && c.x_m.size() == c.yaw_rad.size(),
              "x_m, y_m, yaw_rad = " + size(c.x_m) + ", " + size(c.y_m) + ", " + size(c.yaw_rad) +
                  " values, must be as many of each");
  }
};

struct LookConfig {
  int images{3};
  double timeout_s{20.0};
  bool while_carrying{true};

  static void fields(LookConfig& c, interactive_mapping::Fields& f) {
    f("images", c.images, 1, kMost, "", "new images in the map before it is up to date");
    f("timeout_s", c.timeout_s, 0.1, kLongest_s, "s", "time for them; less than time/action_timeout_s");
    f("while_carrying", c.while_carrying,
      "true: while the arm carries a brick away, the next one is detected, chosen and planned; false: after it");
  }
};

struct DetectConfig {
  double timeout_s{10.0};

  static void fields(DetectConfig& c, interactive_mapping::Fields& f) {
    f("timeout_s", c.timeout_s, 0.1, kLongest_s, "s", "time for a detection; less than time/action_timeout_s");
  }
};

struct TimeLimits {
  double limit_s{3600.0};
  double action_timeout_s{300.0};
  double cancel_timeout_s{15.0};
  double ready_timeout_s{60.0};
  double retry_wait_s{2.0};
  double recover_wait_s{10.0};

  static void fields(TimeLimits& c, interactive_mapping::Fields& f) {
    f("limit_s", c.limit_s, 1.0, kLongest_s, "s",
      "ROS time of a mission, without pauses; then what moves the arm is ended in order");
    f("action_timeout_s", c.action_timeout_s, 1.0, kLongest_s, "s",
      "time for one action; then it is cancelled and counts as unanswered");
    f("cancel_timeout_s", c.cancel_timeout_s, 0.1, kLongest_s, "s", "time for a cancelled action to end");
    f("ready_timeout_s", c.ready_timeout_s, 0.1, kLongest_s, "s",
      "time for the arm to be ready again or to end a motion, and for tf to give the robot's pose; less than "
      "action_timeout_s");
    f("retry_wait_s", c.retry_wait_s, 0.0, kLongest_s, "s",
      "wait before a request is repeated whose input was too old or missing; less than action_timeout_s");
    f("recover_wait_s", c.recover_wait_s, 0.0, kLongest_s, "s",
      "wait after a failed recovery for the arm to be ready by itself, before the next; less than action_timeout_s");
  }
};

struct AttemptLimits {
  int max_picks_per_brick{3};
  int max_plans_per_brick{10};
  int max_pick_failures_per_view{3};
  int max_plan_failures_per_view{12};
  int max_failures_in_a_row{5};
  int max_recoveries_in_a_row{3};

  static void fields(AttemptLimits& c, interactive_mapping::Fields& f) {
    f("max_picks_per_brick", c.max_picks_per_brick, 1, kMost, "",
      "failed picks after which a brick is given up; it gets one more, after all others, for each brick removed");
    f("max_plans_per_brick", c.max_plans_per_brick, 1, kMost, "",
      "failed plans for a brick since a brick was last taken away");
    f("max_pick_failures_per_view", c.max_pick_failures_per_view, 1, kMost, "",
      "failed picks after which the next view is selected");
    f("max_plan_failures_per_view", c.max_plan_failures_per_view, 1, kMost, "",
      "failed plans after which the next view is selected; each costs time");
    f("max_failures_in_a_row", c.max_failures_in_a_row, 1, kMost, "",
      "failures of one kind of action in a row that end the mission");
    f("max_recoveries_in_a_row", c.max_recoveries_in_a_row, 1, kMost, "",
      "recoveries without a successful motion of the arm in between");
  }
};

struct ViewLimits {
  bool choose_after_each_pick{true};
  int max_fruitless{16};
  int leave_after{3};
  double leave_radius_m{1.5};
  int max_low_utility{4};
  int max_vantage_drives{3};
  int max_fade_waits{3};
  double fade_wait_s{60.0};
  double exclusion_radius_m{0.15};

  static void fields(ViewLimits& c, interactive_mapping::Fields& f) {
    f("choose_after_each_pick", c.choose_after_each_pick,
      "true: a view is selected after every pick, failed or not, and staying is one of the candidates; false: only "
      "when no brick can be tried from here");
    f("max_fruitless", c.max_fruitless, 1, kMost, "", "views in a row without a pick and without a new brick");
    f("leave_after", c.leave_after, 1, kMost, "",
      "fruitless views after which bricks tried without success are passed over, if others were tried less often");
    f("leave_radius_m", c.leave_radius_m, 0.0, kFarthest_m, "m",
      "radius about such a brick within which the arm reaches it: no view is selected there; 0: none is passed over");
    f("max_low_utility", c.max_low_utility, 0, kMost, "", "views without a pick, to uncover unseen space");
    f("max_vantage_drives", c.max_vantage_drives, 0, kMost, "", "drives without a pick, back to a pose of the survey");
    f("max_fade_waits", c.max_fade_waits, 0, kMost, "", "waits without a pick, for reported failures to fade");
    f("fade_wait_s", c.fade_wait_s, 0.0, kLongest_s, "s", "duration of such a wait; less than time/action_timeout_s");
    f("exclusion_radius_m", c.exclusion_radius_m, 0.0, kFarthest_m, "m",
      "radius about a pose without success that is excluded until a brick was picked; 0: none is excluded");
  }
};

/// In which frame the corners of the workspace are.
enum class WorkspaceFrame { kStart, kMap };
inline constexpr interactive_mapping::Names<WorkspaceFrame> kWorkspaceFrameNames = {{"start", WorkspaceFrame::kStart},
                                                                                    {"map", WorkspaceFrame::kMap}};

/// What is to be cleared of bricks: its ground is looked at before the mission says that no brick is left.
struct WorkspaceConfig {
  WorkspaceFrame frame{WorkspaceFrame::kStart};
  std::vector<double> x_m{1.0, 7.0, 7.0, 1.0};  // a box before the robot that holds each shipped scene
  std::vector<double> y_m{-2.5, -2.5, 2.5, 2.5};

  static void fields(WorkspaceConfig& c, interactive_mapping::Fields& f) {
    f("frame", c.frame, kWorkspaceFrameNames, "of the corners: map, or start, the robot's pose at the first start");
    f("x_m", c.x_m, -kFarthest_m, kFarthest_m, "m", "x of the corners of the polygon; none: no ground is explored");
    f("y_m", c.y_m, -kFarthest_m, kFarthest_m, "m", "y, as many");
    const bool is_paired = c.x_m.size() == c.y_m.size();
    f.require(is_paired, "x_m, y_m = " + std::to_string(c.x_m.size()) + ", " + std::to_string(c.y_m.size()) +
                             " values, must be as many of each");
    if (!is_paired || c.x_m.empty()) return;
    const std::string problem = interactive_mapping::problemOfPolygon(c.corners());
    f.require(problem.empty(), "x_m, y_m: the workspace " + problem);
  }

  std::vector<Eigen::Vector2d> corners() const {
    std::vector<Eigen::Vector2d> corners;
    for (std::size_t i = 0; i < x_m.size(); ++i) corners.emplace_back(x_m[i], y_m[i]);
    return corners;
  }
};

/// Where the container is unloaded. By default the place of the start, facing away from the pile: the robot comes from there
/// and sees the ground that it drives on.
struct DepotConfig {
  double x_m{0.0};
  double y_m{0.0};
  double yaw_rad{M_PI};

  base_navigation::Pose2d pose() const { return {x_m, y_m, yaw_rad}; }

  static void fields(DepotConfig& c, interactive_mapping::Fields& f) {
    f("x_m", c.x_m, -kFarthest_m, kFarthest_m, "m",
      "x of the pose of base_link where the container is unloaded, in the frame of its pose at the start");
    f("y_m", c.y_m, -kFarthest_m, kFarthest_m, "m", "y");
    f("yaw_rad", c.yaw_rad, -M_PI, M_PI, "rad", "yaw");
  }
};

struct MissionConfig {
  std::vector<std::string> stow{"container_place_1", "container_place_2", "container_place_3"};
  bool unlocks_protective_stop{false};
  int bricks_total{-1};
  SurveyConfig survey;
  LookConfig look;
  DetectConfig detect;
  TimeLimits time;
  AttemptLimits attempts;
  ViewLimits views;
  BrickRules bricks;
  WorkspaceConfig workspace;
  DepotConfig depot;

  static void fields(MissionConfig& c, interactive_mapping::Fields& f) {
    f("stow", c.stow,
      "frames over which bricks are let go, in this order, one brick each; when all are used the robot drives to the "
      "depot");
    f.require(!c.stow.empty(), "stow is empty, must be a frame at least");
    for (const std::string& frame : c.stow) {
      f.require(!frame.empty() && frame.front() != '/',
                "stow = '" + frame + "', must be a tf2 frame: no leading slash");
    }
    f("unlocks_protective_stop", c.unlocks_protective_stop,
      "true: a protective stop is unlocked before a person has looked, for simulation only");
    f("bricks_total", c.bricks_total, -1, 1'000'000, "",
      "number of bricks: the mission ends when as many are picked or given up; -1: not known");
    f.section("survey", c.survey);
    f.section("look", c.look);
    f.section("detect", c.detect);
    f.section("time", c.time);
    f.section("attempts", c.attempts);
    f.section("views", c.views);
    f.section("bricks", c.bricks);
    f.section("workspace", c.workspace);
    f.section("depot", c.depot);
    // The machine would cancel a look, a detection or a wait that may still succeed.
    for (const auto& [key, value_s] : {std::pair<const char*, double>{"look/timeout_s", c.look.timeout_s},
                                       {"detect/timeout_s", c.detect.timeout_s},
                                       {"time/ready_timeout_s", c.time.ready_timeout_s},
                                       {"time/retry_wait_s", c.time.retry_wait_s},
                                       {"time/recover_wait_s", c.time.recover_wait_s},
                                       {"views/fade_wait_s", c.views.fade_wait_s}}) {
      f.require(!(value_s >= c.time.action_timeout_s) || value_s > kLongest_s,
                std::string(key) + " must be less than time/action_timeout_s");
    }
  }
};

/// Bricks that the container takes.
inline int capacityOf(const MissionConfig& config) {
  return static_cast<int>(config.stow.size());
}

}  // namespace pick_mission
