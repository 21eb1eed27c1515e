// SPDX-License-Identifier: BSD-3-Clause
#include "surface_comparison/surface_places.h"

#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

namespace {

using Eigen::Vector3d;
using experiments::SurfacePlace;
using experiments::SurfacePlaces;

/// A brick of 30 x 20 x 10 cm on the ground and a smaller one on it, flush with nothing.
synthetic_depth::Scene makeScene() {
  synthetic_depth::Scene scene;
  synthetic_depth::Box lower;
  lower.half_extents_m = {0.15, 0.10, 0.05};
  lower.T_scene_box.translation() = Vector3d(0.0, 0.0, 0.05);
  synthetic_depth::Box upper;
  upper.id = 1;
  upper.half_extents_m = {0.05, 0.04, 0.04};
  upper.T_scene_box.translation() = Vector3d(0.0, 0.0, 0.14);
  scene.boxes = {lower, upper};
  return scene;
}

class Places : public testing::Test {
 protected:
  SurfacePlace at(double x_m, double y_m, double z_m) const {
    return places_.at(scene_.T_map_scene * Vector3d(x_m, y_m, z_m));
  }

  synthetic_depth::Scene scene_{makeScene()};
  SurfacePlaces places_{scene_, 0};
};

TEST_F(Places, FarFromEveryEdgeIsFace) {
  EXPECT_EQ(at(0.1, 0.06, 0.10), SurfacePlace::kFace);
  EXPECT_EQ(at(0.15, 0.0, 0.05), SurfacePlace::kFace);
  EXPECT_EQ(at(1.0, 1.0, 0.0), SurfacePlace::kFace);
}

TEST_F(Places, BrickEdgesAndCornersAreConvex) {
  EXPECT_EQ(at(0.14, 0.0, 0.10), SurfacePlace::kConvexEdge);
  EXPECT_EQ(at(0.15, 0.0, 0.09), SurfacePlace::kConvexEdge);
  EXPECT_EQ(at(0.15, 0.10, 0.05), SurfacePlace::kConvexEdge);  // upright
  EXPECT_EQ(at(0.15, 0.10, 0.10), SurfacePlace::kConvexEdge);  // corner
  EXPECT_EQ(at(0.05, 0.0, 0.17), SurfacePlace::kConvexEdge);
}

TEST_F(Places, WhereSolidsMeetIsConcave) {
  EXPECT_EQ(at(0.16, 0.0, 0.0), SurfacePlace::kConcaveEdge);   // on the ground beside the brick
  EXPECT_EQ(at(0.15, 0.0, 0.01), SurfacePlace::kConcaveEdge);  // on the brick above the ground
  EXPECT_EQ(at(0.16, 0.11, 0.0), SurfacePlace::kConcaveEdge);  // before the corner's foot
  EXPECT_EQ(at(0.06, 0.0, 0.10), SurfacePlace::kConcaveEdge);  // brick on brick, lower one
  EXPECT_EQ(at(0.05, 0.0, 0.11), SurfacePlace::kConcaveEdge);  // and upper one
}

TEST_F(Places, ThePlaceIsThatOfTheNearestPoint) {
  EXPECT_EQ(at(0.1, 0.06, 0.13), SurfacePlace::kFace);         // 3 cm above a face
  EXPECT_EQ(at(0.1, 0.06, 0.075), SurfacePlace::kFace);        // within the brick
  EXPECT_EQ(at(0.16, 0.0, 0.11), SurfacePlace::kConvexEdge);   // outside of an edge
  EXPECT_EQ(at(0.0, 0.0, 0.105), SurfacePlace::kConcaveEdge);  // in the contact of both bricks
}

TEST_F(Places, EdgesReachTwoCentimetres) {
  EXPECT_EQ(at(0.131, 0.06, 0.10), SurfacePlace::kConvexEdge);
  EXPECT_EQ(at(0.129, 0.06, 0.10), SurfacePlace::kFace);
}

TEST_F(Places, RefusesWhatHasNoPlace) {
  EXPECT_THROW(at(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0), std::invalid_argument);
  synthetic_depth::Scene empty;
  empty.has_ground = false;
  EXPECT_THROW(SurfacePlaces(empty, 0).at(Vector3d::Zero()), std::invalid_argument);
}

}  // namespace
