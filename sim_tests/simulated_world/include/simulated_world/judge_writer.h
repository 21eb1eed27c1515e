// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <fstream>
#include <string>

#include "simulated_world/judge.h"

namespace simulated_world {

/// Keeps what a judge saw in a run's folder: judge.csv (a row per second and per event), events.jsonl (an object per
/// event) and at the end judge.json. Every line is complete and with the system before the next one is begun, so the
/// files can be used however the process ends. All members throw std::runtime_error with the path and the reason.
class JudgeWriter {
 public:
  /// Makes the folder if need be. An earlier run's files there are refused rather than overwritten.
  explicit JudgeWriter(const std::string& folder);

  /// Appends what the judge has come to know since the last call; always the same judge. `digest`: the world's, now.
  void write(const Judge& judge, std::uint64_t digest);

  /// Appends the rest and writes judge.json, whole or not at all.
  void finish(const Judge& judge, std::uint64_t digest);

 private:
  std::string folder_;
  std::ofstream rows_;
  std::ofstream events_;
  std::size_t num_rows_{0};
  std::size_t num_events_{0};
};

}  // namespace simulated_world
