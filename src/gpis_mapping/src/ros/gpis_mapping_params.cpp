// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <filesystem>
#include <stdexcept>

#include <interactive_mapping_common_ros/params.h>

namespace gpis_mapping_ros {

std::vector<std::string> GpisMappingParams::validate() const {
  interactive_mapping::FieldChecker checker;
  GpisMappingParams copy = *this;
  fields(copy, checker);
  checker.section("map", copy.map);
  if (!storage.autosave_file.empty()) {
    try {
      // The folder of a run may be new: who comes first makes it.
      std::error_code ignored;
      const std::filesystem::path file(storage.autosave_file);
      if (file.is_absolute()) std::filesystem::create_directory(file.parent_path(), ignored);
      requireUsablePath(storage.autosave_file);
    } catch (const std::invalid_argument& error) {
      checker.problems.push_back(std::string("storage/autosave_file = ") + error.what());
    }
  }
  return checker.problems;
}

GpisMappingParams loadGpisMappingParams(const ros::NodeHandle& private_nh) {
  GpisMappingParams params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  GpisMappingParams::fields(params, reader.fields());
  reader.fields().section("map", params.map);
  reader.fields().ignore("tune");             // dynamic_reconfigure
  reader.fields().ignore("image_transport");  // read by image_transport
  reader.finish(params.validate());
  return params;
}

void requireUsablePath(const std::string& path) {
  namespace fs = std::filesystem;
  const fs::path file(path);
  std::error_code ignored;
  if (!file.is_absolute()) throw std::invalid_argument("'" + path + "', must be an absolute path");
  if (!file.has_filename() || fs::is_directory(file, ignored)) {
    throw std::invalid_argument("'" + path + "', must name a file, not a folder");
  }
  if (!fs::is_directory(file.parent_path(), ignored)) {
    throw std::invalid_argument("'" + path + "', must be in a folder that exists; " + file.parent_path().string() +
                                " does not");
  }
}

}  // namespace gpis_mapping_ros
