// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>

#include <nlohmann/json.hpp>

namespace pick_mission {

/// Both directions by one list of fields: Object::visitFields(object, visit) calls visit(key, member) for each member.
template <typename Object>
nlohmann::json savedFields(const Object& object) {
  nlohmann::json saved;
  Object::visitFields(object, [&saved](const char* key, const auto& member) { saved[key] = member; });
  return saved;
}

/// Throws nlohmann::json::exception for a key that is missing or of another type, and std::invalid_argument for a whole
/// number that is no count: negative, or larger than an int.
template <typename Object>
void restoreFields(const nlohmann::json& saved, Object& object) {
  Object::visitFields(object, [&saved](const char* key, auto& member) {
    using Member = std::decay_t<decltype(member)>;
    if constexpr (std::is_integral_v<Member> && !std::is_same_v<Member, bool>) {
      constexpr std::int64_t kMost = std::numeric_limits<int>::max();
      const auto count = saved.at(key).template get<std::int64_t>();
      if (count < 0 || count > kMost) {
        throw std::invalid_argument(std::string(key) + " = " + std::to_string(count) + ", must be in [0, " +
                                    std::to_string(kMost) + "]");
      }
      member = static_cast<Member>(count);
    } else {
      saved.at(key).get_to(member);
    }
  });
}

}  // namespace pick_mission
