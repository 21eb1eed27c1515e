// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/picking.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "support/mapped_scene.h"

namespace surface_picking {
namespace {

using mp700_ur5e_description::BrickFace;
using test_support::pose;

class Picking : public testing::Test {
 protected:
  Picking() {
    type_.name = "brick";
    type_.size_m = {0.3, 0.2, 0.2};
    type_.plate_edge_m = 0.17;
  }

  Body bodyAt(const Eigen::Isometry3d& T_map_body) const {
    Body body;
    body.cuboid.type = type_.name;
    body.cuboid.size_m = type_.size_m;
    body.cuboid.T_map_body = T_map_body;
    for (SeenFace& face : body.cuboid.faces) face = {0, 0.8, 0.08};
    return body;
  }

  static std::vector<SpaceState> allFree(const Eigen::Matrix3Xd& points) {
    return std::vector<SpaceState>(static_cast<std::size_t>(points.cols()), SpaceState::kFree);
  }

  std::vector<BrickFace> facesOf(const std::vector<Body>& bodies) const {
    std::vector<BrickFace> faces;
    for (const auto& access : pickableFaces(bodies, 0, type_, allFree, config_)) faces.push_back(access.face);
    return faces;
  }

  mp700_ur5e_description::BrickType type_;
  brick_detection::FaceAccessConfig config_;
};

TEST_F(Picking, OnlySeenFacesWithRoomForTheToolCount) {
  Body body = bodyAt(pose(0.0, 0.0, 0.1));
  EXPECT_EQ(facesOf({body}).size(), 5u) << "all but the lower";
  EXPECT_EQ(facesOf({body}).front(), BrickFace::kPlusZ);
  body.cuboid.faces[static_cast<std::size_t>(BrickFace::kPlusZ)].radius_m = 0.9 * config_.tool_radius_m;
  body.cuboid.faces[static_cast<std::size_t>(BrickFace::kPlusX)] = SeenFace();
  const std::vector<BrickFace> faces = facesOf({body});
  EXPECT_EQ(faces.size(), 3u);
  for (const BrickFace face : faces) {
    EXPECT_NE(face, BrickFace::kPlusZ);
    EXPECT_NE(face, BrickFace::kPlusX);
  }
}

TEST_F(Picking, AnotherBodyOnTopTakesTheTopAway) {
  const Body below = bodyAt(pose(0.0, 0.0, 0.1));
  const Body on_top = bodyAt(pose(0.02, 0.0, 0.3));
  for (const BrickFace face : facesOf({below, on_top})) EXPECT_NE(face, BrickFace::kPlusZ);
  EXPECT_THROW(pickableFaces({below}, 1, type_, allFree, config_), std::out_of_range);
}

}  // namespace
}  // namespace surface_picking
