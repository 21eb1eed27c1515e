// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_SEQUENCE_INPUT_H
#define GPIS_MAPPING_SEQUENCE_INPUT_H

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include <boost/program_options.hpp>

#include "gpis_mapping/depth_sequence.h"
#include "gpis_mapping_ros/bag_sequence.h"

namespace gpis_mapping {

/// The recorded depth images that a tool reads, and which of them: the positional INPUT and its options.
class SequenceInput {
 public:
  /// Adds --start, --end, --depth-units and those of bags.
  void addOptions(boost::program_options::options_description* options);

  /// Parses INPUT and `options` (with `help`). False when only help was asked for: `usage` and the options were printed.
  /// Throws UsageError and program_options::error.
  bool parse(int argc, char** argv, const boost::program_options::options_description& options,
             const std::string& usage, boost::program_options::variables_map* values);

  /// Opens INPUT and sets `first` and `last`; a note on stderr, in the name of `tool`, if --end is past the last frame.
  /// Throws DepthSequenceError if it cannot be read or holds no image, UsageError if --start is past the last frame.
  std::unique_ptr<DepthSequence> open(const std::string& tool);

  const std::string& path() const { return path_; }
  std::size_t first() const { return static_cast<std::size_t>(start_); }
  std::size_t last() const { return last_; }

 private:
  std::string path_;
  long long start_{0};
  long long end_{-1};  // -1: the last frame
  std::size_t last_{0};
  std::optional<double> units_per_metre_;
  gpis_mapping_ros::BagOptions bag_;
};

/// Throws UsageError unless `value` is at least `least`.
void requireAtLeast(const char* option, long long value, long long least);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_SEQUENCE_INPUT_H
