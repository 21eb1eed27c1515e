// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>

#include "gpis_mapping/gpis_config.h"

namespace experiments {

/// What an update of one and the same view costs in maps of 10, 30, 100, 300 and 1000 m2 of floor with bricks, in OctoMap
/// at 2 cm, too. The region of `config` is not looked at. {"maps": one of each size, "ratio": of the largest to the
/// smallest}, times in ms.
nlohmann::json measureGrowth(gpis_mapping::GpisConfig config);

}  // namespace experiments
