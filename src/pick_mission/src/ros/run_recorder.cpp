// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/run_recorder.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace pick_mission_ros {
namespace {

constexpr char kStateFile[] = "mission_state.json";
constexpr char kLogFile[] = "mission.jsonl";
constexpr char kSummaryFile[] = "summary.json";
constexpr char kSelectionsFile[] = "selections.jsonl";
constexpr char kPathFile[] = "path.jsonl";
// Between two lines of the path: finer than a picture of it shows.
constexpr double kPathStep_m = 0.05;
constexpr double kPathTurn_rad = 0.1;

/// A crash or a full disk may have left half a line.
bool endsInALine(const std::string& path) {
  std::ifstream stream(path, std::ios::binary | std::ios::ate);
  if (!stream || stream.tellg() <= 0) return true;
  stream.seekg(-1, std::ios::end);
  return stream.get() == '\n';
}

std::string dumped(const nlohmann::json& json, int indent) {
  return json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

RunRecorder::RunRecorder(std::string folder) : folder_(std::move(folder)) {
  if (folder_.empty()) return;
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error || !std::filesystem::is_directory(folder_)) {
    throw std::invalid_argument("run_folder = '" + folder_ + "', must be a folder that can be written to" +
                                (error ? ": " + error.message() : ""));
  }
  log_.open(folder_ + "/" + kLogFile, std::ios::app);
  if (!log_) {
    throw std::invalid_argument("run_folder = '" + folder_ +
                                "', must be a folder that can be written to: " + std::strerror(errno));
  }
  log_.close();  // append() opens it behind whole lines
}

std::optional<nlohmann::json> RunRecorder::savedState() const {
  if (folder_.empty()) return std::nullopt;
  const std::string path = folder_ + "/" + kStateFile;
  if (!exists(folder_)) return std::nullopt;
  std::ifstream stream(path);
  std::ostringstream text;
  text << stream.rdbuf();
  std::error_code error;
  if (!stream || !std::filesystem::is_regular_file(path, error)) {
    throw std::invalid_argument(path + " cannot be read");
  }
  try {
    return nlohmann::json::parse(text.str());
  } catch (const nlohmann::json::exception& exception) {
    throw std::invalid_argument(path + " is no mission's state: " + exception.what());
  }
}

bool RunRecorder::exists(const std::string& folder) {
  std::error_code error;
  return std::filesystem::exists(folder + "/" + kStateFile, error);
}

std::string RunRecorder::problem() const {
  std::string all;
  for (const auto& [name, problem] : problems_) {
    if (!problem.empty()) all += (all.empty() ? "" : "; ") + problem;
  }
  return all;
}

/// What went wrong, or nothing.
std::string RunRecorder::append(std::ofstream* stream, const std::string& name, const std::string& line) {
  if (folder_.empty()) return "";
  const std::string path = folder_ + "/" + name;
  if (!stream->is_open() || !*stream) {
    stream->close();
    stream->clear();
    const bool is_whole = endsInALine(path);
    stream->open(path, std::ios::app);
    if (!is_whole) *stream << "\n";
  }
  // Flushed line by line: a crash of this process loses none.
  *stream << line << std::endl;
  return *stream ? "" : path + " cannot be written: " + std::strerror(errno);
}

std::string RunRecorder::replace(const std::string& name, const std::string& text) {
  if (folder_.empty()) return "";
  const std::string path = folder_ + "/" + name;
  const std::string beside = path + ".new";
  {
    std::ofstream stream(beside, std::ios::trunc);
    stream << text << "\n";
    stream.close();
    if (!stream) return beside + " cannot be written: " + std::strerror(errno);
  }
  // Atomic: a reader, and a crash, find the old file or the new one.
  if (std::rename(beside.c_str(), path.c_str()) == 0) return "";
  return path + " cannot be replaced: " + std::strerror(errno);
}

void RunRecorder::log(const pick_mission::LogEntry& entry) {
  problems_[kLogFile] = append(&log_, kLogFile, toJsonLine(entry));
}

void RunRecorder::selection(const nlohmann::json& selection) {
  problems_[kSelectionsFile] =
      append(&selections_, kSelectionsFile, selection.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void RunRecorder::base(double time_s, const pick_mission::Pose2d& T_map_base) {
  if (last_base_ && (T_map_base.position() - last_base_->position()).norm() < kPathStep_m &&
      std::abs(std::remainder(T_map_base.yaw_rad - last_base_->yaw_rad, 2.0 * M_PI)) < kPathTurn_rad) {
    return;
  }
  last_base_ = T_map_base;
  const nlohmann::json line = {{"time_s", time_s}, {"base", {T_map_base.x_m, T_map_base.y_m, T_map_base.yaw_rad}}};
  problems_[kPathFile] = append(&path_, kPathFile, line.dump());
}

void RunRecorder::state(const nlohmann::json& state) {
  problems_[kStateFile] = replace(kStateFile, dumped(state, -1));
}

void RunRecorder::summary(const nlohmann::json& summary) {
  problems_[kSummaryFile] = replace(kSummaryFile, dumped(summary, 2));
}

}  // namespace pick_mission_ros
