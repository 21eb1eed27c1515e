// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/judge_writer.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iomanip>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include <nlohmann/json.hpp>

namespace simulated_world {
namespace {

using Json = nlohmann::json;

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw std::runtime_error("judge: " + path + ": " + what +
                           (errno != 0 ? std::string(": ") + std::strerror(errno) : ""));
}

void append(std::ofstream& file, const std::string& path, const std::string& line) {
  errno = 0;
  file << line << '\n' << std::flush;
  if (!file) {
    fail(path, "cannot write");
  }
}

std::ofstream openNew(const std::string& path) {
  if (std::filesystem::exists(path)) {
    errno = 0;
    fail(path, "exists already, must be a new run's folder");
  }
  errno = 0;
  std::ofstream file(path);
  if (!file) {
    fail(path, "cannot open");
  }
  return file;
}

std::string textOf(const JudgeRow& row, std::uint64_t digest) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(3) << row.time_s << ',' << row.stowed << ',' << row.falls << ',' << row.drops
       << ',' << row.collisions << ',' << row.load_contacts << ',' << std::setprecision(5);
  if (row.coverage) text << *row.coverage;
  text << ',';
  if (row.precision) text << *row.precision;
  text << ',' << std::setprecision(3) << row.distance_m << ',' << std::hex << std::setw(16) << std::setfill('0')
       << digest;
  return text.str();
}

Json jsonOf(const std::optional<double>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json jsonOf(const JudgeEvent& event) {
  Json json{{"time_s", event.time_s}, {"event", toString(event.kind)}};
  switch (event.kind) {
    case JudgeEventKind::kFall:
    case JudgeEventKind::kFallEnd:
      json["brick"] = event.brick_id;
      json["distance_m"] = event.distance_m;
      json["tilt_rad"] = event.tilt_rad;
      break;
    case JudgeEventKind::kDrop:
    case JudgeEventKind::kStow:
      json["brick"] = event.brick_id;
      break;
    case JudgeEventKind::kCollision:
    case JudgeEventKind::kCollisionEnd:
    case JudgeEventKind::kLoadContact:
    case JudgeEventKind::kLoadContactEnd:
      json["robot_body"] = event.robot_body;
      json["other_body"] = event.other_body;
      json["max_force_N"] = event.max_force_N;
      json["at_m"] = {event.p_map.x(), event.p_map.y(), event.p_map.z()};
      break;
  }
  if (event.kind == JudgeEventKind::kFallEnd || event.kind == JudgeEventKind::kCollisionEnd ||
      event.kind == JudgeEventKind::kLoadContactEnd) {
    json["duration_s"] = event.duration_s;
  }
  return json;
}

Json jsonOf(const JudgeReport& report) {
  return {{"start_time_s", report.start_time_s},
          {"end_time_s", report.totals.time_s},
          {"bricks_total", report.bricks_total},
          {"bricks_pickable", report.bricks_pickable},
          {"stowed", report.totals.stowed},
          {"falls", report.totals.falls},
          {"dropped", report.totals.drops},
          {"collisions", report.totals.collisions},
          {"load_contacts", report.totals.load_contacts},
          {"max_collision_force_N", report.max_collision_force_N},
          {"coverage", jsonOf(report.totals.coverage)},
          {"precision", jsonOf(report.totals.precision)},
          {"exposed_area_m2", report.exposed_area_m2},
          {"coverable_area_m2", report.coverable_area_m2},
          {"covered_area_m2", report.covered_area_m2},
          {"surfaces_judged", report.surfaces_judged},
          {"surfaces_refused", report.surfaces_refused},
          {"distance_m", report.totals.distance_m},
          {"disturbance_m", report.totals.disturbance_m}};
}

}  // namespace

JudgeWriter::JudgeWriter(const std::string& folder) : folder_(folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw std::runtime_error("judge: " + folder + ": cannot make the folder: " + error.message());
  }
  rows_ = openNew(folder_ + "/judge.csv");
  events_ = openNew(folder_ + "/events.jsonl");
  append(rows_, folder_ + "/judge.csv",
         "time_s,stowed,falls,dropped,collisions,load_contacts,coverage,precision,distance_m,digest");
}

void JudgeWriter::write(const Judge& judge, std::uint64_t digest) {
  for (; num_events_ < judge.events().size(); ++num_events_) {
    append(events_, folder_ + "/events.jsonl", jsonOf(judge.events()[num_events_]).dump());
  }
  for (; num_rows_ < judge.history().size(); ++num_rows_) {
    append(rows_, folder_ + "/judge.csv", textOf(judge.history()[num_rows_], digest));
  }
}

void JudgeWriter::finish(const Judge& judge, std::uint64_t digest) {
  write(judge, digest);
  const std::string path = folder_ + "/judge.json";
  const std::string unfinished = path + ".part";
  {
    errno = 0;
    std::ofstream file(unfinished);
    if (!file) {
      fail(unfinished, "cannot open");
    }
    append(file, unfinished, jsonOf(judge.report()).dump(2));
  }
  std::error_code error;
  std::filesystem::rename(unfinished, path, error);
  if (error) {
    throw std::runtime_error("judge: " + path + ": cannot rename from " + unfinished + ": " + error.message());
  }
}

}  // namespace simulated_world
