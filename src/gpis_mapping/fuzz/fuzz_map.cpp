// SPDX-License-Identifier: BSD-3-Clause
// Feeds seeded broken input to the map and everything that reads for it. Best run under the address and undefined
// behaviour sanitizers; a failure is printed with the command that repeats it.
#include <unistd.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <iostream>
#include <string>

#include <boost/program_options.hpp>

#include "fuzz/fuzz_engine.h"

// Of the sanitizers' runtime, if there is one.
extern "C" void __sanitizer_set_death_callback(void (*callback)()) __attribute__((weak));  // NOLINT

namespace {

using gpis_mapping_fuzz::Report;
using gpis_mapping_fuzz::TargetInfo;

constexpr unsigned kHang_s = 120;  // one input takes milliseconds; a busy machine may need a hundred times that
constexpr rlim_t kMaxMemory = rlim_t{4} << 30;  // far above what these small inputs need, far below an absurd request

std::string repeat_prefix;  // "fuzz_map --target X --seed S --only "
std::atomic<std::uint64_t> current_input{0};

/// Async-signal-safe: says which input it was.
void printCurrent() {
  char digits[24];
  char* at = digits + sizeof(digits);
  *--at = '\n';
  std::uint64_t value = current_input;
  do {
    *--at = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value > 0);
  const auto say = [](const char* text, std::size_t size) {
    if (::write(STDERR_FILENO, text, size) < 0) return;
  };
  say("\nDIED at: ", 10);
  say(repeat_prefix.data(), repeat_prefix.size());
  say(at, static_cast<std::size_t>(digits + sizeof(digits) - at));
}

void onSignal(int signal) {
  if (signal == SIGALRM) {
    const char text[] = "\none input took too long\n";
    if (::write(STDERR_FILENO, text, sizeof(text) - 1) < 0) ::_exit(3);
  }
  printCurrent();
  ::_exit(3);
}

void catchDeath() {
  std::signal(SIGALRM, onSignal);
  if (__sanitizer_set_death_callback != nullptr) {
    __sanitizer_set_death_callback(printCurrent);  // the sanitizer reports first; it also has a limit on allocations
    return;
  }
  for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, onSignal);
  const rlimit limit{kMaxMemory, kMaxMemory};
  ::setrlimit(RLIMIT_AS, &limit);
}

}  // namespace

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  std::string wanted;
  std::uint64_t seed = 1;
  std::uint64_t begin = 0;
  std::uint64_t inputs = 0;
  std::uint64_t only = 0;
  std::string csv;
  po::options_description description(
      "Feeds broken input to the map; exit code 0 only if all of it was taken well. Options");
  auto add = description.add_options();
  add("help", "this text");
  add("list", "names of the targets, with their number of inputs in a full run");
  add("target", po::value(&wanted), "one target; default: all");
  add("seed", po::value(&seed)->default_value(seed), "of everything");
  add("begin", po::value(&begin)->default_value(begin), "first input");
  add("inputs", po::value(&inputs), "how many; default: that of a full run");
  add("only", po::value(&only), "this input alone (with what its episode needs before it)");
  add("csv", po::value(&csv), "append a line per target: target,seed,begin,inputs,accepted,refused,seconds,result");
  po::variables_map values;
  try {
    po::store(po::parse_command_line(argc, argv, description), values);
    po::notify(values);
    if (values.count("only") > 0 && wanted.empty()) throw po::error("--only needs --target");
  } catch (const po::error& error) {
    std::cerr << "fuzz_map: " << error.what() << '\n' << description;
    return 2;
  }
  if (values.count("help") > 0) {
    std::cout << description;
    return 0;
  }
  std::vector<TargetInfo> targets = gpis_mapping_fuzz::allTargets();
  if (values.count("list") > 0) {
    for (const TargetInfo& target : targets) std::cout << target.name << ' ' << target.inputs << '\n';
    return 0;
  }
  if (!wanted.empty()) {
    targets.erase(std::remove_if(targets.begin(), targets.end(), [&](const TargetInfo& t) { return t.name != wanted; }),
                  targets.end());
    if (targets.empty()) {
      std::cerr << "fuzz_map: there is no target " << wanted << ", see --list\n";
      return 2;
    }
  }

  catchDeath();
  int rc = 0;
  for (const TargetInfo& target : targets) {
    repeat_prefix = "fuzz_map --target " + target.name + " --seed " + std::to_string(seed) + " --only ";
    std::uint64_t first = begin;
    std::uint64_t end = begin + (values.count("inputs") > 0 ? inputs : target.inputs);
    if (values.count("only") > 0) {
      first = only;
      end = only + 1;
    }
    const auto start = std::chrono::steady_clock::now();
    const Report report = gpis_mapping_fuzz::runTarget(target, seed, first, end, [](std::uint64_t input) {
      current_input = input;
      ::alarm(kHang_s);
    });
    ::alarm(0);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::cout << target.name << ": " << report.inputs << " inputs, " << report.accepted << " accepted, "
              << report.refused << " refused, " << seconds << " s" << std::endl;
    if (!report.failure.empty()) {
      std::cout << "FAILED: " << report.failure << "\nagain with: " << repeat_prefix << report.failed_at << std::endl;
      rc = 1;
    }
    if (csv.empty()) continue;
    std::ofstream out(csv, std::ios::app);
    out << target.name << ',' << seed << ',' << first << ',' << report.inputs << ',' << report.accepted << ','
        << report.refused << ',' << seconds << ',' << (report.failure.empty() ? "passed" : "failed") << '\n';
    if (!out) {
      std::cerr << "fuzz_map: " << csv << " cannot be written\n";
      rc = 1;
    }
  }
  return rc;
}
