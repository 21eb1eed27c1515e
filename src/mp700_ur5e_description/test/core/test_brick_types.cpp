// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/brick_types.h"

#include <set>
#include <stdexcept>

#include <gtest/gtest.h>

#include "support/shipped_file.h"

namespace mp700_ur5e_description {
namespace {

const std::string kFile = DESCRIPTION_DIR "/config/bricks.yaml";

std::string changed(const std::string& from, const std::string& to) {
  return test::changedFile(kFile, from, to);
}

std::string refusal(const std::string& text) {
  return test::refusalBy([&text] { parseBrickTypes(text, "bricks.yaml"); });
}

TEST(BrickTypes, ReadsShippedFile) {
  const BrickCatalogue catalogue = loadBrickTypes(kFile);
  ASSERT_EQ(catalogue.types.size(), 1U);
  const BrickType& brick = catalogue.type("brick");
  EXPECT_EQ(brick.size_m, Eigen::Vector3d(0.30, 0.20, 0.20));
  EXPECT_DOUBLE_EQ(brick.mass_kg, 1.0);
  EXPECT_DOUBLE_EQ(brick.friction, 0.6);
  EXPECT_DOUBLE_EQ(brick.plate_edge_m, 0.17);
  EXPECT_EQ(catalogue.tags.family, "tag36h11");
  EXPECT_DOUBLE_EQ(catalogue.tags.black_border_edge_m, 0.12);
  EXPECT_DOUBLE_EQ(catalogue.tags.cellEdge(), 0.015);   // 8 cells along the border
  EXPECT_DOUBLE_EQ(catalogue.tags.paperEdge(), 0.150);  // and one of white on both sides
  EXPECT_THROW(catalogue.type("stone"), std::invalid_argument);
}

TEST(BrickTypes, TagIdsAreUniqueAndGoThereAndBack) {
  const BrickCatalogue catalogue = loadBrickTypes(kFile);
  std::set<int> ids;
  for (int brick_id = 0; brick_id < 60; ++brick_id) {
    int expected = 6 * brick_id;
    for (const BrickFace face : kBrickFaces) {
      const int id = catalogue.tagId(brick_id, face);
      EXPECT_EQ(id, expected++) << "consecutive, faces in order";
      EXPECT_TRUE(ids.insert(id).second) << id;
      const std::optional<BrickTag> tag = catalogue.brickOfTag(id);
      ASSERT_TRUE(tag) << id;
      EXPECT_EQ(tag->brick_id, brick_id);
      EXPECT_EQ(tag->face, face);
    }
  }
}

TEST(BrickTypes, TagsEndWithTheFamily) {
  const BrickCatalogue catalogue = parseBrickTypes(changed("first_id: 0", "first_id: 10"), "test");
  EXPECT_EQ(catalogue.maxBricks(), 96);  // (587 - 10) / 6
  EXPECT_EQ(catalogue.tagId(0, BrickFace::kPlusX), 10);
  EXPECT_FALSE(catalogue.brickOfTag(9));
  EXPECT_TRUE(catalogue.brickOfTag(585));
  EXPECT_FALSE(catalogue.brickOfTag(586));
  EXPECT_FALSE(catalogue.brickOfTag(-1));
  EXPECT_NO_THROW(catalogue.tagId(95, BrickFace::kMinusZ));
  EXPECT_THROW(catalogue.tagId(96, BrickFace::kPlusX), std::invalid_argument);
  EXPECT_THROW(catalogue.tagId(-1, BrickFace::kPlusX), std::invalid_argument);
}

TEST(BrickTypes, TagsLieOnTheirFaces) {
  const BrickType brick = loadBrickTypes(kFile).types.front();
  for (const BrickFace face : kBrickFaces) {
    const Eigen::Isometry3d T_brick_tag = tagPose(brick, face);
    const Eigen::Vector3d out = T_brick_tag.linear().col(2);
    EXPECT_EQ(out, faceNormal(face));
    EXPECT_NEAR(T_brick_tag.linear().determinant(), 1.0, 1e-12) << "right-handed";
    EXPECT_TRUE(T_brick_tag.linear().isUnitary(1e-12));
    // In the middle of the face: along the normal at half the edge, elsewhere zero.
    EXPECT_DOUBLE_EQ(out.dot(T_brick_tag.translation()), 0.5 * out.cwiseAbs().dot(brick.size_m));
    EXPECT_DOUBLE_EQ(T_brick_tag.translation().norm(), std::abs(out.dot(T_brick_tag.translation())));
  }
}

TEST(BrickTypes, FaceNormalsAreNamedRight) {
  EXPECT_EQ(faceNormal(BrickFace::kPlusX), Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(faceNormal(BrickFace::kMinusX), Eigen::Vector3d(-1, 0, 0));
  EXPECT_EQ(faceNormal(BrickFace::kPlusY), Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(faceNormal(BrickFace::kMinusY), Eigen::Vector3d(0, -1, 0));
  EXPECT_EQ(faceNormal(BrickFace::kPlusZ), Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(faceNormal(BrickFace::kMinusZ), Eigen::Vector3d(0, 0, -1));
}

// The table by hand: who stands before the face sees these body axes to the right and up.
TEST(BrickTypes, TagsStandUprightAsDocumented) {
  struct Row {
    BrickFace face;
    Eigen::Vector3d right, up;
  };
  const std::vector<Row> table = {
      {BrickFace::kPlusX, {0, 1, 0}, {0, 0, 1}},  {BrickFace::kMinusX, {0, -1, 0}, {0, 0, 1}},
      {BrickFace::kPlusY, {-1, 0, 0}, {0, 0, 1}}, {BrickFace::kMinusY, {1, 0, 0}, {0, 0, 1}},
      {BrickFace::kPlusZ, {1, 0, 0}, {0, 1, 0}},  {BrickFace::kMinusZ, {-1, 0, 0}, {0, 1, 0}},
  };
  for (const Row& row : table) {
    const Eigen::Isometry3d T_brick_tag = tagPose(loadBrickTypes(kFile).types.front(), row.face);
    EXPECT_EQ(T_brick_tag.linear().col(0), row.right) << static_cast<int>(row.face);
    EXPECT_EQ(T_brick_tag.linear().col(1), row.up) << static_cast<int>(row.face);
  }
}

TEST(BrickTypes, RefusesUnknownMissingAndMistypedKeys) {
  EXPECT_NE(refusal(changed("friction", "stickiness")).find("types[0]/stickiness is unknown; known here: "),
            std::string::npos);
  EXPECT_NE(refusal(changed("    mass_kg: 1.0", "")).find("types[0]/mass_kg = (missing)"), std::string::npos);
  EXPECT_NE(
      refusal(changed("[0.30, 0.20, 0.20]", "[0.30, 0.20]")).find("types[0]/size_m = [0.30, 0.20], must be 3 numbers"),
      std::string::npos);
  EXPECT_NE(refusal(changed("first_id: 0", "first_id: zero")).find("tags/first_id = zero, must be an integer"),
            std::string::npos);
  EXPECT_NE(refusal("types: []\ntags: 5").find("types = [], must be a list of at least one map"), std::string::npos);
}

TEST(BrickTypes, KnowsArucoToo) {
  const BrickCatalogue catalogue = parseBrickTypes(changed("tag36h11", "DICT_5X5_1000"), "text");
  EXPECT_EQ(catalogue.maxBricks(), 1000 / 6);
  EXPECT_NEAR(catalogue.tags.cellEdge(), 0.12 / 7, 1e-12);
}

TEST(BrickTypes, RefusesImpossibleValues) {
  EXPECT_NE(
      refusal(changed("mass_kg: 1.0", "mass_kg: 0")).find("types[0]/mass_kg = 0, must be a number in (0, 100] kg"),
      std::string::npos);
  EXPECT_NE(
      refusal(changed("0.17", "0.21")).find("plate_edge_m of brick = 0.21 m, must be at most the shortest edge, 0.2 m"),
      std::string::npos);
  EXPECT_NE(refusal(changed("0.12", "0.18")).find("black border and margin = 0.225 m, must fit"), std::string::npos);
  EXPECT_NE(refusal(changed("tag36h11", "tag36h12")).find("tags/family = tag36h12, must be one of: tag36h11"),
            std::string::npos);
  EXPECT_NE(refusal(changed("first_id: 0", "first_id: 585")).find("must leave six ids below 587"), std::string::npos);
}

TEST(BrickTypes, ListsEveryProblem) {
  std::string text = changed("mass_kg: 1.0", "mass_kg: -1");
  text.replace(text.find("margin_cells: 1"), 15, "margin_cells: 0");
  const std::string message = refusal(text);
  EXPECT_NE(message.find("bricks.yaml: types[0]/mass_kg"), std::string::npos) << message;
  EXPECT_NE(message.find("bricks.yaml: tags/margin_cells"), std::string::npos) << message;
}

}  // namespace
}  // namespace mp700_ur5e_description
