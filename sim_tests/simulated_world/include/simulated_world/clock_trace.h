// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fstream>
#include <map>
#include <string>

namespace simulated_world {

/// Where the wall time of a run goes: clock.csv of its folder, rows `time_s,waited_for,wall_s`. Each row is the wall time
/// in 0.2 s of simulated time from time_s on, during which the clock waited for one topic or action; "world" is the
/// world's own work. Throws std::runtime_error if the file cannot be written.
class ClockTrace {
 public:
  explicit ClockTrace(const std::string& folder);
  ~ClockTrace();

  /// From now on, by the wall clock [s], the clock waits for this.
  void enter(double wall_s, const std::string& what);

  /// The simulated clock shows this time [s] now.
  void reach(double time_s, double wall_s);

 private:
  void write();

  std::string path_;
  std::ofstream rows_;
  std::map<std::string, double> wall_s_;  // of the bin
  std::string what_;                      // empty: not begun
  double since_wall_s_{0.0};
  double bin_s_{0.0};  // where the bin begins
};

}  // namespace simulated_world
