// SPDX-License-Identifier: BSD-3-Clause
// What an endless run of the map is judged by.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace soak {

/// State of the run after so many frames.
struct Reading {
  std::uint64_t frame{0};
  double resident_mb{0.0};   // what the system sees
  double heap_used_mb{0.0};  // handed out by malloc: the map and everything beside it
  double heap_free_mb{0.0};  // on malloc's free lists: fragmentation
  std::size_t points{0};
  std::size_t cells{0};
  std::size_t chunks{0};  // of the layer of observed space
  std::size_t mesh_pieces{0};
  std::size_t triangles{0};
  std::uint64_t inserted{0};  // since the start
  std::uint64_t deleted{0};
  double ms_per_frame{0.0};  // map update alone, mean since the last reading
};

/// How much one quantity grew from the first to the last half of a run without its warm-up.
struct Growth {
  std::string name;
  double first{0.0};        // median of the first half
  double last{0.0};         // median of the last half
  double slope_share{0.0};  // Theil-Sen slope times the length of the run, as a share of `first`
  double allowed_share{0.0};
  bool is_flat{false};
};

struct Verdict {
  std::vector<Growth> growths;
  std::vector<std::string> problems;  // empty: the run was as it must be

  bool passed() const { return problems.empty(); }
};

/// Judges readings taken at the same phase of a periodic scene. The first tenth is warm-up: caches fill, the parts of
/// the scene that are seldom seen are found.
Verdict judge(const std::vector<Reading>& readings);

/// The readings as CSV with a header line.
std::string toCsv(const std::vector<Reading>& readings);

/// The reverse; throws std::invalid_argument naming the line that is none.
std::vector<Reading> fromCsv(const std::string& text);

}  // namespace soak
