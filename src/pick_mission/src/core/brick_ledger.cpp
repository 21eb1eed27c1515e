// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/brick_ledger.h"

#include <algorithm>
#include <stdexcept>

#include "json_fields.h"
#include "pick_mission/stacking.h"

namespace pick_mission {
namespace {

/// Bricks of one layer are measured to a few millimetres; below one there is no order.
constexpr double kSame_m = 0.001;

template <typename Predicate>
int countOf(const std::map<int, BrickRecord>& bricks, Predicate&& predicate) {
  return static_cast<int>(
      std::count_if(bricks.begin(), bricks.end(), [&](const auto& entry) { return predicate(entry.second); }));
}

}  // namespace

BrickLedger::BrickLedger(int max_picks, int max_plans, const BrickRules& rules)
    : max_picks_(max_picks), max_plans_(max_plans), rules_(rules) {
  if (max_picks < 1 || max_plans < 1) {
    throw std::invalid_argument("attempts per brick = " + std::to_string(max_picks) + " picks, " +
                                std::to_string(max_plans) + " plans, must be at least 1");
  }
}

BrickLedger::Update BrickLedger::update(const std::vector<SeenBrick>& bricks) {
  Update update;
  for (auto& [id, record] : bricks_) record.is_there = false;
  for (const SeenBrick& brick : bricks) {
    const auto [place, is_new] = bricks_.try_emplace(brick.id);
    BrickRecord& record = place->second;
    if (is_new) update.found.push_back(brick.id);
    if (record.is_picked) {
      // An older look knows it where it was; only a look after the pick can tell that it is back.
      if (!brick.is_seen_now) continue;
      record.is_picked = false;
      ++record.picks_failed;
      record.last_failure = "seen again after it was picked";
      ++record.failures[record.last_failure];
      update.came_back.push_back(brick.id);
    }
    const bool has_duplicate = brick.has_duplicate || record.is_there;
    record.seen = brick;
    std::stable_partition(record.seen.graspable_faces.begin(), record.seen.graspable_faces.end(),
                          [&](std::uint8_t face) { return record.failed_faces.count(face) == 0; });
    record.seen.has_duplicate = has_duplicate;
    record.is_there = true;
  }
  return update;
}

std::optional<SeenBrick> BrickLedger::best(int scene, const Eigen::Vector2d& base_map, int fruitless_views) const {
  const auto rankOf = [&](const BrickRecord& record) {
    const Eigen::Vector3d& p_map = record.seen.T_map_brick.translation();
    return rules_.order == BrickOrder::kHighest ? p_map.z() : -(p_map.head<2>() - base_map).norm();
  };
  const BrickRecord* best = nullptr;
  for (const auto& [id, record] : bricks_) {
    if (!obstacleTo(id, scene, fruitless_views).empty()) continue;
    const bool is_last = record.attempts_back > 0;
    const bool is_best_last = best != nullptr && best->attempts_back > 0;
    if (best == nullptr || (is_best_last && !is_last) ||
        (is_best_last == is_last && rankOf(record) > rankOf(*best) + kSame_m)) {
      best = &record;
    }
  }
  if (best == nullptr) return std::nullopt;
  return best->seen;
}

std::string BrickLedger::obstacleTo(int id, int scene, int fruitless_views) const {
  const BrickRecord& record = bricks_.at(id);
  if (record.is_picked) return "is picked";
  if (!record.is_there) return "is not seen any more";
  if (isExhausted(record)) return "has no attempts left";
  if (record.scene_tried == scene) return "was tried without success from here";
  if (record.seen.has_duplicate) return "is not the only one with its id";
  if (!record.seen.is_in_sector) return "is out of the arm's sector";
  if (record.seen.graspable_faces.empty()) return "has no face that the magnet can come to";
  if (fruitless_views < rules_.carriers_wait_views && carriesAnother(record)) return "carries another";
  return "";
}

bool BrickLedger::carriesAnother(const BrickRecord& brick) const {
  return std::any_of(bricks_.begin(), bricks_.end(), [&brick](const auto& entry) {
    const BrickRecord& other = entry.second;
    return other.is_there && !other.is_picked && &other != &brick && restsOn(other.seen, brick.seen);
  });
}

void BrickLedger::pickBegun(int id) {
  ++bricks_.at(id).picks_begun;
}

void BrickLedger::pickFailed(int id, const std::string& reason, std::optional<std::uint8_t> face) {
  BrickRecord& record = bricks_.at(id);
  if (face) record.failed_faces.insert(*face);
  ++record.picks_failed;
  ++record.failures[reason];
  record.last_failure = reason;
}

void BrickLedger::planFailed(int id, const std::string& reason) {
  BrickRecord& record = bricks_.at(id);
  ++record.plans_failed;
  ++record.failures[reason];
  record.last_failure = reason;
}

void BrickLedger::triedInVain(int id, int scene) {
  bricks_.at(id).scene_tried = scene;
}

void BrickLedger::picked(int id) {
  BrickRecord& record = bricks_.at(id);
  record.is_picked = true;
  record.is_there = false;
  pileChanged();
}

void BrickLedger::pileChanged() {
  for (auto& [id, record] : bricks_) {
    record.plans_failed = 0;
    if (attemptsUsed(record) >= max_picks_) record.attempts_back = record.picks_failed - (max_picks_ - 1);
  }
}

bool BrickLedger::isExhausted(const BrickRecord& brick) const {
  return !brick.is_picked && (attemptsUsed(brick) >= max_picks_ || brick.plans_failed >= max_plans_);
}

int BrickLedger::numPicked() const {
  return countOf(bricks_, [](const BrickRecord& brick) { return brick.is_picked; });
}

int BrickLedger::numExhausted() const {
  return countOf(bricks_, [this](const BrickRecord& brick) { return isExhausted(brick); });
}

int BrickLedger::numLeft() const {
  return countOf(bricks_, [this](const BrickRecord& brick) { return !brick.is_picked && !isExhausted(brick); });
}

int BrickLedger::numOpen() const {
  return countOf(
      bricks_, [this](const BrickRecord& brick) { return brick.is_there && !brick.is_picked && !isExhausted(brick); });
}

nlohmann::json BrickLedger::toJson() const {
  nlohmann::json json = nlohmann::json::array();
  for (const auto& [id, record] : bricks_) {
    json.push_back(savedFields(record));
    json.back()["id"] = id;
  }
  return json;
}

void BrickLedger::restore(const nlohmann::json& json) {
  std::map<int, BrickRecord> bricks;
  for (const nlohmann::json& entry : json) {
    const int id = entry.at("id").get<int>();
    bricks[id].seen.id = id;
    restoreFields(entry, bricks[id]);
  }
  bricks_ = std::move(bricks);
}

}  // namespace pick_mission
