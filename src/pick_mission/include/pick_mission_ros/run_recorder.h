// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fstream>
#include <map>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "pick_mission/mission_log.h"
#include "pick_mission/mission_types.h"

namespace pick_mission_ros {

/// The files of a run. mission.jsonl, selections.jsonl and path.jsonl grow by a line at a time. mission_state.json and
/// summary.json are replaced as a whole, so that each is complete whatever happens. What cannot be written is reported
/// once, and again when it changes; the mission continues.
class RunRecorder {
 public:
  /// `folder` is made if it is missing; empty: nothing is ever written. Throws std::invalid_argument if it cannot be, or
  /// nothing can be written there.
  explicit RunRecorder(std::string folder);

  const std::string& folder() const { return folder_; }

  /// What an earlier node of this run has saved. Throws std::invalid_argument if it cannot be read or is no JSON.
  std::optional<nlohmann::json> savedState() const;

  void log(const pick_mission::LogEntry& entry);
  void selection(const nlohmann::json& selection);
  /// Where the base is in the map, `time_s` in ROS time. Written if it has moved since the last line.
  void base(double time_s, const pick_mission::Pose2d& T_map_base);
  void state(const nlohmann::json& state);
  void summary(const nlohmann::json& summary);

  /// Whether a mission was ever recorded there.
  static bool exists(const std::string& folder);

  /// Of all files that could not be written the last time; empty: none.
  std::string problem() const;

 private:
  std::string append(std::ofstream* stream, const std::string& name, const std::string& line);
  std::string replace(const std::string& name, const std::string& text);

  const std::string folder_;
  std::ofstream log_, selections_, path_;
  std::optional<pick_mission::Pose2d> last_base_;
  std::map<std::string, std::string> problems_;  // by file
};

}  // namespace pick_mission_ros
