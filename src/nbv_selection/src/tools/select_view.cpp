// SPDX-License-Identifier: BSD-3-Clause
// The next best view of a saved map, without a roscore: for looking at attributes, and for choosing their logistics.
#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <gpis_mapping/depth_sequence.h>
#include <gpis_mapping/gpis_map.h>
#include <gpis_mapping/map_io.h>
#include <interactive_mapping_common/files/atomic_file.h>
#include <motion_planning/arm_kinematics.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/robot_model.h>
#include <mp700_ur5e_description/robot_names.h>
#include <nlohmann/json.hpp>
#include <octomap_baseline/dynamic_octomap.h>
#include <octomap_baseline/tree_projection.h>
#include <ros/package.h>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"

namespace nbv_selection {
namespace {

namespace po = boost::program_options;
using nlohmann::json;

// What the base does not drive over; about the ground, which is at 0 in maps of an OctoMap.
constexpr double kObstacleLow_m = 0.09;  // below it, voxels of the ground: they are noisy where it is far
constexpr double kOctomapRange_m = 3.0;  // farther away noise makes voxels above the ground
constexpr double kObstacleHigh_m = 2.0;

struct Options {
  std::string map;
  std::string out;
  std::string removed_factor{"none"};
  std::vector<double> pose{0.0, 0.0, 0.0};
  bool is_everywhere_free{false};
  bool is_octomap{false};
  long end{std::numeric_limits<long>::max()};
};

std::string packageFile(const std::string& package, const std::string& path) {
  const std::string folder = ros::package::getPath(package);
  if (folder.empty())
    throw std::invalid_argument("package " + package + " is not found by ROS: source devel/setup.bash");
  return folder + path;
}

bool endsWith(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

/// Nothing when only help was asked for.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  po::options_description description("Options");
  description.add_options()("help,h", "show this text")                                                               //
      ("map", po::value(&options.map)->required(), "a .gpis of gpis_mapping, or the folder of a depth sequence")      //
      ("octomap", po::bool_switch(&options.is_octomap), "map the sequence with octomap_baseline")                     //
      ("end", po::value(&options.end), "last frame of the sequence, from 0")                                          //
      ("pose", po::value(&options.pose)->multitoken(), "x y yaw of base_link in the map [m, m, rad]; default 0 0 0")  //
      ("removed-factor", po::value(&options.removed_factor),
       "manipulability, pick_order, travel, uncertainty, frontier, failure_penalty or none")  //
      ("everywhere-free", po::bool_switch(&options.is_everywhere_free),
       "ground without anything on it, seen or not, can be driven on")  //
      ("out", po::value(&options.out), "all segments: JSON, overwritten");
  po::positional_options_description positional;
  positional.add("map", 1);
  // Negative numbers are no options.
  const int style = po::command_line_style::default_style & ~po::command_line_style::allow_short;
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(description).positional(positional).style(style).run(), values);
  if (values.count("help") > 0) {
    std::cout << "Usage: select_view MAP|SEQUENCE [--pose X Y YAW] [options]\n"
                 "The robot's next standing pose: a line for each segment of the pile's outline; the last line is a\n"
                 "summary in JSON.\n\n"
              << description;
    return std::nullopt;
  }
  po::notify(values);
  if (options.pose.size() != 3) {
    throw std::invalid_argument("--pose has " + std::to_string(options.pose.size()) + " numbers, must be 3");
  }
  if (options.end < 0) throw std::invalid_argument("--end is " + std::to_string(options.end) + ", must be at least 0");
  if (options.is_octomap && endsWith(options.map, ".gpis")) {
    throw std::invalid_argument("--octomap maps a depth sequence, '" + options.map + "' is a map already");
  }
  return options;
}

RobotBody loadBody() {
  const auto robot =
      mp700_ur5e_description::RobotModel::load(packageFile("mp700_ur5e_description", "/urdf/mp700_ur5e.urdf"));
  const motion_planning::ArmKinematics arm(robot);
  RobotBody body;
  body.footprint =
      mp700_ur5e_description::loadBaseProfile(packageFile("mp700_ur5e_description", "/config/base_profile.yaml"))
          .body.footprint_m;
  body.sectors = motion_planning::ManipulabilitySectors::load(
      packageFile("motion_planning", "/config/manipulability_sectors.yaml"), arm.robot());
  body.T_base_armbase = arm.robot().framePose(mp700_ur5e_description::kArmBaseFrame,
                                              arm.robotPositions(motion_planning::ArmVector::Zero()));
  return body;
}

/// A map of a file, and the ground it shows.
struct Loaded {
  std::unique_ptr<SceneModel> scene;
  std::shared_ptr<base_navigation::NavigationGrid> ground{std::make_shared<base_navigation::NavigationGrid>()};
};

void setGround(const gpis_mapping::GroundGrid& grid, Loaded* loaded) {
  base_navigation::NavigationGrid& ground = *loaded->ground;
  ground.cell_size_m = grid.cell_size_m;
  ground.origin_m = {grid.origin_x_m, grid.origin_y_m};
  ground.width = grid.width;
  ground.height = grid.height;
  ground.state = grid.state;
}

Loaded fromGpis(const gpis_mapping::GpisMap& map) {
  Loaded loaded;
  loaded.scene = makeGpisScene(map.snapshot(), {});
  if (const auto grid = gpis_mapping::projectToGround(*map.snapshot(), {})) setGround(*grid, &loaded);
  return loaded;
}

Loaded fromOctomap(const octomap_baseline::DynamicOctomap& map) {
  Loaded loaded;
  setGround(octomap_baseline::projectDown(map.tree(), kObstacleLow_m, kObstacleHigh_m, true), &loaded);
  loaded.scene = std::make_unique<OctomapScene>(std::make_shared<const octomap::OcTree>(map.tree()), map.numUpdates(),
                                                map.stamp(), OctomapScene::Config());
  return loaded;
}

/// Calls update(image, camera, T_map_camera, stamp) for each frame that has a pose.
template <typename Map>
void play(const Options& options, Map* map) {
  const auto sequence = gpis_mapping::openDepthSequence(options.map);
  gpis_mapping::SkipReason reason;
  for (std::size_t i = 0; i < sequence->size() && i <= static_cast<std::size_t>(options.end); ++i) {
    const auto frame = sequence->frame(i, &reason);
    if (frame) map->update(frame->image, sequence->camera(), frame->T_map_camera, frame->stamp_s);
  }
}

Loaded load(const Options& options) {
  if (endsWith(options.map, ".gpis")) return fromGpis(gpis_mapping::GpisMap(gpis_mapping::loadMap(options.map)));
  if (options.is_octomap) {
    octomap_baseline::OctomapConfig config;
    config.sensor.max_range_m = kOctomapRange_m;
    octomap_baseline::DynamicOctomap map(config);
    play(options, &map);
    return fromOctomap(map);
  }
  gpis_mapping::GpisMap map{gpis_mapping::GpisConfig()};
  play(options, &map);
  return fromGpis(map);
}

/// Free where nothing stands, with room around for the robot.
void freeEverything(base_navigation::NavigationGrid* grid, const Eigen::Vector2d& robot_m) {
  const double cell = grid->cell_size_m;
  Eigen::Vector2d low = robot_m;
  Eigen::Vector2d high = robot_m;
  if (grid->width > 0) {
    low = low.cwiseMin(grid->origin_m);
    high = high.cwiseMax(grid->origin_m + cell * Eigen::Vector2d(grid->width, grid->height));
  }
  const Eigen::Vector2i before = (((grid->origin_m - low).array() + 2.0) / cell).ceil().cast<int>();
  base_navigation::NavigationGrid larger;
  larger.cell_size_m = cell;
  larger.origin_m = grid->origin_m - cell * before.cast<double>();
  const Eigen::Vector2i size = (((high - larger.origin_m).array() + 2.0) / cell).ceil().cast<int>();
  larger.width = size.x();
  larger.height = size.y();
  larger.state.assign(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()),
                      gpis_mapping::SpaceState::kFree);
  for (int row = 0; row < grid->height; ++row) {
    for (int column = 0; column < grid->width; ++column) {
      if (grid->at(column, row) != gpis_mapping::SpaceState::kOccupied) continue;
      larger.state[larger.index(column + before.x(), row + before.y())] = gpis_mapping::SpaceState::kOccupied;
    }
  }
  *grid = larger;
}

json toJson(const ScoredSegment& scored) {
  json factors;
  for (std::size_t i = 0; i < kNumFactors; ++i) {
    factors[toString(static_cast<Factor>(i))] = scored.utility.factor_values[i];
  }
  const Segment& s = scored.segment;
  const Attributes& a = scored.attributes;
  return {{"midpoint", {s.midpoint_map.x(), s.midpoint_map.y(), s.midpoint_map.z()}},
          {"standing", {s.standing_map.x_m, s.standing_map.y_m, s.standing_map.yaw_rad}},
          {"kind", toString(scored.kind)},
          {"verdict", toString(scored.verdict)},
          {"mean_uncertainty", scored.mean_uncertainty},
          {"manipulability", a.manipulability},
          {"height_m", a.height_m},
          {"distance_m", std::isfinite(a.distance_m) ? json(a.distance_m) : json()},
          {"uncertainty", a.uncertainty},
          {"frontier", a.frontier},
          {"factors", factors},
          {"information", scored.utility.information},
          {"utility", scored.utility.utility}};
}

int run(const Options& options) {
  Loaded loaded = load(options);
  SelectionRequest request;
  request.T_map_base = {options.pose[0], options.pose[1], options.pose[2]};
  if (options.is_everywhere_free) freeEverything(loaded.ground.get(), request.T_map_base.position());
  request.ground = loaded.ground;
  ViewSelectorConfig config = options.is_octomap ? octomapSelectorConfig() : ViewSelectorConfig();
  config.utility = config.utility.without(options.removed_factor);
  const ViewSelector selector(config, loadBody());
  const Selection selection = selector.select(*loaded.scene, FailureMemory(0.1), request);

  std::printf("     x m     y m  kind       manip.   height m  travel m  uncertainty  frontier   utility  verdict\n");
  json segments = json::array();
  for (std::size_t i = 0; i < selection.segments.size(); ++i) {
    const ScoredSegment& scored = selection.segments[i];
    const Attributes& a = scored.attributes;
    std::printf("%s%7.3f %7.3f  %-9s  %.5f  %7.3f  %8.3f  %11.4g  %8.3g  %8.4f  %s\n", selection.best == i ? ">" : " ",
                scored.segment.midpoint_map.x(), scored.segment.midpoint_map.y(), toString(scored.kind),
                a.manipulability, a.height_m, a.distance_m, scored.mean_uncertainty, a.frontier, scored.utility.utility,
                toString(scored.verdict));
    segments.push_back(toJson(scored));
  }
  json summary{{"map", options.map},
               {"status", toString(selection.status)},
               {"message", selection.message},
               {"segments", selection.segments.size()},
               {"best", selection.best ? json(*selection.best) : json()}};
  if (!options.out.empty()) {
    json all = summary;
    all["segments"] = segments;
    interactive_mapping::AtomicFile file(options.out);
    file.write(all.dump(1) + "\n");
    file.commit();
  }
  std::cout << summary.dump() << std::endl;
  return selection.best ? 0 : 3;
}

}  // namespace
}  // namespace nbv_selection

int main(int argc, char** argv) {
  try {
    const auto options = nbv_selection::parseCommandLine(argc, argv);
    return options ? nbv_selection::run(*options) : 0;
  } catch (const std::exception& error) {
    std::cerr << "select_view: " << error.what() << std::endl;
    return 1;
  }
}
