// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

namespace pick_mission {

MissionCounts countsOf(const Mission& mission) {
  const Memory& memory = mission.memory;
  MissionCounts counts;
  counts.bricks_picked = numPicked(memory);
  counts.bricks_open = memory.ledger.numOpen();
  counts.bricks_exhausted = memory.ledger.numExhausted();
  counts.picks_begun = memory.picks_begun;
  counts.views = memory.views;
  for (const auto& [kind, count] : memory.failures) counts.failures += count;
  return counts;
}

int numPicked(const Memory& memory) {
  return memory.ledger.numPicked() + memory.picked_without_id;
}

int numNeverFound(const Mission& mission) {
  if (mission.config.bricks_total < 0) return 0;
  const BrickLedger& ledger = mission.memory.ledger;
  return mission.config.bricks_total - numPicked(mission.memory) - ledger.numExhausted() - ledger.numLeft();
}

}  // namespace pick_mission
