// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <utility>

namespace interactive_mapping {

/// The names of an enumeration's values. A constant of this type beside the enumeration, and
///
///   constexpr const char* toString(Example value) { return interactive_mapping::nameOf(value, kExampleNames); }
///
/// is how an enumeration gets its names. Those of messages are made by interactive_mapping_msgs.
template <typename Enum>
using Names = std::initializer_list<std::pair<const char*, Enum>>;

/// "?" for a number that is none of the values.
template <typename Enum>
constexpr const char* nameOf(Enum value, Names<Enum> names) {
  for (const auto& [name, named] : names) {
    if (named == value) return name;
  }
  return "?";
}

}  // namespace interactive_mapping
