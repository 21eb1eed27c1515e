// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TOOL_SUPPORT_H
#define GPIS_MAPPING_TOOL_SUPPORT_H

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace gpis_mapping {

// Exit codes of the command-line tools.
constexpr int kExitOk = 0;
constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;
constexpr int kExitInterrupted = 130;  // 128 + SIGINT, as shells report it

/// A command line that asks for something impossible.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// `text` on one line: line breaks and the indent after them become one blank.
std::string onOneLine(const std::string& text);

/// Value below which the share `quantile` of the samples lies, interpolated between samples. 0 for no samples.
double quantile(std::vector<double> samples, double quantile);

/// Runs a tool's main function; what it throws becomes one line on stderr and an exit code.
int runTool(const std::string& name, int argc, char** argv, int (*tool)(int argc, char** argv));

/// A line on stderr that says how far a loop is, how fast, and how long it will take. On a terminal it is redrawn in
/// place; elsewhere a line is written about every 5 %.
class ProgressBar {
 public:
  ProgressBar(std::size_t total, bool is_quiet);
  void update(std::size_t done);
  /// Ends the line on a terminal, so that other messages start on a new one.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;

  std::size_t total_;
  bool is_quiet_;
  bool is_terminal_;
  bool is_line_open_{false};
  std::size_t last_step_{0};
  Clock::time_point begin_;
  Clock::time_point last_drawn_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_TOOL_SUPPORT_H
