// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/clock_trace.h"

#include <iomanip>
#include <stdexcept>

namespace simulated_world {
namespace {

constexpr double kBin_s = 0.2;  // an image a second and the ticks between two stay apart, and the file small

}  // namespace

ClockTrace::ClockTrace(const std::string& folder) : path_(folder + "/clock.csv"), rows_(path_) {
  rows_ << "time_s,waited_for,wall_s\n" << std::fixed;
  if (!rows_) throw std::runtime_error(path_ + ": cannot write");
}

ClockTrace::~ClockTrace() {
  write();
}

void ClockTrace::enter(double wall_s, const std::string& what) {
  if (!what_.empty()) wall_s_[what_] += wall_s - since_wall_s_;
  what_ = what;
  since_wall_s_ = wall_s;
}

void ClockTrace::reach(double time_s, double wall_s) {
  if (time_s < bin_s_ + kBin_s - 1e-9) return;
  enter(wall_s, what_);
  write();
  if (!rows_) throw std::runtime_error(path_ + ": cannot write");
  bin_s_ = time_s;
}

void ClockTrace::write() {
  for (const auto& [what, wall_s] : wall_s_) {
    rows_ << std::setprecision(3) << bin_s_ << ',' << what << ',' << std::setprecision(5) << wall_s << '\n';
  }
  wall_s_.clear();
  rows_.flush();
}

}  // namespace simulated_world
