// SPDX-License-Identifier: BSD-3-Clause
#include "soak/endurance.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>
#include <stdexcept>

namespace soak {
namespace {

constexpr std::size_t kMinReadings = 20;
constexpr double kWarmUpShare = 0.1;

// The program of soak_map has some 57 MB on the heap: 5 % are 28 bytes per frame in 10^5 frames, less than the smallest
// thing that could be forgotten each frame (a hash map's node is 40 bytes, a point 80). At the same phase of the scene
// single readings differ by 3 %, medians of half a run by less than 1 %.
constexpr double kContentsShare = 0.05;
constexpr double kHeapShare = 0.05;
// The allocator keeps what it once had: saving and loading beside a long list of snapshots moves its high-water mark now
// and then, by 1 to 2 MB of 140.
constexpr double kResidentShare = 0.08;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Median of the slopes of all pairs: up to 29 % of outliers do not matter.
double theilSenSlope(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<double> slopes;
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t j = i + 1; j < x.size(); ++j) slopes.push_back((y[j] - y[i]) / (x[j] - x[i]));
  }
  return median(std::move(slopes));
}

Growth growthOf(const std::string& name, double allowed_share, const std::vector<Reading>& steady,
                const std::function<double(const Reading&)>& value) {
  std::vector<double> frames;
  std::vector<double> values;
  for (const Reading& reading : steady) {
    frames.push_back(static_cast<double>(reading.frame));
    values.push_back(value(reading));
  }
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  Growth growth;
  growth.name = name;
  growth.allowed_share = allowed_share;
  growth.first = median({values.begin(), half});
  growth.last = median({half, values.end()});
  const double scale = std::max(1e-9, growth.first);
  growth.slope_share = theilSenSlope(frames, values) * (frames.back() - frames.front()) / scale;
  growth.is_flat = growth.last <= (1.0 + allowed_share) * growth.first && growth.slope_share <= allowed_share;
  return growth;
}

}  // namespace

Verdict judge(const std::vector<Reading>& readings) {
  Verdict verdict;
  const std::size_t warm_up = static_cast<std::size_t>(kWarmUpShare * static_cast<double>(readings.size()));
  const std::vector<Reading> steady(readings.begin() + static_cast<std::ptrdiff_t>(warm_up), readings.end());
  if (steady.size() < kMinReadings) {
    verdict.problems.push_back(std::to_string(steady.size()) + " readings after warm-up, must be at least " +
                               std::to_string(kMinReadings));
    return verdict;
  }
  const auto add = [&](const std::string& name, double allowed, const std::function<double(const Reading&)>& value) {
    verdict.growths.push_back(growthOf(name, allowed, steady, value));
    const Growth& growth = verdict.growths.back();
    if (growth.is_flat) return;
    std::ostringstream text;
    text << name << " grew: median " << growth.first << " in the first half, " << growth.last
         << " in the last; slope over the run " << 100.0 * growth.slope_share << " %, must be at most "
         << 100.0 * allowed << " %";
    verdict.problems.push_back(text.str());
  };
  const auto count = [](std::size_t Reading::*member) {
    return [member](const Reading& r) { return static_cast<double>(r.*member); };
  };
  add("resident memory [MB]", kResidentShare, [](const Reading& r) { return r.resident_mb; });
  add("heap in use [MB]", kHeapShare, [](const Reading& r) { return r.heap_used_mb; });
  add("points", kContentsShare, count(&Reading::points));
  add("cells", kContentsShare, count(&Reading::cells));
  add("observed chunks", kContentsShare, count(&Reading::chunks));
  add("mesh pieces", kContentsShare, count(&Reading::mesh_pieces));
  // A map that stands still would be flat for another reason.
  const Reading& first = steady.front();
  const Reading& last = steady.back();
  if (last.points == 0) verdict.problems.push_back("the map is empty at the end");
  if (last.inserted <= first.inserted) verdict.problems.push_back("no point was inserted after warm-up");
  if (last.deleted <= first.deleted) verdict.problems.push_back("no point was deleted after warm-up");
  return verdict;
}

std::string toCsv(const std::vector<Reading>& readings) {
  std::ostringstream out;
  out.precision(10);
  out << "frame,resident_mb,heap_used_mb,heap_free_mb,points,cells,chunks,mesh_pieces,triangles,inserted,deleted,"
         "ms_per_frame\n";
  for (const Reading& r : readings) {
    out << r.frame << ',' << r.resident_mb << ',' << r.heap_used_mb << ',' << r.heap_free_mb << ',' << r.points << ','
        << r.cells << ',' << r.chunks << ',' << r.mesh_pieces << ',' << r.triangles << ',' << r.inserted << ','
        << r.deleted << ',' << r.ms_per_frame << '\n';
  }
  return out.str();
}

std::vector<Reading> fromCsv(const std::string& text) {
  std::istringstream in(text);
  std::string line;
  std::getline(in, line);
  std::vector<Reading> readings;
  for (std::size_t number = 2; std::getline(in, line); ++number) {
    std::istringstream fields(line);
    Reading r;
    char c = 0;
    fields >> r.frame >> c >> r.resident_mb >> c >> r.heap_used_mb >> c >> r.heap_free_mb >> c >> r.points >> c >>
        r.cells >> c >> r.chunks >> c >> r.mesh_pieces >> c >> r.triangles >> c >> r.inserted >> c >> r.deleted >> c >>
        r.ms_per_frame;
    if (!fields) throw std::invalid_argument("line " + std::to_string(number) + " is no reading: " + line);
    readings.push_back(r);
  }
  return readings;
}

}  // namespace soak
