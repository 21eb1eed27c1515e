// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include <yaml-cpp/yaml.h>

#include <interactive_mapping_common_ros/param_reader.h>

namespace gpis_mapping_ros {

using interactive_mapping_ros::ParamReader;

const char* toString(MeshColor color) {
  return color == MeshColor::kHeight ? "height" : "uncertainty";
}

std::vector<std::string> GpisMappingParams::validate() const {
  std::vector<std::string> problems;
  const auto check = [&problems](const char* key, double value, double lo, double hi, const char* unit) {
    if (value >= lo && value <= hi) return;  // false for NaN
    char text[160];
    std::snprintf(text, sizeof(text), "%s = %g %s, must be in [%g, %g] %s", key, value, unit, lo, hi, unit);
    problems.push_back(text);
  };
  const auto append = [&problems](const char* section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(std::string(section) + "/" + problem);
  };
  append("input", input.validate());
  append("map", map.validate());
  check("output/rate_hz", output.rate_hz, 0.05, 30.0, "Hz");
  check("output/removed_display_s", output.removed_display_s, 0.0, 3600.0, "s");
  check("output/color_max_std_m", output.color_max_std_m, 1e-4, 1.0, "m");
  check("slice/height_m", slice.height_m, -100.0, 100.0, "m");
  check("slice/cell_size_m", slice.cell_size_m, 0.005, 1.0, "m");
  check("slice/margin_m", slice.margin_m, 0.0, 10.0, "m");
  append("ground", ground.validate());
  check("attached/padding_m", attached.padding_m, 0.0, 0.1, "m");
  check("attached/pushed_m", attached.pushed_m, 0.0, 0.2, "m");
  check("storage/autosave_period_s", storage.autosave_period_s, 0.1, 86400.0, "s");
  if (!storage.autosave_file.empty()) {
    try {
      // The folder of a run may be new: who comes first makes it.
      std::error_code ignored;
      const std::filesystem::path file(storage.autosave_file);
      if (file.is_absolute()) std::filesystem::create_directory(file.parent_path(), ignored);
      requireUsablePath(storage.autosave_file);
    } catch (const std::invalid_argument& error) {
      problems.push_back(std::string("storage/autosave_file = ") + error.what());
    }
  }
  return problems;
}

std::string toYaml(const GpisMappingParams& params) {
  const DepthInputParams& input = params.input;
  YAML::Node yaml;
  yaml["input"]["map_frame"] = input.map_frame;
  yaml["input"]["camera_frame"] = input.camera_frame;
  yaml["input"]["image_transport"] = input.image_transport;
  yaml["input"]["depth_units_per_metre"] = input.depth_units_per_metre;
  yaml["input"]["tf_timeout_s"] = input.tf_timeout_s;
  yaml["input"]["time_offset_s"] = input.time_offset_s;
  yaml["input"]["max_future_s"] = input.max_future_s;
  YAML::Node limits = yaml["input"]["pose_limits"];
  limits["max_step_m"] = input.pose_limits.max_step_m;
  limits["max_step_rad"] = input.pose_limits.max_step_rad;
  limits["max_speed_mps"] = input.pose_limits.max_speed_mps;
  limits["max_turn_radps"] = input.pose_limits.max_turn_radps;
  limits["settle_frames"] = input.pose_limits.settle_frames;
  yaml["output"]["rate_hz"] = params.output.rate_hz;
  yaml["output"]["every_image"] = params.output.every_image;
  yaml["output"]["removed_display_s"] = params.output.removed_display_s;
  yaml["output"]["mesh_color"] = toString(params.output.mesh_color);
  yaml["output"]["color_max_std_m"] = params.output.color_max_std_m;
  yaml["slice"]["height_m"] = params.slice.height_m;
  yaml["slice"]["cell_size_m"] = params.slice.cell_size_m;
  yaml["slice"]["margin_m"] = params.slice.margin_m;
  yaml["ground"]["cell_size_m"] = params.ground.cell_size_m;
  yaml["ground"]["max_tilt_rad"] = params.ground.max_tilt_rad;
  yaml["ground"]["plane_tolerance_m"] = params.ground.plane_tolerance_m;
  yaml["ground"]["min_obstacle_height_m"] = params.ground.min_obstacle_height_m;
  yaml["ground"]["max_obstacle_height_m"] = params.ground.max_obstacle_height_m;
  yaml["attached"]["padding_m"] = params.attached.padding_m;
  yaml["attached"]["pushed_m"] = params.attached.pushed_m;
  yaml["storage"]["autosave_file"] = params.storage.autosave_file;
  yaml["storage"]["autosave_period_s"] = params.storage.autosave_period_s;
  yaml["storage"]["restore_on_start"] = params.storage.restore_on_start;
  return YAML::Dump(yaml);
}

GpisMappingParams loadGpisMappingParams(const ros::NodeHandle& private_nh) {
  GpisMappingParams params;
  ParamReader reader(private_nh);
  params.input.read("input", &reader);
  reader.read("output/rate_hz", &params.output.rate_hz);
  reader.read("output/every_image", &params.output.every_image);
  reader.read("output/removed_display_s", &params.output.removed_display_s);
  reader.read("output/color_max_std_m", &params.output.color_max_std_m);
  std::string color = toString(params.output.mesh_color);
  reader.read("output/mesh_color", &color);
  if (color == toString(MeshColor::kHeight)) {
    params.output.mesh_color = MeshColor::kHeight;
  } else if (color == toString(MeshColor::kUncertainty)) {
    params.output.mesh_color = MeshColor::kUncertainty;
  } else {
    reader.report("output", {"mesh_color = '" + color + "', must be uncertainty or height"});
  }
  reader.read("slice/height_m", &params.slice.height_m);
  reader.read("slice/cell_size_m", &params.slice.cell_size_m);
  reader.read("slice/margin_m", &params.slice.margin_m);
  reader.read("ground/cell_size_m", &params.ground.cell_size_m);
  reader.read("ground/max_tilt_rad", &params.ground.max_tilt_rad);
  reader.read("ground/plane_tolerance_m", &params.ground.plane_tolerance_m);
  reader.read("ground/min_obstacle_height_m", &params.ground.min_obstacle_height_m);
  reader.read("ground/max_obstacle_height_m", &params.ground.max_obstacle_height_m);
  reader.read("attached/padding_m", &params.attached.padding_m);
  reader.read("attached/pushed_m", &params.attached.pushed_m);
  reader.read("storage/autosave_file", &params.storage.autosave_file);
  reader.read("storage/autosave_period_s", &params.storage.autosave_period_s);
  reader.read("storage/restore_on_start", &params.storage.restore_on_start);
  reader.ignore("tune");               // dynamic_reconfigure
  reader.ignore("image_transport");    // read by image_transport
  reader.ignore("diagnostic_period");  // read by diagnostic_updater
  reader.ignore("diagnostic_updater");
  const std::string map_yaml = reader.yamlOf("map");
  try {
    if (!map_yaml.empty()) params.map = gpis_mapping::parseGpisConfig(map_yaml, "map");
  } catch (const std::invalid_argument& error) {
    reader.report("", {error.what()});
  }
  reader.report("", params.validate());
  reader.finish();
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
