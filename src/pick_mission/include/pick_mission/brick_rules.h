// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/config/schema.h>

namespace pick_mission {

/// Which of the bricks that can be tried comes first.
enum class BrickOrder { kHighest, kNearest };
inline constexpr interactive_mapping::Names<BrickOrder> kBrickOrderNames = {{"highest", BrickOrder::kHighest},
                                                                            {"nearest", BrickOrder::kNearest}};

struct BrickRules {
  BrickOrder order{BrickOrder::kHighest};
  bool spare_carriers{true};

  static void fields(BrickRules& c, interactive_mapping::Fields& f) {
    f("order", c.order, kBrickOrderNames, "which brick comes first: the highest, or the nearest to the base");
    f("spare_carriers", c.spare_carriers, "true: a brick waits while another rests on it");
  }
};

}  // namespace pick_mission
