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
  int carriers_wait_views{8};

  static void fields(BrickRules& c, interactive_mapping::Fields& f) {
    f("order", c.order, kBrickOrderNames, "which brick comes first: the highest, or the nearest to the base");
    f("carriers_wait_views", c.carriers_wait_views, 0, 1000, "",
      "views in a row without a pick for which a brick waits while another rests on it; 0: it does not wait");
  }
};

}  // namespace pick_mission
