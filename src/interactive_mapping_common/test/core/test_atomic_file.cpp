// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common/files/atomic_file.h"

#include <string>

#include <gmock/gmock.h>

#include "interactive_mapping_common/testing/temporary_folder.h"

namespace interactive_mapping {
namespace {

using test_support::readText;
using test_support::TemporaryFolder;
using test_support::writeText;

TEST(AtomicFile, NothingAppearsWithoutCommit) {
  const TemporaryFolder folder;
  writeText(folder.file("a"), "old");
  {
    AtomicFile file(folder.file("a"));
    file.write(std::string(3 << 20, 'x'));  // past the buffer, so that the temporary file has bytes
    EXPECT_EQ(readText(folder.file("a")), "old");
  }
  EXPECT_EQ(readText(folder.file("a")), "old");
  EXPECT_EQ(folder.numEntries(), 1u);
}

TEST(AtomicFile, CommitPutsAllBytesInPlace) {
  const TemporaryFolder folder;
  std::string text;
  for (int i = 0; i < 400000; ++i) text += std::to_string(i) + ' ';
  AtomicFile file(folder.file("a"));
  for (std::size_t at = 0; at < text.size(); at += 700001) file.write(text.substr(at, 700001));
  file.commit();
  EXPECT_EQ(readText(folder.file("a")), text);
}

}  // namespace
}  // namespace interactive_mapping
