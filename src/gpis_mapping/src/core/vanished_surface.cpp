// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/vanished_surface.h"

#include <cstddef>
#include <functional>
#include <numeric>
#include <unordered_map>

#include <boost/pending/disjoint_sets.hpp>

#include "gpis_mapping/point_update.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {
namespace {

/// What is known of one connected piece of hidden surface.
struct Piece {
  std::size_t size{0};
  std::size_t due{0};
  std::size_t confirmed{0};
  std::size_t gone{0};

  HiddenFate fate() const {
    if (2 * due < size || confirmed > gone) return HiddenFate::kStands;
    return size >= kMinVanishedPoints || gone > 0 ? HiddenFate::kVanished : HiddenFate::kSuspect;
  }
};

}  // namespace

std::vector<HiddenFate> judgeHidden(const std::vector<HiddenPoint>& hidden, const std::vector<Witness>& witnesses,
                                    double reach_m) {
  std::unordered_map<LatticeKey, std::vector<std::size_t>, LatticeKeyHash> lattice;
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    lattice[LatticeKey::of(hidden[i].position_map, reach_m)].push_back(i);
  }
  const auto forEachNear = [&](const auto& point, const std::function<void(std::size_t)>& visit) {
    const LatticeKey home = LatticeKey::of(point.position_map, reach_m);
    for (int d = 0; d < 27; ++d) {
      const auto found = lattice.find(home.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
      if (found == lattice.end()) continue;
      for (const std::size_t i : found->second) {
        const bool is_near = (hidden[i].position_map - point.position_map).squaredNorm() < reach_m * reach_m;
        if (is_near && hidden[i].normal_map.dot(point.normal_map) > kSameFaceCosine) visit(i);
      }
    }
  };

  std::vector<std::size_t> rank(hidden.size(), 0);
  std::vector<std::size_t> parent(hidden.size());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  boost::disjoint_sets<std::size_t*, std::size_t*> sets(rank.data(), parent.data());
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    forEachNear(hidden[i], [&](std::size_t j) { sets.union_set(i, j); });
  }

  std::vector<Piece> pieces(hidden.size());  // by the index of the set's representative
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    Piece& piece = pieces[sets.find_set(i)];
    ++piece.size;
    piece.due += hidden[i].is_due;
  }
  std::vector<std::size_t> counted(hidden.size(), 0);  // last witness, from 1, that counted for a piece
  for (std::size_t w = 0; w < witnesses.size(); ++w) {
    forEachNear(witnesses[w], [&](std::size_t i) {
      const std::size_t set = sets.find_set(i);
      if (counted[set] == w + 1) return;
      counted[set] = w + 1;
      ++(witnesses[w].is_gone ? pieces[set].gone : pieces[set].confirmed);
    });
  }
  std::vector<HiddenFate> fates(hidden.size());
  for (std::size_t i = 0; i < hidden.size(); ++i) fates[i] = pieces[sets.find_set(i)].fate();
  return fates;
}

}  // namespace gpis_mapping
