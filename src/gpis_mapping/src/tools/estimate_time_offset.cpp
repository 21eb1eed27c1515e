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
#include "sequence_input.h"
#include "tool_support.h"

namespace gpis_mapping {
namespace {

namespace po = boost::program_options;

int estimate(int argc, char** argv) {
  SequenceInput input;
  po::options_description options("Options");
  options.add_options()("help,h", "show this text");
  input.addOptions(&options);
  po::variables_map values;
  const bool is_asked = input.parse(
      argc, argv, options,
      "Usage: estimate_time_offset INPUT [options]\n"
      "Estimates the clock offset between depth images and poses of a TUM RGB-D folder or a ROS bag, from\n"
      "pairs of images. The scene must be at rest and the camera must move, best to and fro. The last line\n"
      "of the output is a JSON object; its time_offset_s is for map_sequence --time-offset and for\n"
      "input/time_offset_s. Exit code: 0 done, 1 failure, 2 wrong usage.\n\n",
      &values);
  if (!is_asked) return kExitOk;
  const std::unique_ptr<DepthSequence> sequence = input.open("estimate_time_offset");
  const TimeOffsetEstimate result = estimateTimeOffset(sequence.get(), input.first(), input.last());
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
