// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace pick_mission {

struct MissionConfig {
  /// Places of base_link in the frame it stands in at the start, looked from one after the other before the first
  /// selection: towards the pile, so that ground is known to stand on. As many of each; none: round the bricks alone.
  std::vector<double> survey_x_m{0.6, 1.2};
  std::vector<double> survey_y_m{0.0, 0.0};
  std::vector<double> survey_yaw_rad{0.0, 0.0};
  /// Then so many more, evenly round the bricks that were found, each so far before the outermost brick in its direction;
  /// 0, and none of the others: no survey.
  int survey_round{3};
  double survey_round_m{1.3};

  int look_images{3};  // in the map before it is believed to show what is there
  double look_timeout_s{20.0};
  double detect_timeout_s{10.0};

  double time_limit_s{3600.0};     // of a mission, without pauses; then what moves the arm is ended in order
  double action_timeout_s{300.0};  // for one action: then it is cancelled and counts as no answer
  double cancel_timeout_s{15.0};   // for a cancelled one to end
  double ready_timeout_s{60.0};    // for the arm to be ready again or to end what it does; for tf to tell the place
  double retry_wait_s{2.0};        // before what was too old or not there is asked again
  double recover_wait_s{10.0};     // after a recovery that failed, for the arm to be ready by itself: then the next

  int max_picks_per_brick{3};          // that failed: then it is left, but for one more for each that is taken away
  int max_plans_per_brick{10};         // that failed since a brick was last taken away
  int max_pick_failures_per_view{3};   // then the next view
  int max_plan_failures_per_view{12};  // each costs time
  int max_failures_in_a_row{5};        // of one kind of action: then the mission ends
  int max_recoveries_in_a_row{3};      // without a motion of the arm that succeeded in between
  int max_fruitless_views{8};          // in a row, without a pick and without a new brick
  int leave_after_views{3};            // of these: away from the bricks tried in vain, if others were tried less often
  double leave_radius_m{1.5};          // about such a brick: places from which the arm reaches it
  int max_low_utility_views{4};        // without a pick: to uncover what is unseen
  int max_vantage_drives{3};           // without a pick: back to a place of the survey
  int max_fade_waits{3};               // without a pick: for reported failures to fade
  double fade_wait_s{60.0};
  double exclusion_radius_m{0.15};  // about a place where nothing could be done, until a brick was picked

  bool unlocks_protective_stop{false};  // without a person who has looked: for simulation only
  int bricks_total{-1};                 // -1: not known

  /// "key = value unit, must be ..." for each value that is impossible.
  std::vector<std::string> validate() const;
};

/// visit(key, value) for each key, for whoever reads or writes configurations.
template <typename Config, typename Visitor>
void visitMissionFields(Config& config, Visitor&& visit) {
  visit("survey/x_m", config.survey_x_m);
  visit("survey/y_m", config.survey_y_m);
  visit("survey/yaw_rad", config.survey_yaw_rad);
  visit("survey/round", config.survey_round);
  visit("survey/round_m", config.survey_round_m);
  visit("look/images", config.look_images);
  visit("look/timeout_s", config.look_timeout_s);
  visit("detect/timeout_s", config.detect_timeout_s);
  visit("time/limit_s", config.time_limit_s);
  visit("time/action_timeout_s", config.action_timeout_s);
  visit("time/cancel_timeout_s", config.cancel_timeout_s);
  visit("time/ready_timeout_s", config.ready_timeout_s);
  visit("time/retry_wait_s", config.retry_wait_s);
  visit("time/recover_wait_s", config.recover_wait_s);
  visit("attempts/max_picks_per_brick", config.max_picks_per_brick);
  visit("attempts/max_plans_per_brick", config.max_plans_per_brick);
  visit("attempts/max_pick_failures_per_view", config.max_pick_failures_per_view);
  visit("attempts/max_plan_failures_per_view", config.max_plan_failures_per_view);
  visit("attempts/max_failures_in_a_row", config.max_failures_in_a_row);
  visit("attempts/max_recoveries_in_a_row", config.max_recoveries_in_a_row);
  visit("views/max_fruitless", config.max_fruitless_views);
  visit("views/leave_after", config.leave_after_views);
  visit("views/leave_radius_m", config.leave_radius_m);
  visit("views/max_low_utility", config.max_low_utility_views);
  visit("views/max_vantage_drives", config.max_vantage_drives);
  visit("views/max_fade_waits", config.max_fade_waits);
  visit("views/fade_wait_s", config.fade_wait_s);
  visit("views/exclusion_radius_m", config.exclusion_radius_m);
  visit("unlocks_protective_stop", config.unlocks_protective_stop);
  visit("bricks_total", config.bricks_total);
}

}  // namespace pick_mission
