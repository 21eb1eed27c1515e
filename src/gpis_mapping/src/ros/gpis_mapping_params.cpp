// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <interactive_mapping_common/files/atomic_file.h>
#include <ros/names.h>

#include <interactive_mapping_common_ros/params.h>

namespace gpis_mapping_ros {

std::vector<std::string> GpisMappingParams::validate() const {
  std::vector<std::string> problems = interactive_mapping::problemsOf(GpisMappingParamsWithMap{*this});
  for (std::size_t i = 0; i < more_depth_topics.size(); ++i) {
    const std::string& topic = more_depth_topics[i];
    std::string why_not;
    const bool is_twice = std::count(more_depth_topics.begin(), more_depth_topics.end(), topic) > 1;
    if (!topic.empty() && topic[0] != '~' && ros::names::validate(topic, why_not) && !is_twice) continue;
    problems.push_back("more_depth_topics[" + std::to_string(i) + "] = '" + topic + "', must be " +
                       (is_twice ? "there once" : "the name of a topic"));
  }
  if (!storage.autosave_file.empty()) {
    try {
      // The folder of a run may be new: who comes first makes it.
      std::error_code ignored;
      const std::filesystem::path file(storage.autosave_file);
      if (file.is_absolute()) std::filesystem::create_directory(file.parent_path(), ignored);
      interactive_mapping::requireUsablePath(storage.autosave_file);
    } catch (const std::invalid_argument& error) {
      problems.push_back(std::string("storage/autosave_file = ") + error.what());
    }
  }
  return problems;
}

GpisMappingParams loadGpisMappingParams(const ros::NodeHandle& private_nh) {
  GpisMappingParamsWithMap params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  GpisMappingParamsWithMap::fields(params, reader.fields());
  reader.fields().ignore("image_transport");  // read by image_transport
  reader.finish(params.validate());
  return params;
}

}  // namespace gpis_mapping_ros
