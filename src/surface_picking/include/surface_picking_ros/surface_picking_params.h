// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <brick_detection/face_access.h>
#include <brick_detection_ros/detect_server.h>
#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

#include "surface_picking/bodies.h"
#include "surface_picking/cuboids.h"
#include "surface_picking/patches.h"

namespace surface_picking_ros {

/// All parameters of the node. SI units.
struct SurfacePickingParams {
  std::string bricks_file;
  std::string map_frame{"map"};
  bool continuous{true};

  struct Region {
    Eigen::Vector3d min_m{-5.0, -5.0, -1.0};
    Eigen::Vector3d max_m{5.0, 5.0, 2.0};

    static void fields(Region& c, interactive_mapping::Fields& f) {
      f("min_m", c.min_m, -1000.0, 1000.0, "m", "corner of the upright box in which bodies are looked for, map frame");
      f("max_m", c.max_m, -1000.0, 1000.0, "m", "opposite corner");
      f.require((c.min_m.array() < c.max_m.array()).all(), "min_m must be below max_m along each axis");
    }
  } region;

  surface_picking::PatchConfig patches;
  surface_picking::CuboidConfig cuboids;
  surface_picking::BodyConfig bodies;
  brick_detection::FaceAccessConfig access;

  brick_detection_ros::DetectParams detect;

  static void fields(SurfacePickingParams& c, interactive_mapping::Fields& f) {
    f("bricks_file", c.bricks_file, "absolute path of a bricks.yaml; the launch file gives it");
    f("map_frame", c.map_frame, "frame of the map, z up");
    f("continuous", c.continuous, "false: updates of the map are processed only while a call of ~detect waits");
    f.section("region", c.region);
    f.section("patches", c.patches);
    f.section("cuboids", c.cuboids);
    f.section("bodies", c.bodies);
    f.section("access", c.access);
    f.section("detect", c.detect);
    f.require(!c.bricks_file.empty() && c.bricks_file.front() == '/',
              "bricks_file = '" + c.bricks_file + "', must be the absolute path of a bricks.yaml");
    f.require(!c.map_frame.empty() && c.map_frame.front() != '/',
              "map_frame = '" + c.map_frame + "', must be a tf2 frame: not empty, no leading slash");
  }
};

/// Where the node keeps the id of the next body, as no configuration: after a crash, when roslaunch has started it again,
/// none of the ids that the mission knows must be given to another body.
inline constexpr char kNextIdParam[] = "next_body_id";

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
SurfacePickingParams loadSurfacePickingParams(const ros::NodeHandle& private_nh);

}  // namespace surface_picking_ros
