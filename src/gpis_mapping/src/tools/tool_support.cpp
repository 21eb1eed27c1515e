// SPDX-License-Identifier: BSD-3-Clause
#include "tool_support.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <new>

#include <boost/program_options/errors.hpp>

namespace gpis_mapping {

std::string onOneLine(const std::string& text) {
  std::string line;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\n' && text[i] != '\r') {
      line += text[i];
      continue;
    }
    while (i + 1 < text.size() && (text[i + 1] == ' ' || text[i + 1] == '\n' || text[i + 1] == '\r')) ++i;
    if (i + 1 < text.size()) line += !line.empty() && line.back() == ':' ? " " : "; ";
  }
  return line;
}

double quantile(std::vector<double> samples, double quantile) {
  if (samples.empty()) return 0.0;
  std::sort(samples.begin(), samples.end());
  const double at = quantile * static_cast<double>(samples.size() - 1);
  const auto low = static_cast<std::size_t>(std::floor(at));
  const std::size_t high = std::min(low + 1, samples.size() - 1);
  return samples[low] + (at - static_cast<double>(low)) * (samples[high] - samples[low]);
}

int runTool(const std::string& name, int argc, char** argv, int (*tool)(int argc, char** argv)) {
  const auto report = [&name](const std::string& text) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), onOneLine(text).c_str());
  };
  try {
    return tool(argc, argv);
  } catch (const UsageError& error) {
    report(std::string(error.what()) + " (--help explains)");
    return kExitUsage;
  } catch (const boost::program_options::error& error) {
    report(std::string(error.what()) + " (--help explains)");
    return kExitUsage;
  } catch (const std::bad_alloc&) {
    report("not enough memory");
  } catch (const std::exception& error) {
    report(error.what());
  } catch (...) {
    report("unknown error");
  }
  return kExitFailure;
}

ProgressBar::ProgressBar(std::size_t total, bool is_quiet)
    : total_(total),
      is_quiet_(is_quiet),
      is_terminal_(::isatty(STDERR_FILENO) == 1),
      begin_(Clock::now()),
      last_drawn_(begin_) {}

void ProgressBar::update(std::size_t done) {
  if (is_quiet_ || total_ == 0) return;
  const Clock::time_point now = Clock::now();
  const bool is_last = done >= total_;
  if (is_terminal_) {
    if (!is_last && now - last_drawn_ < std::chrono::milliseconds(100)) return;
  } else {
    const std::size_t step = 20 * done / total_;
    if (step == last_step_) return;
    last_step_ = step;
  }
  last_drawn_ = now;
  const double seconds = std::chrono::duration<double>(now - begin_).count();
  const double rate = seconds > 0.0 ? static_cast<double>(done) / seconds : 0.0;
  const double left_s = rate > 0.0 ? static_cast<double>(total_ - done) / rate : 0.0;
  constexpr int kWidth = 30;
  const int filled = static_cast<int>(kWidth * done / total_);
  const std::string bar =
      std::string(static_cast<std::size_t>(filled), '#') + std::string(static_cast<std::size_t>(kWidth - filled), '.');
  std::fprintf(stderr, "%s[%s] %zu/%zu  %3.0f %%  %.1f/s  ETA %.0f s%s", is_terminal_ ? "\r" : "", bar.c_str(), done,
               total_, 100.0 * static_cast<double>(done) / static_cast<double>(total_), rate, left_s,
               is_terminal_ ? "   " : "\n");
  is_line_open_ = is_terminal_;
}

void ProgressBar::finish() {
  if (is_line_open_) std::fputc('\n', stderr);
  is_line_open_ = false;
}

}  // namespace gpis_mapping
