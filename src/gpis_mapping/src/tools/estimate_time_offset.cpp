// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <string>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "gpis_mapping/depth_sequence.h"
#include "gpis_mapping/time_offset.h"
#include "gpis_mapping_ros/bag_sequence.h"
#include "tool_support.h"

namespace gpis_mapping {
namespace {

namespace po = boost::program_options;

struct Options {
  std::string input;
  long long start{0};
  long long end{-1};  // -1: the last frame
  std::optional<double> units_per_metre;
  gpis_mapping_ros::BagOptions bag;
};

/// Nothing when only help was asked for.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  visible.add_options()                                                                 //
      ("help,h", "show this text")                                                      //
      ("start", po::value(&options.start), "first frame, counted from 0 (default 0)")   //
      ("end", po::value(&options.end), "last frame, included (default: the last one)")  //
      ("depth-units", po::value<double>(),
       "units per metre of 16-bit images (default: TUM 5000 or as its camera_info.yaml says, else 1000)")  //
      ("depth-topic", po::value(&options.bag.depth_topic), "bag: depth images (default: the only ones)")   //
      ("info-topic", po::value(&options.bag.info_topic), "bag: camera info (default: beside the images)")  //
      ("map-frame", po::value(&options.bag.map_frame)->default_value(options.bag.map_frame), "bag: fixed frame");
  po::options_description all;
  all.add(visible).add_options()("input", po::value(&options.input));
  po::positional_options_description positional;
  positional.add("input", 1);
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), values);
  if (values.count("help") > 0) {
    std::cout << "Usage: estimate_time_offset INPUT [options]\n"
                 "Estimates the clock offset between depth images and poses of a TUM RGB-D folder or a ROS bag, from\n"
                 "pairs of images. The scene must be at rest and the camera must move, best to and fro. The last line\n"
                 "of the output is a JSON object; its time_offset_s is for map_sequence --time-offset and for\n"
                 "input/time_offset_s. Exit code: 0 done, 1 failure, 2 wrong usage.\n\n"
              << visible;
    return std::nullopt;
  }
  po::notify(values);
  if (options.input.empty()) throw UsageError("INPUT is missing");
  if (options.start < 0) throw UsageError("--start = " + std::to_string(options.start) + ", must be at least 0");
  if (values.count("end") > 0 && options.end < options.start) {
    throw UsageError("--end = " + std::to_string(options.end) + ", must be at least " + std::to_string(options.start));
  }
  if (values.count("depth-units") > 0) {
    options.units_per_metre = requireDepthUnits(values["depth-units"].as<double>());
    options.bag.units_per_metre = *options.units_per_metre;
  }
  return options;
}

int estimate(int argc, char** argv) {
  const std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return kExitOk;
  const std::unique_ptr<DepthSequence> sequence = gpis_mapping_ros::looksLikeBag(options->input)
                                                      ? gpis_mapping_ros::openBagSequence(options->input, options->bag)
                                                      : openDepthSequence(options->input, options->units_per_metre);
  if (sequence->size() == 0) throw DepthSequenceError(options->input + ": holds no depth image");
  const auto start = static_cast<std::size_t>(options->start);
  const std::size_t last = sequence->size() - 1;
  if (start > last) {
    throw UsageError("--start = " + std::to_string(start) + ", must be in [0, " + std::to_string(last) + "]");
  }
  const std::size_t end = options->end < 0 ? last : std::min(last, static_cast<std::size_t>(options->end));
  const TimeOffsetEstimate result = estimateTimeOffset(sequence.get(), start, end);
  std::printf("time offset %.1f ms, standard deviation of %zu parts of the recording %.1f ms\n", 1e3 * result.offset_s,
              result.num_parts, 1e3 * result.spread_s);
  std::printf("mean difference of depths in %zu pairs of images: %.2f mm without, %.2f mm with the offset\n",
              result.num_pairs, 1e3 * result.residual_at_zero_m, 1e3 * result.residual_m);
  std::fflush(stdout);
  const nlohmann::json summary = {{"time_offset_s", result.offset_s},
                                  {"spread_s", result.spread_s},
                                  {"residual_at_zero_m", result.residual_at_zero_m},
                                  {"residual_m", result.residual_m},
                                  {"pairs", result.num_pairs},
                                  {"parts", result.num_parts}};
  std::cout << summary.dump() << std::endl;
  return kExitOk;
}

}  // namespace
}  // namespace gpis_mapping

int main(int argc, char** argv) {
  return gpis_mapping::runTool("estimate_time_offset", argc, argv, gpis_mapping::estimate);
}
