// SPDX-License-Identifier: BSD-3-Clause
#include "sequence_input.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <system_error>

#include <interactive_mapping_common/formatted.h>

#include "tool_support.h"

namespace gpis_mapping {
namespace po = boost::program_options;

void requireAtLeast(const char* option, long long value, long long least) {
  if (value >= least) return;
  throw UsageError(std::string(option) + " = " + std::to_string(value) + ", must be at least " + std::to_string(least));
}

void SequenceInput::addOptions(po::options_description* options) {
  options->add_options()                                                         //
      ("start", po::value(&start_), "first frame, counted from 0 (default 0)")   //
      ("end", po::value(&end_), "last frame, included (default: the last one)")  //
      ("depth-units", po::value<double>(),
       "units per metre of 16-bit images (default: TUM 5000 or as its camera_info.yaml says, else 1000)")  //
      ("depth-topic", po::value(&bag_.depth_topic), "bag: depth images (default: the only ones)")          //
      ("info-topic", po::value(&bag_.info_topic), "bag: camera info (default: beside the images)")         //
      ("map-frame", po::value(&bag_.map_frame)->default_value(bag_.map_frame), "bag: fixed frame");
}

bool SequenceInput::parse(int argc, char** argv, const po::options_description& options, const std::string& usage,
                          po::variables_map* values) {
  po::options_description all;
  all.add(options).add_options()("input", po::value(&path_));
  po::positional_options_description positional;
  positional.add("input", 1);
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), *values);
  if (values->count("help") > 0) {
    std::cout << usage << options;
    return false;
  }
  po::notify(*values);
  if (path_.empty()) throw UsageError("INPUT is missing");
  requireAtLeast("--start", start_, 0);
  if (values->count("end") > 0) requireAtLeast("--end", end_, start_);
  if (values->count("depth-units") > 0) {
    const double units = (*values)["depth-units"].as<double>();
    if (!(units >= 1.0 && units <= 1e6)) {  // NaN, too
      throw UsageError(interactive_mapping::formatted("--depth-units = %.4g 1/m, must be in [1, 1e+06] 1/m", units));
    }
    units_per_metre_ = units;
    bag_.units_per_metre = units;
  }
  return true;
}

std::unique_ptr<DepthSequence> SequenceInput::open(const std::string& tool) {
  std::error_code ignored;
  const bool is_file = std::filesystem::is_regular_file(path_, ignored);
  if (is_file && !gpis_mapping_ros::looksLikeBag(path_)) {
    throw DepthSequenceError(path_ +
                             ": is neither a ROS bag (#ROSBAG V2.0) nor a folder in TUM RGB-D or 7-Scenes layout");
  }
  std::unique_ptr<DepthSequence> sequence =
      is_file ? gpis_mapping_ros::openBagSequence(path_, bag_) : openDepthSequence(path_, units_per_metre_);
  if (sequence->size() == 0) throw DepthSequenceError(path_ + ": holds no depth image");
  last_ = sequence->size() - 1;
  if (first() > last_) {
    throw UsageError("--start = " + std::to_string(start_) + ", must be in [0, " + std::to_string(last_) + "]");
  }
  if (end_ > static_cast<long long>(last_)) {
    std::fprintf(stderr, "%s: note: --end = %lld is past the last frame, %zu\n", tool.c_str(), end_, last_);
  } else if (end_ >= 0) {
    last_ = static_cast<std::size_t>(end_);
  }
  return sequence;
}

}  // namespace gpis_mapping
