// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/pickable.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "simulated_world/box_separation.h"

namespace simulated_world {
namespace {

constexpr double kGravity_m_s2 = 9.81;
constexpr double kTouch_m = 0.005;        // bricks at rest sink into each other by less, a leaning edge counts
constexpr double kDownTilt_rad = 0.1745;  // 10 degrees: a side face may lean forward so much

bool liesOn(const BrickPlacement& upper, const BrickPlacement& lower) {
  const double higher_m = upper.T_map_brick.translation().z() - lower.T_map_brick.translation().z();
  return upper.id != lower.id && higher_m > 0.25 * lower.type.size_m.minCoeff() &&
         boxSeparation(upper.T_map_brick, upper.type.size_m, lower.T_map_brick, lower.type.size_m) < kTouch_m;
}

/// Why the brick cannot be picked even where it lies alone; empty: it can.
std::string ownReason(const BrickPlacement& brick, double holding_force_N) {
  if (brick.decoy == Decoy::kUntagged) return "no tags";
  if (brick.type.mass_kg * kGravity_m_s2 >= holding_force_N) {
    std::ostringstream text;
    text << brick.type.mass_kg << " kg, the magnet holds " << holding_force_N << " N";
    return text.str();
  }
  const bool has_plate = std::any_of(
      brick.type.plate_faces.begin(), brick.type.plate_faces.end(), [&](mp700_ur5e_description::BrickFace face) {
        const Eigen::Vector3d normal_map = brick.T_map_brick.linear() * mp700_ur5e_description::faceNormal(face);
        return normal_map.z() > -std::sin(kDownTilt_rad);
      });
  return has_plate ? "" : "no plate but below";
}

}  // namespace

std::vector<int> carriedBy(int id, const std::vector<BrickPlacement>& bricks) {
  const auto lower = std::find_if(bricks.begin(), bricks.end(), [id](const auto& brick) { return brick.id == id; });
  std::vector<int> ids;
  for (const BrickPlacement& upper : bricks) {
    if (lower != bricks.end() && liesOn(upper, *lower)) ids.push_back(upper.id);
  }
  return ids;
}

std::vector<int> carriedBy(int id, const std::vector<BrickPlacement>& bricks, Decoy kind) {
  std::vector<int> ids = carriedBy(id, bricks);
  const auto isOther = [&](int upper) {
    return std::none_of(bricks.begin(), bricks.end(),
                        [&](const auto& brick) { return brick.id == upper && brick.decoy == kind; });
  };
  ids.erase(std::remove_if(ids.begin(), ids.end(), isOther), ids.end());
  return ids;
}

std::map<int, std::string> unpickable(const std::vector<BrickPlacement>& bricks, double holding_force_N) {
  std::map<int, std::string> reasons;
  for (const BrickPlacement& brick : bricks) {
    const std::string reason = ownReason(brick, holding_force_N);
    if (!reason.empty()) reasons[brick.id] = reason;
  }
  // What lies under one that stays stays, too, and so on down.
  for (bool has_grown = true; has_grown;) {
    has_grown = false;
    for (const BrickPlacement& brick : bricks) {
      if (reasons.count(brick.id) > 0) continue;
      for (const int upper : carriedBy(brick.id, bricks)) {
        if (reasons.count(upper) == 0) continue;
        reasons[brick.id] = "under brick " + std::to_string(upper) + ", which stays";
        has_grown = true;
        break;
      }
    }
  }
  return reasons;
}

}  // namespace simulated_world
