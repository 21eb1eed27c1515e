// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/types.h"

namespace gpis_mapping {

const char* toString(SpaceState state) {
  switch (state) {
    case SpaceState::kFree:
      return "free";
    case SpaceState::kOccupied:
      return "occupied";
    case SpaceState::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace gpis_mapping
