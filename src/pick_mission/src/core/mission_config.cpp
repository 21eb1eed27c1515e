// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_config.h"

#include <cmath>

#include <interactive_mapping_common/config/range_check.h>

namespace pick_mission {
namespace {

/// More is a slip of the pen: a day, a hall.
constexpr double kLongest_s = 86400.0;
constexpr double kFarthest_m = 100.0;
constexpr int kMost = 1000;

}  // namespace

std::vector<std::string> MissionConfig::validate() const {
  interactive_mapping::RangeCheck check;
  for (const double x_m : survey_x_m) check("survey/x_m", x_m, -kFarthest_m, kFarthest_m, "m");
  for (const double y_m : survey_y_m) check("survey/y_m", y_m, -kFarthest_m, kFarthest_m, "m");
  for (const double yaw_rad : survey_yaw_rad) check("survey/yaw_rad", yaw_rad, -M_PI, M_PI, "rad");
  check("survey/round", survey_round, 0, 12, "");
  check("survey/round_m", survey_round_m, 0.5, 5.0, "m");
  check("look/images", look_images, 1, kMost, "");
  check("look/timeout_s", look_timeout_s, 0.1, kLongest_s, "s");
  check("detect/timeout_s", detect_timeout_s, 0.1, kLongest_s, "s");
  check("time/limit_s", time_limit_s, 1.0, kLongest_s, "s");
  check("time/action_timeout_s", action_timeout_s, 1.0, kLongest_s, "s");
  check("time/cancel_timeout_s", cancel_timeout_s, 0.1, kLongest_s, "s");
  check("time/ready_timeout_s", ready_timeout_s, 0.1, kLongest_s, "s");
  check("time/retry_wait_s", retry_wait_s, 0.0, kLongest_s, "s");
  check("time/recover_wait_s", recover_wait_s, 0.0, kLongest_s, "s");
  check("attempts/max_picks_per_brick", max_picks_per_brick, 1, kMost, "");
  check("attempts/max_plans_per_brick", max_plans_per_brick, 1, kMost, "");
  check("attempts/max_pick_failures_per_view", max_pick_failures_per_view, 1, kMost, "");
  check("attempts/max_plan_failures_per_view", max_plan_failures_per_view, 1, kMost, "");
  check("attempts/max_failures_in_a_row", max_failures_in_a_row, 1, kMost, "");
  check("attempts/max_recoveries_in_a_row", max_recoveries_in_a_row, 1, kMost, "");
  check("views/max_fruitless", max_fruitless_views, 1, kMost, "");
  check("views/leave_after", leave_after_views, 1, kMost, "");
  check("views/leave_radius_m", leave_radius_m, 0.0, kFarthest_m, "m");
  check("views/max_low_utility", max_low_utility_views, 0, kMost, "");
  check("views/max_vantage_drives", max_vantage_drives, 0, kMost, "");
  check("views/max_fade_waits", max_fade_waits, 0, kMost, "");
  check("views/fade_wait_s", fade_wait_s, 0.0, kLongest_s, "s");
  check("views/exclusion_radius_m", exclusion_radius_m, 0.0, kFarthest_m, "m");
  check("bricks_total", bricks_total, -1, 1e6, "");
  std::vector<std::string> problems = check.problems();
  if (survey_x_m.size() != survey_y_m.size() || survey_x_m.size() != survey_yaw_rad.size()) {
    problems.push_back("survey/x_m, survey/y_m, survey/yaw_rad = " + std::to_string(survey_x_m.size()) + ", " +
                       std::to_string(survey_y_m.size()) + ", " + std::to_string(survey_yaw_rad.size()) +
                       " values, must be as many of each");
  }
  // The machine would cancel a look, a detection or a wait that may still succeed.
  for (const auto& [key, value_s] : {std::pair<const char*, double>{"look/timeout_s", look_timeout_s},
                                     {"detect/timeout_s", detect_timeout_s},
                                     {"time/ready_timeout_s", ready_timeout_s},
                                     {"time/retry_wait_s", retry_wait_s},
                                     {"time/recover_wait_s", recover_wait_s},
                                     {"views/fade_wait_s", fade_wait_s}}) {
    if (value_s < action_timeout_s || value_s > kLongest_s) continue;
    problems.push_back(std::string(key) + " = " + std::to_string(value_s) +
                       " s, must be less than time/action_timeout_s = " + std::to_string(action_timeout_s) + " s");
  }
  return problems;
}

}  // namespace pick_mission
