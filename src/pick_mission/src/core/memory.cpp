// SPDX-License-Identifier: BSD-3-Clause
#include "memory.h"

#include <stdexcept>

#include "json_fields.h"

namespace nlohmann {

template <typename Value>
struct adl_serializer<std::optional<Value>> {
  static void to_json(json& saved, const std::optional<Value>& value) { saved = value ? json(*value) : json(); }
  static void from_json(const json& saved, std::optional<Value>& value) {
    value = saved.is_null() ? std::nullopt : std::optional<Value>(saved.get<Value>());
  }
};

template <>
struct adl_serializer<base_navigation::Pose2d> {
  static void to_json(json& saved, const base_navigation::Pose2d& pose) { saved = {pose.x_m, pose.y_m, pose.yaw_rad}; }
  static void from_json(const json& saved, base_navigation::Pose2d& pose) {
    pose = {saved.at(0).get<double>(), saved.at(1).get<double>(), saved.at(2).get<double>()};
  }
};

template <>
struct adl_serializer<pick_mission::BrickLedger> {
  static void to_json(json& saved, const pick_mission::BrickLedger& ledger) { saved = ledger.toJson(); }
  static void from_json(const json& saved, pick_mission::BrickLedger& ledger) { ledger.restore(saved); }
};

template <>
struct adl_serializer<pick_mission::command::Zone> {
  static void to_json(json& saved, const pick_mission::command::Zone& zone) {
    saved = {zone.center.x(), zone.center.y(), zone.radius_m};
  }
  static void from_json(const json& saved, pick_mission::command::Zone& zone) {
    zone = {{saved.at(0).get<double>(), saved.at(1).get<double>()}, saved.at(2).get<double>()};
  }
};

template <>
struct adl_serializer<pick_mission::command::ReportFailure> {
  static void to_json(json& saved, const pick_mission::command::ReportFailure& report) {
    saved = {report.position.x(), report.position.y(), report.position.z(), report.stamp_s, report.reason};
  }
  static void from_json(const json& saved, pick_mission::command::ReportFailure& report) {
    report = {{saved.at(0).get<double>(), saved.at(1).get<double>(), saved.at(2).get<double>()},
              saved.at(3).get<double>(),
              saved.at(4).get<std::string>()};
  }
};

}  // namespace nlohmann

namespace pick_mission {
namespace {

constexpr int kVersion = 4;  // of the saved form

/// Of an enumeration with `count` values. Its eight bits would turn a larger number into one of them.
void checkNumber(const nlohmann::json& saved, const char* key, int count) {
  const auto number = saved.at(key).get<std::int64_t>();
  if (number < 0 || number >= count) {
    throw std::invalid_argument(std::string(key) + " = " + std::to_string(number) + ", must be in [0, " +
                                std::to_string(count - 1) + "]");
  }
}

void check(const Memory& memory) {
  if (memory.waits_in && *memory.waits_in != State::kPaused && *memory.waits_in != State::kHeld) {
    throw std::invalid_argument("waits_in = " + std::to_string(static_cast<int>(*memory.waits_in)) +
                                ", must be that of paused or held");
  }
  if (!(memory.used_s >= 0.0)) {
    throw std::invalid_argument("used_s = " + std::to_string(memory.used_s) + " s, must be >= 0 s");
  }
  if (memory.places_used < 0) {
    throw std::invalid_argument("places_used = " + std::to_string(memory.places_used) + ", must be >= 0");
  }
  if (memory.pick_running && !memory.ledger.isKnown(*memory.pick_running)) {
    throw std::invalid_argument("pick_running = " + std::to_string(*memory.pick_running) + ", must be known");
  }
}

}  // namespace

nlohmann::json toJson(const Memory& memory) {
  nlohmann::json saved = savedFields(memory);
  saved["version"] = kVersion;
  return saved;
}

void restore(const nlohmann::json& saved, Memory& memory) {
  try {
    const int version = saved.at("version").get<int>();
    if (version != kVersion) {
      throw std::invalid_argument("a mission's state of version " + std::to_string(version) + ", must be " +
                                  std::to_string(kVersion));
    }
    checkNumber(saved, "end_reason", kNumEndReasons);
    if (!saved.at("waits_in").is_null()) checkNumber(saved, "waits_in", kNumStates);
    restoreFields(saved, memory);
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(std::string("not a mission's state: ") + error.what());
  }
  check(memory);
  if (!memory.pick_running) return;
  // The brick may hang on the magnet, or lie anywhere. The attempt is used.
  const char* const kind = "pick: interrupted by a restart";
  memory.ledger.pickFailed(*memory.pick_running, kind);
  ++memory.failures[kind];
  memory.brick_in_hand = memory.pick_running;
  memory.pick_running.reset();
  ++memory.scene;
  ++memory.places_used;  // it may lie in its place
}

}  // namespace pick_mission
