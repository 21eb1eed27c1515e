// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "pick_mission/brick_rules.h"
#include "pick_mission/mission_types.h"

namespace pick_mission {

/// A brick with what was tried on it.
struct BrickRecord {
  SeenBrick seen;
  bool is_there{false};  // by the last detection
  bool is_picked{false};
  int picks_begun{0};
  int picks_failed{0};
  int attempts_back{0};            // that it was given when it had none left and another brick was taken away
  int plans_failed{0};             // since a brick was last taken away: then it may be reached
  std::optional<int> scene_tried;  // without success; tried again in another
  std::map<std::string, int> failures;
  std::string last_failure;
  std::set<std::uint8_t> failed_faces;  // tried without success: they come last

  /// visit(key, member) for what is saved: what was tried. Observations are not saved.
  template <typename Self, typename Visitor>
  static void visitFields(Self& self, Visitor&& visit) {
    visit("is_picked", self.is_picked);
    visit("picks_begun", self.picks_begun);
    visit("picks_failed", self.picks_failed);
    visit("attempts_back", self.attempts_back);
    visit("plans_failed", self.plans_failed);
    visit("failures", self.failures);
    visit("last_failure", self.last_failure);
  }
};

/// All bricks of a mission, which to try next and which no more. A "scene" is a number that changes when robot or pile do.
class BrickLedger {
 public:
  /// Throws std::invalid_argument unless both are at least 1.
  BrickLedger(int max_picks, int max_plans, const BrickRules& rules = {});

  struct Update {
    std::vector<int> found;      // ids never known before
    std::vector<int> came_back;  // picked, and seen again: a failed pick after all
  };
  /// `bricks`: all that are known now; those that are not in it are not there any more.
  Update update(const std::vector<SeenBrick>& bricks);

  /// The first, by the rules: the highest brick, or the nearest to the base at `base_map`. It must be there, graspable,
  /// in the arm's sector and alone with its id. It must have attempts left and not be tried without success in this
  /// scene. Of two that are equal to a millimetre it is that of smaller id. Bricks that were given up before come last.
  /// After `carriers_wait_views` `fruitless_views` a brick on which another rests is taken, too.
  std::optional<SeenBrick> best(int scene, const Eigen::Vector2d& base_map = Eigen::Vector2d::Zero(),
                                int fruitless_views = 0) const;
  /// Why best() does not take a brick, as what is said of it ("is out of the arm's sector"); empty where it may. Throws
  /// std::out_of_range for an id that was never known.
  std::string obstacleTo(int id, int scene, int fruitless_views = 0) const;

  // Throw std::out_of_range for an id that was never known.
  void pickBegun(int id);
  void pickFailed(int id, const std::string& reason, std::optional<std::uint8_t> face = {});
  void planFailed(int id, const std::string& reason);
  void triedInVain(int id, int scene);
  void picked(int id);  // also pileChanged()
  /// A brick was taken away. Bricks that could not be planned or picked may be possible now. A brick that was given up
  /// may block all others.
  void pileChanged();
  bool isKnown(int id) const { return bricks_.count(id) > 0; }
  bool isExhausted(const BrickRecord& brick) const;
  bool carriesAnother(const BrickRecord& brick) const;  // one that is there, whether it has attempts left or not

  int numPicked() const;
  int numExhausted() const;  // not picked
  int numLeft() const;       // not picked, with attempts left
  int numOpen() const;       // the same, and there
  const std::map<int, BrickRecord>& bricks() const { return bricks_; }

  /// restore() throws nlohmann::json::exception for anything else, and std::invalid_argument for counts that are none;
  /// nothing has changed then.
  nlohmann::json toJson() const;
  void restore(const nlohmann::json& json);

 private:
  int attemptsUsed(const BrickRecord& brick) const { return brick.picks_failed - brick.attempts_back; }

  int max_picks_;
  int max_plans_;
  BrickRules rules_;
  std::map<int, BrickRecord> bricks_;  // by id
};

}  // namespace pick_mission
