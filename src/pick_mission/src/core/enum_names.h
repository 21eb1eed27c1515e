// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace pick_mission {

/// The name of an enum's value, whose names stand in the order of its values; "?" for a number beyond them. `kNum`: how
/// many values there are, so that a name too few or too many does not compile.
template <int kNum, typename Enum>
const char* nameOf(const char* const (&names)[kNum], Enum value) {
  const auto index = static_cast<std::size_t>(value);
  return index < kNum ? names[index] : "?";
}

}  // namespace pick_mission
