// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <string>

namespace interactive_mapping {

/// Text by a pattern of printf, of any length. The compiler checks the values against the pattern.
[[gnu::format(printf, 1, 2)]] inline std::string formatted(const char* pattern, ...) {
  std::va_list values;
  va_start(values, pattern);
  const int length = std::vsnprintf(nullptr, 0, pattern, values);
  va_end(values);
  std::string text(static_cast<std::size_t>(std::max(0, length)), '\0');
  va_start(values, pattern);
  std::vsnprintf(text.data(), text.size() + 1, pattern, values);
  va_end(values);
  return text;
}

}  // namespace interactive_mapping
