// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "interactive_mapping_common/config/schema.h"
#include "interactive_mapping_common/testing/temporary_folder.h"

namespace test_support {

/// The file is what the fields of `config` say; comment lines at its top are its own. With WRITE_SHIPPED_FILES=1 in the
/// environment it is written anew instead.
template <typename Config>
void expectShippedFile(const std::string& path, const Config& config = Config()) {
  std::string head;
  for (const std::string& line : splitLines(readText(path))) {
    if (line.rfind("# ", 0) != 0) break;
    head += line + "\n";
  }
  const std::string expected = head + interactive_mapping::toYaml(config, true);
  if (std::getenv("WRITE_SHIPPED_FILES") != nullptr) {
    std::ofstream(path) << expected;
  } else {
    EXPECT_EQ(readText(path), expected) << "after a change of fields: run this test with WRITE_SHIPPED_FILES=1";
  }
}

}  // namespace test_support
