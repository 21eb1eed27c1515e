// SPDX-License-Identifier: BSD-3-Clause
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include <interactive_mapping_common/files/atomic_file.h>
#include <interactive_mapping_common/formatted.h>
#include "gpis_mapping/depth_sequence.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/ply.h"
#include "gpis_mapping/recording_guard.h"
#include "sequence_input.h"
#include "tool_support.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::FileError;
using interactive_mapping::formatted;

namespace fs = std::filesystem;
namespace po = boost::program_options;
using Clock = std::chrono::steady_clock;

constexpr const char* kTimingFile = "timing.csv";

volatile std::sig_atomic_t interrupted = 0;

void onInterrupt(int signal_number) {
  interrupted = 1;
  std::signal(signal_number, SIG_DFL);  // a second one ends the program at once
}

double millisecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

std::string onePrinted(double value) {
  return formatted("%.4g", value);
}

struct Options {
  SequenceInput input;
  std::string out;
  std::string config;
  long long stride{1};
  long long mesh_every{0};  // 0: only at the end
  double time_offset_s{0.0};
  bool is_quiet{false};
  bool trusts_poses{false};
};

/// Nothing when only help was asked for.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  visible.add_options()                                                                                 //
      ("help,h", "show this text")                                                                      //
      ("out", po::value(&options.out), "folder for mesh.ply, map.gpis, timing.csv; made if missing")    //
      ("config", po::value(&options.config), "map configuration (YAML); default: built-in values")      //
      ("stride", po::value(&options.stride), "take every N-th frame (default 1)")                       //
      ("mesh-every", po::value(&options.mesh_every), "also write mesh_FRAME.ply after every N frames")  //
      ("no-pose-check", po::bool_switch(&options.trusts_poses),
       "map frames whose pose the camera cannot have moved to")                                        //
      ("time-offset", po::value(&options.time_offset_s), "added to image stamps for their poses [s]")  //
      ("quiet,q", po::bool_switch(&options.is_quiet), "no progress on stderr");
  options.input.addOptions(&visible);
  po::variables_map values;
  const bool is_asked =
      options.input.parse(argc, argv, visible,
                          "Usage: map_sequence INPUT --out DIR [options]\n"
                          "Builds a map from recorded depth images. INPUT is a TUM RGB-D folder, a 7-Scenes folder or "
                          "a ROS\nbag. Frames are counted from 0 in recorded order; --start and --end are both "
                          "included. The last\nline of the output is a summary as one JSON object.\n"
                          "Exit code: 0 done, 1 failure, 2 wrong usage, 130 interrupted (what there was is saved).\n\n",
                          &values);
  if (!is_asked) return std::nullopt;
  if (options.out.empty()) throw UsageError("--out DIR is missing");
  requireAtLeast("--stride", options.stride, 1);
  if (!(std::abs(options.time_offset_s) <= 1.0)) {  // NaN, too
    throw UsageError("--time-offset = " + std::to_string(options.time_offset_s) + " s, must be in [-1, 1] s");
  }
  if (values.count("mesh-every") > 0) requireAtLeast("--mesh-every", options.mesh_every, 1);
  return options;
}

/// Writes one row per frame and flushes it, so that an interrupted run keeps what was measured.
class TimingTable {
 public:
  explicit TimingTable(const std::string& path) : path_(path), file_(std::fopen(path.c_str(), "w")) {
    if (file_ == nullptr) throw FileError(path + ": cannot be written: " + std::strerror(errno));
    std::fputs(
        "frame,total_ms,classify_ms,regress_ms,fuse_ms,insert_ms,train_ms,observe_ms,publish_ms,points_in,inserted,"
        "fused,deleted,map_points,cells_retrained\n",
        file_);
    flush();
  }
  ~TimingTable() { std::fclose(file_); }
  TimingTable(const TimingTable&) = delete;
  TimingTable& operator=(const TimingTable&) = delete;

  void add(std::size_t frame, const UpdateStatistics& s) {
    std::fprintf(file_, "%zu,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%zu,%zu,%zu,%zu,%zu,%zu\n", frame, s.total_ms,
                 s.classify_ms, s.regress_ms, s.fuse_ms, s.insert_ms, s.train_ms, s.observe_ms, s.publish_ms,
                 s.points_in, s.inserted, s.fused, s.deleted, s.map_points, s.cells_retrained);
    flush();
  }

 private:
  void flush() {
    if (std::fflush(file_) != 0) throw FileError(path_ + ": cannot be written: " + std::strerror(errno));
  }

  std::string path_;
  std::FILE* file_;
};

/// Frames left out, counted by kind of trouble.
class SkipCounter {
 public:
  void add(std::size_t frame, const SkipReason& reason) {
    auto [entry, is_new] = kinds_.try_emplace(reason.kind);
    if (is_new) entry->second = {0, frame, reason.detail};
    ++entry->second.count;
    ++total_;
  }
  std::size_t total() const { return total_; }
  std::string text() const {
    std::string text;
    for (const auto& [kind, group] : kinds_) {
      text += (text.empty() ? "" : "; ") + std::to_string(group.count) + " x " + kind + " (frame " +
              std::to_string(group.first_frame) + ": " + group.first_detail + ")";
    }
    return text;
  }
  nlohmann::json json() const {
    nlohmann::json list = nlohmann::json::array();
    for (const auto& [kind, group] : kinds_) {
      list.push_back({{"reason", kind},
                      {"count", group.count},
                      {"first_frame", group.first_frame},
                      {"first_detail", onOneLine(group.first_detail)}});
    }
    return list;
  }

 private:
  struct Group {
    std::size_t count;
    std::size_t first_frame;
    std::string first_detail;
  };

  std::map<std::string, Group> kinds_;
  std::size_t total_{0};
};

void say(ProgressBar* progress, const std::string& text) {
  if (progress != nullptr) progress->finish();
  std::fprintf(stderr, "map_sequence: %s\n", onOneLine(text).c_str());
}

void makeFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw FileError(path + ": folder cannot be made: " + error.message());
  if (!fs::is_directory(path)) throw FileError(path + ": is not a folder");
}

double peakMemoryMb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024.0 / 1e6;  // ru_maxrss is in KiB
}

std::string meshName(std::size_t frame) {
  return formatted("mesh_%06zu.ply", frame);
}

/// Which depths were measured, for a map that stays empty.
class DepthRange {
 public:
  void add(const DepthImage& image) {
    for (const float z : image.depth_m) {
      if (!(z > 0.0f) || std::isinf(z)) continue;
      nearest_m_ = std::min(nearest_m_, z);
      farthest_m_ = std::max(farthest_m_, z);
    }
  }
  /// Why no frame of `frames` left a point in the map.
  std::string whyNothingIsMapped(std::size_t frames, const GpisConfig& config) const {
    std::string text = "no surface was mapped from " + std::to_string(frames) + " frame(s)";
    if (nearest_m_ > farthest_m_) return text + ": no pixel holds a depth";
    const bool is_in_range = farthest_m_ >= config.sensor.min_range_m && nearest_m_ <= config.sensor.max_range_m;
    text += is_in_range ? ": no measurement within region, and connected;" : ": no measurement in range;";
    return text + " depths were " + onePrinted(nearest_m_) + " to " + onePrinted(farthest_m_) +
           " m, sensor/min_range_m is " + onePrinted(config.sensor.min_range_m) + ", max_range_m " +
           onePrinted(config.sensor.max_range_m) + ". Are the units per metre (--depth-units) right?";
  }

 private:
  float nearest_m_{std::numeric_limits<float>::infinity()};
  float farthest_m_{0.0f};
};

/// What the frames of a recording gave.
struct Mapped {
  explicit Mapped(const GpisConfig& config) : map(config), extractor(config) {}

  GpisMap map;
  MeshExtractor extractor;
  std::vector<double> update_ms;
  SkipCounter skipped;
  DepthRange depths;
  std::size_t num_settled_jumps{0};
  std::size_t num_read{0};
  std::string failure;  // after which nothing more was read; empty: none
};

/// Until the last frame, a signal, or a failure that is more than one bad frame.
void mapFrames(const Options& options, DepthSequence* sequence, TimingTable* timing, Mapped* mapped) {
  std::vector<std::size_t> frames;
  for (std::size_t i = options.input.first(); i <= options.input.last();
       i += static_cast<std::size_t>(options.stride)) {
    frames.push_back(i);
  }
  RecordingGuard guard(sequence, frames,
                       options.trusts_poses ? std::nullopt : std::make_optional(depth_camera::PoseLimits{}));
  ProgressBar progress(frames.size(), options.is_quiet);
  for (const std::size_t i : frames) {
    if (interrupted != 0) break;
    try {
      SkipReason reason;
      const std::optional<DepthFrame> frame = sequence->frame(i, &reason);
      const std::optional<SkipReason> refusal = frame ? guard.check(*frame) : reason;
      if (!refusal) {
        mapped->depths.add(frame->image);
        const UpdateStatistics statistics =
            mapped->map.update(frame->image, sequence->camera(), frame->T_map_camera, frame->stamp_s);
        timing->add(i, statistics);
        mapped->update_ms.push_back(statistics.total_ms);
        if (options.mesh_every > 0 && mapped->update_ms.size() % static_cast<std::size_t>(options.mesh_every) == 0) {
          mapped->extractor.update(*mapped->map.snapshot());
          writePly(mapped->extractor.mesh(), (fs::path(options.out) / meshName(i)).string());
        }
      } else {
        mapped->skipped.add(i, *refusal);
      }
    } catch (const DepthSequenceError& error) {
      mapped->skipped.add(i, {"frame cannot be used", error.what()});  // one bad file does not end a recording
    } catch (const std::invalid_argument& error) {
      mapped->skipped.add(i, {"frame refused by the map", error.what()});
    } catch (const std::exception& error) {
      mapped->failure = "frame " + std::to_string(i) + ": " + error.what();
      break;
    }
    progress.update(++mapped->num_read);
  }
  progress.finish();
  mapped->num_settled_jumps = guard.numSettledJumps();
}

/// Says what went wrong with some of the frames. Throws if there is nothing to save.
void reportTrouble(const Mapped& mapped, const std::string& input, const GpisConfig& config) {
  if (interrupted != 0) {
    say(nullptr, "interrupted after " + std::to_string(mapped.num_read) + " frames; saving what there is");
  }
  if (mapped.update_ms.empty()) {
    if (!mapped.failure.empty()) throw std::runtime_error(mapped.failure);
    if (interrupted != 0) throw std::runtime_error("interrupted before the first frame; nothing was saved");
    throw DepthSequenceError(input + ": no frame could be used: " + mapped.skipped.text());
  }
  if (mapped.skipped.total() > 0) say(nullptr, "note: skipped " + mapped.skipped.text());
  if (mapped.num_settled_jumps > 0) {
    say(nullptr, "note: " + std::to_string(mapped.num_settled_jumps) +
                     " pose jump(s) stayed and were accepted: surface that was mapped before may be doubled");
  }
  if (mapped.map.snapshot()->numPoints() == 0 && mapped.failure.empty() && interrupted == 0) {
    throw DepthSequenceError(input + ": " + mapped.depths.whyNothingIsMapped(mapped.update_ms.size(), config));
  }
}

/// Writes mesh and map; the summary of all.
nlohmann::json save(const fs::path& out, Mapped* mapped) {
  const std::string mesh_path = (out / "mesh.ply").string();
  const std::string map_path = (out / "map.gpis").string();
  const auto snapshot = mapped->map.snapshot();
  const double map_memory_mb = static_cast<double>(snapshot->memoryBytes()) / 1e6;
  const double update_peak_mb = peakMemoryMb();
  Clock::time_point begin = Clock::now();
  mapped->extractor.update(*snapshot);
  const TriangleMesh mesh = mapped->extractor.mesh();
  const double mesh_ms = millisecondsSince(begin);
  begin = Clock::now();
  saveMap(mapped->map.contents(), map_path);
  const double save_ms = millisecondsSince(begin);
  writePly(mesh, mesh_path);

  const std::vector<double>& update_ms = mapped->update_ms;
  const double sum_ms = std::accumulate(update_ms.begin(), update_ms.end(), 0.0);
  return {
      {"frames", update_ms.size()},
      {"skipped", mapped->skipped.total()},
      {"skip_reasons", mapped->skipped.json()},
      {"settled_pose_jumps", mapped->num_settled_jumps},
      {"interrupted", interrupted != 0},
      {"median_ms", quantile(update_ms, 0.5)},
      {"mean_ms", sum_ms / static_cast<double>(update_ms.size())},
      {"p95_ms", quantile(update_ms, 0.95)},
      {"max_ms", *std::max_element(update_ms.begin(), update_ms.end())},
      {"first_frame_ms", update_ms.front()},
      {"map_points", snapshot->numPoints()},
      {"cells", snapshot->cells().size()},
      {"map_memory_mb", map_memory_mb},
      {"peak_rss_mb", peakMemoryMb()},
      {"peak_rss_update_mb", update_peak_mb},
      {"mesh_vertices", mesh.vertices_map.size()},
      {"mesh_triangles", mesh.triangles.size()},
      {"mesh_ms", mesh_ms},
      {"save_ms", save_ms},
      {"outputs", {{"mesh", mesh_path}, {"map", map_path}, {"timing", (out / kTimingFile).string()}}},
  };
}

int mapSequence(int argc, char** argv) {
  std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return kExitOk;
  const GpisConfig config = options->config.empty() ? GpisConfig{} : loadGpisConfig(options->config);
  const std::unique_ptr<DepthSequence> sequence = options->input.open("map_sequence");
  sequence->setTimeOffset(options->time_offset_s);
  for (const std::string& note : sequence->notes()) say(nullptr, "note: " + note);

  makeFolder(options->out);
  TimingTable timing((fs::path(options->out) / kTimingFile).string());
  std::signal(SIGINT, onInterrupt);
  std::signal(SIGTERM, onInterrupt);
  Mapped mapped(config);
  mapFrames(*options, sequence.get(), &timing, &mapped);
  reportTrouble(mapped, options->input.path(), config);
  const nlohmann::json summary = save(options->out, &mapped);
  std::cout << summary.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
  if (mapped.failure.empty()) return interrupted == 0 ? kExitOk : kExitInterrupted;
  say(nullptr, mapped.failure + " (stopped there; what came before is saved)");
  return kExitFailure;
}

}  // namespace
}  // namespace gpis_mapping

int main(int argc, char** argv) {
  return gpis_mapping::runTool("map_sequence", argc, argv, gpis_mapping::mapSequence);
}
