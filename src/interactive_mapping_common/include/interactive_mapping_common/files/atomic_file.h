// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace interactive_mapping {

/// A file that could not be written. what() names the path and the reason.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A file that appears complete or not at all. Bytes go to a temporary file in the same directory; commit() flushes it
/// to disk and renames it. Destruction without commit() removes the temporary file and leaves what was at `path`.
class AtomicFile {
 public:
  /// Throws FileError if the temporary file cannot be made, or if `path` names something else than a regular file.
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Appends bytes. Throws FileError (disk full, quota).
  void write(const void* data, std::size_t num_bytes);
  void write(const std::string& text) { write(text.data(), text.size()); }

  /// Flush, fsync, rename, fsync of the directory. Throws FileError; then the old file is still there.
  void commit();

 private:
  void flush();
  [[noreturn]] void fail(const std::string& what, int error_number);

  std::string path_;
  std::string directory_;
  std::string temporary_path_;
  int descriptor_{-1};
  std::vector<char> buffer_;
};

/// Throws std::invalid_argument unless `path` can be written to from any working directory: absolute, no folder, in a
/// folder that exists.
void requireUsablePath(const std::string& path);

}  // namespace interactive_mapping
