// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/face_access.h"

#include <cmath>
#include <map>
#include <stdexcept>

#include <gmock/gmock.h>

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::BrickType;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

BrickType brickType() {
  BrickType type;
  type.name = "brick";
  type.size_m = {0.30, 0.20, 0.20};
  type.plate_edge_m = 0.17;
  return type;
}

Eigen::Isometry3d brickAt(const Eigen::Vector3d& p_map, double yaw_rad = 0.0, double roll_rad = 0.0) {
  Eigen::Isometry3d T_map_brick = Eigen::Isometry3d::Identity();
  T_map_brick.translation() = p_map;
  T_map_brick.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  T_map_brick.rotate(Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()));
  return T_map_brick;
}

std::vector<SpaceState> allFree(const Eigen::Matrix3Xd& points) {
  return std::vector<SpaceState>(static_cast<std::size_t>(points.cols()), SpaceState::kFree);
}

std::vector<BrickFace> names(const std::vector<FaceAccess>& faces) {
  std::vector<BrickFace> result;
  for (const FaceAccess& face : faces) result.push_back(face.face);
  return result;
}

TEST(FaceAccess, PrefersTheTopAndLeavesOutTheBottom) {
  const auto faces = graspableFaces(brickAt({1, 2, 0.1}, 0.7), brickType(), {}, allFree, {});
  EXPECT_THAT(names(faces), ElementsAre(BrickFace::kPlusZ, BrickFace::kPlusX, BrickFace::kMinusX, BrickFace::kPlusY,
                                        BrickFace::kMinusY));
  EXPECT_DOUBLE_EQ(faces[0].accessibility, 1.0);
  for (std::size_t i = 1; i < faces.size(); ++i) EXPECT_NEAR(faces[i].accessibility, 0.5, 1e-12) << "level: half of it";
  EXPECT_EQ(faces[0].free_share, 1.0);
  EXPECT_EQ(faces[0].unknown_share, 0.0);
}

TEST(FaceAccess, FollowsTheBrickWhenItLiesOnItsSide) {
  const auto faces = graspableFaces(brickAt({0, 0, 0.1}, 0.0, M_PI_2), brickType(), {}, allFree, {});
  EXPECT_EQ(faces.at(0).face, BrickFace::kPlusY) << "rolled by a quarter turn, +y is up";
  EXPECT_TRUE(faces[0].T_map_plate.translation().isApprox(Eigen::Vector3d(0, 0, 0.2), 1e-12));
  EXPECT_TRUE(faces[0].T_map_plate.linear().col(2).isApprox(Eigen::Vector3d::UnitZ(), 1e-12));
  for (const FaceAccess& face : faces) EXPECT_NE(face.face, BrickFace::kMinusY);
}

TEST(FaceAccess, FacesThatLookDownAreLeftOut) {
  // Rolled by 30 degrees, the face of -y looks up by 30 degrees, that of +y down by as much.
  const auto tilted = graspableFaces(brickAt({0, 0, 0.5}, 0.0, -M_PI / 6), brickType(), {}, allFree, {});
  EXPECT_THAT(names(tilted), ElementsAre(BrickFace::kPlusZ, BrickFace::kMinusY, BrickFace::kPlusX, BrickFace::kMinusX));
  // By 6 degrees it is as good as level.
  EXPECT_EQ(graspableFaces(brickAt({0, 0, 0.5}, 0.0, -M_PI / 30), brickType(), {}, allFree, {}).size(), 5U);
}

// The way is where it is said to be: everything asked lies before the plate, within the tool's width.
TEST(FaceAccess, AsksAboutTheWayToTheFace) {
  FaceAccessConfig config;
  config.sample_m = 0.02;  // so that the corners of the grid lie outside the circle
  const Eigen::Isometry3d T_map_plate = brickAt({0.3, -2.0, 0.5}, 1.1, 0.4);
  const Eigen::Matrix3Xd points = T_map_plate.inverse() * approachPoints(T_map_plate, config);
  ASSERT_GT(points.cols(), 20);
  EXPECT_NEAR(points.row(2).minCoeff(), 0.03, 1e-12);
  EXPECT_NEAR(points.row(2).maxCoeff(), 0.18, 1e-12);
  EXPECT_LE(points.topRows(2).colwise().norm().maxCoeff(), 0.05 + 1e-9);
  EXPECT_GT(points.topRows(2).colwise().norm().maxCoeff(), 0.02) << "and not its axis alone";
}

TEST(FaceAccess, ABrickOnTopTakesTheTopAway) {
  const std::vector<BrickBox> others = {{brickAt({1.05, 2, 0.3}), {0.30, 0.20, 0.20}}};
  const auto faces = graspableFaces(brickAt({1, 2, 0.1}), brickType(), others, allFree, {});
  EXPECT_THAT(names(faces), ElementsAre(BrickFace::kPlusX, BrickFace::kMinusX, BrickFace::kPlusY, BrickFace::kMinusY));
}

TEST(FaceAccess, NeighboursCloseTheSidesTheyStandAt) {
  // 5 cm beside the +x face: no room for a tool that needs 18 cm.
  const std::vector<BrickBox> others = {{brickAt({1.35, 2, 0.1}), {0.30, 0.20, 0.20}}};
  const auto faces = graspableFaces(brickAt({1, 2, 0.1}), brickType(), others, allFree, {});
  EXPECT_THAT(names(faces), ElementsAre(BrickFace::kPlusZ, BrickFace::kMinusX, BrickFace::kPlusY, BrickFace::kMinusY));
}

// With a map: space nobody has looked at is no way, what is known free on one side is.
TEST(FaceAccess, TheMapDecidesWhatIsClear) {
  const auto seen_from_behind = [](const Eigen::Matrix3Xd& points) {
    std::vector<SpaceState> states;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      states.push_back(points(0, i) < 0.85 ? SpaceState::kFree : SpaceState::kUnknown);
    }
    return states;
  };
  const auto faces = graspableFaces(brickAt({1, 2, 0.1}), brickType(), {}, seen_from_behind, {});
  EXPECT_THAT(names(faces), ElementsAre(BrickFace::kMinusX));
  EXPECT_EQ(faces[0].free_share, 1.0);
  const auto blocked = [](const Eigen::Matrix3Xd& points) {
    return std::vector<SpaceState>(static_cast<std::size_t>(points.cols()), SpaceState::kOccupied);
  };
  EXPECT_THAT(graspableFaces(brickAt({1, 2, 0.1}), brickType(), {}, blocked, {}), IsEmpty());
}

TEST(FaceAccess, WithoutAMapNeighboursAloneDecide) {
  const std::vector<BrickBox> others = {{brickAt({1, 2, 0.3}), {0.30, 0.20, 0.20}}};
  const auto faces = graspableFaces(brickAt({1, 2, 0.1}), brickType(), others, nullptr, {});
  EXPECT_THAT(names(faces), ElementsAre(BrickFace::kPlusX, BrickFace::kMinusX, BrickFace::kPlusY, BrickFace::kMinusY));
  EXPECT_EQ(faces[0].unknown_share, 1.0);
}

TEST(FaceAccess, OffersFacesWithAPlateOnly) {
  BrickType type = brickType();
  type.plate_faces = {BrickFace::kMinusZ, BrickFace::kPlusY};
  EXPECT_THAT(names(graspableFaces(brickAt({1, 2, 0.1}), type, {}, allFree, {})), ElementsAre(BrickFace::kPlusY));
}

// Pose noise must not shuffle faces that are as good as each other.
TEST(FaceAccess, OrderOfEqualFacesIsStable) {
  const auto still = names(graspableFaces(brickAt({1, 2, 0.1}), brickType(), {}, allFree, {}));
  EXPECT_EQ(names(graspableFaces(brickAt({1, 2, 0.1}, 0.0, 1e-9), brickType(), {}, allFree, {})), still);
}

TEST(FaceAccess, RefusesImpossibleSettingsAndAnswers) {
  const std::map<std::string, void (*)(FaceAccessConfig&)> table = {
      {"corridor_m = 0 m", [](FaceAccessConfig& c) { c.corridor_m = 0.0; }},
      {"tool_radius_m = nan m", [](FaceAccessConfig& c) { c.tool_radius_m = std::nan(""); }},
      {"gap_m = -1 m", [](FaceAccessConfig& c) { c.gap_m = -1.0; }},
      {"sample_m = 0 m", [](FaceAccessConfig& c) { c.sample_m = 0.0; }},
      {"max_down_rad = 2 rad", [](FaceAccessConfig& c) { c.max_down_rad = 2.0; }},
      {"unknown_weight = 2", [](FaceAccessConfig& c) { c.unknown_weight = 2.0; }},
      {"min_clear = -1", [](FaceAccessConfig& c) { c.min_clear = -1.0; }}};
  EXPECT_THAT(interactive_mapping::problemsOf(FaceAccessConfig()), IsEmpty());
  for (const auto& [text, change] : table) {
    FaceAccessConfig config;
    change(config);
    ASSERT_EQ(interactive_mapping::problemsOf(config).size(), 1U) << text;
    EXPECT_THAT(interactive_mapping::problemsOf(config).front(), HasSubstr(text + ", must be in"));
    EXPECT_THROW(graspableFaces(brickAt({0, 0, 0}), brickType(), {}, nullptr, config), std::invalid_argument);
  }
  const auto short_answer = [](const Eigen::Matrix3Xd&) { return std::vector<SpaceState>(1); };
  EXPECT_THROW(graspableFaces(brickAt({0, 0, 0}), brickType(), {}, short_answer, {}), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
