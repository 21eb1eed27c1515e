// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/files/atomic_file.h>

#include <fcntl.h>
#include <unistd.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>

namespace interactive_mapping {
namespace {

constexpr std::size_t kBufferBytes = 1 << 20;

std::string directoryOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

/// Two writers of one path, in this process or in another, never share a temporary file.
std::string temporaryName(const std::string& path) {
  static std::atomic<unsigned> counter{0};
  return path + ".tmp." + std::to_string(::getpid()) + "." + std::to_string(counter++);
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path), directory_(directoryOf(path)) {
  if (path.empty() || path.back() == '/') fail("cannot be written", EISDIR);
  mode_t mode = 0666;  // the process's umask applies
  struct stat old {};
  const bool exists = ::stat(path.c_str(), &old) == 0;
  if (exists && !S_ISREG(old.st_mode)) {
    throw FileError(path +
                    ": cannot be written: " + (S_ISDIR(old.st_mode) ? "is a directory" : "is not a regular file"));
  }
  temporary_path_ = temporaryName(path);
  descriptor_ = ::open(temporary_path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (descriptor_ < 0) {
    const int error_number = errno;
    temporary_path_.clear();  // nothing to remove
    fail("cannot create a file in '" + directory_ + "'", error_number);
  }
  // A file that replaces another keeps who may read it; not being allowed to is no reason to lose the data.
  if (exists && ::fchmod(descriptor_, old.st_mode & 0777) != 0) errno = 0;
  buffer_.reserve(kBufferBytes);
}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!temporary_path_.empty()) ::unlink(temporary_path_.c_str());
}

void AtomicFile::fail(const std::string& what, int error_number) {
  throw FileError(path_ + ": " + what + ": " + std::strerror(error_number));
}

void AtomicFile::flush() {
  std::size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t count = ::write(descriptor_, buffer_.data() + done, buffer_.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail("cannot be written", errno);
    done += static_cast<std::size_t>(count);
  }
  buffer_.clear();
}

void AtomicFile::write(const void* data, std::size_t num_bytes) {
  const char* bytes = static_cast<const char*>(data);
  while (num_bytes > 0) {
    const std::size_t count = std::min(num_bytes, kBufferBytes - buffer_.size());
    buffer_.insert(buffer_.end(), bytes, bytes + count);
    bytes += count;
    num_bytes -= count;
    if (buffer_.size() == kBufferBytes) flush();
  }
}

void AtomicFile::commit() {
  flush();
  if (::fsync(descriptor_) != 0) fail("cannot be flushed to disk", errno);
  const int descriptor = descriptor_;
  descriptor_ = -1;
  if (::close(descriptor) != 0) fail("cannot be closed", errno);
  if (::rename(temporary_path_.c_str(), path_.c_str()) != 0) fail("cannot be put in place", errno);
  temporary_path_.clear();
  // The new name must survive a power cut too. Some file systems cannot sync a directory; the file itself is safe.
  const int directory = ::open(directory_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory >= 0) {
    ::fsync(directory);
    ::close(directory);
  }
}

void requireUsablePath(const std::string& path) {
  namespace fs = std::filesystem;
  const fs::path file(path);
  std::error_code ignored;
  if (!file.is_absolute()) throw std::invalid_argument("'" + path + "', must be an absolute path");
  if (!file.has_filename() || fs::is_directory(file, ignored)) {
    throw std::invalid_argument("'" + path + "', must name a file, not a folder");
  }
  if (!fs::is_directory(file.parent_path(), ignored)) {
    throw std::invalid_argument("'" + path + "', must be in a folder that exists; " + file.parent_path().string() +
                                " does not");
  }
}

}  // namespace interactive_mapping
