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

TEST(BrickTypes, ThreeSizesAreToldApartByAnyFace) {
  const std::vector<BrickType> types = loadBrickTypes(DESCRIPTION_DIR "/config/bricks_three_sizes.yaml").types;
  ASSERT_EQ(types.size(), 3U);
  EXPECT_EQ(types.front().size_m, loadBrickTypes(kFile).types.front().size_m);
  const auto face = [](const BrickType& type, int normal) {
    const double a = type.size_m[(normal + 1) % 3];
    const double b = type.size_m[(normal + 2) % 3];
    return Eigen::Vector2d(std::max(a, b), std::min(a, b));
  };
  for (std::size_t i = 0; i < types.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      for (int k = 0; k < 9; ++k) {  // twice what surface_picking allows
        EXPECT_GT((face(types[i], k / 3) - face(types[j], k % 3)).cwiseAbs().maxCoeff(), 0.039) << i << j << k;
      }
    }
  }
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

// A second type, and two bricks labelled by hand: one with small tags beside the middle, one like the scheme's.
std::string withList(const std::string& bricks) {
  std::string text = changed("first_id: 0", "first_id: 0\n  num_bricks: 10");
  text.insert(text.find("tags:"),
              "  - {name: half, size_m: [0.15, 0.20, 0.10], mass_kg: 0.4, friction: 0.6, plate_edge_m: 0.08,\n"
              "     plate_faces: [+z, -x], color_rgb: [0.5, 0.5, 0.5]}\n");
  return text + "\nbricks:\n" + bricks;
}
const std::string kHalf =
    "  - {id: 50, type: half, tags: [{id: 60, face: +z, center_m: [0.03, -0.04],"
    " turn_rad: 1.5707963267948966, black_border_edge_m: 0.06}, {id: 61, face: -x,"
    " black_border_edge_m: 0.05}]}\n";

TEST(BrickTypes, BricksMayBeLabelledOneByOne) {
  const BrickCatalogue catalogue =
      parseBrickTypes(withList(kHalf + "  - {id: 12, type: brick, tags: [{id: 99, face: +y}]}\n"), "text");
  EXPECT_EQ(catalogue.maxBricks(), 10);
  EXPECT_EQ(catalogue.typeOf(9).name, "brick");
  EXPECT_EQ(catalogue.typeOf(50).name, "half");
  EXPECT_THROW(catalogue.typeOf(10), std::invalid_argument);
  EXPECT_TRUE(catalogue.brickOfTag(59));   // brick 9, -z
  EXPECT_FALSE(catalogue.brickOfTag(62));  // the scheme ends
  const std::optional<BrickTag> top = catalogue.brickOfTag(60);
  ASSERT_TRUE(top);
  EXPECT_EQ(top->brick_id, 50);
  EXPECT_EQ(top->face, BrickFace::kPlusZ);
  EXPECT_EQ(top->black_border_edge_m, 0.06);
  // Upright, the top's tag has its x along the brick's x; turned by 90 degrees it has it along y.
  EXPECT_TRUE(top->T_brick_tag.translation().isApprox(Eigen::Vector3d(0.03, -0.04, 0.05), 1e-12));
  EXPECT_TRUE(top->T_brick_tag.linear().col(0).isApprox(Eigen::Vector3d::UnitY(), 1e-12));
  EXPECT_TRUE(top->T_brick_tag.linear().col(2).isApprox(Eigen::Vector3d::UnitZ(), 1e-12));
  const std::optional<BrickTag> plain = catalogue.brickOfTag(99);
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->black_border_edge_m, 0.12) << "the scheme's";
  EXPECT_TRUE(plain->T_brick_tag.isApprox(tagPose(catalogue.type("brick"), BrickFace::kPlusY)));
  const std::vector<BrickFace> plates = {BrickFace::kPlusZ, BrickFace::kMinusX};
  EXPECT_EQ(catalogue.type("half").plate_faces, plates);
  EXPECT_EQ(catalogue.type("brick").plate_faces.size(), 6U);
}

TEST(BrickTypes, TagsOfTheSchemeKnowTheirPlace) {
  const BrickCatalogue catalogue = loadBrickTypes(kFile);
  for (const BrickFace face : kBrickFaces) {
    const std::optional<BrickTag> tag = catalogue.brickOfTag(catalogue.tagId(3, face));
    ASSERT_TRUE(tag);
    EXPECT_EQ(tag->black_border_edge_m, 0.12);
    EXPECT_TRUE(tag->T_brick_tag.isApprox(tagPose(catalogue.types.front(), face)));
  }
}

TEST(BrickTypes, RefusesLabelsThatContradictEachOther) {
  const auto expectRefused = [](const std::string& bricks, const std::string& why) {
    const std::string message = refusal(withList(bricks));
    EXPECT_NE(message.find(why), std::string::npos) << message;
    EXPECT_EQ(message.rfind("bricks.yaml: ", 0), 0U) << "names the file: " << message;
  };
  expectRefused(kHalf + kHalf, "bricks: id = 50, must be unique");
  expectRefused(kHalf + "  - {id: 51, type: half, tags: [{id: 60, face: -z, black_border_edge_m: 0.06}]}\n",
                "bricks: tag id = 60 of brick 51, must be unique: brick 50 has it too");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 70, face: -z}, {id: 70, face: +z}]}\n",
                "bricks[0]/tags[1]/id = 70, must be a tag that no other place has");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 7, face: -z}]}\n",
                "bricks: tag id = 7 of brick 51, must be unique: by the scheme it is that of brick 1");
  expectRefused("  - {id: 9, type: brick, tags: [{id: 70, face: -z}]}\n", "bricks: id = 9, must be at least 10");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 587, face: -z}]}\n", "must be below 587");
  expectRefused("  - {id: 51, type: stone, tags: [{id: 70, face: -z}]}\n",
                "bricks[0]/type = stone, must be the name of one of types");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 70, face: top}]}\n",
                "bricks[0]/tags[0]/face = top, must be one of +x, -x");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 70, face: +z, center_m: [0.1, 0.0]}]}\n",
                "must lie on its face");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 70, face: +z, black_border_edge_m: 0}]}\n",
                "bricks[0]/tags[0]/black_border_edge_m = 0, must be a number in (0, 2] m");
  expectRefused("  - {id: 51, type: brick, tags: [{id: 70, face: +z}, {id: 71, face: +z, center_m: [0.05, 0.0]}]}\n",
                "bricks: tag id = 71 of brick 51, must lie beside tag 70, not on it");
  expectRefused("  - {id: 51, type: brick, tags: []}\n", "bricks[0]/tags = [], must be a list of at least one map");
  EXPECT_NE(
      refusal(changed("first_id: 0", "first_id: 0\n  num_bricks: 98")).find("tags/num_bricks = 98, must be at most 97"),
      std::string::npos);
  EXPECT_NE(refusal(changed("friction: 0.6", "friction: 0.6\n    plate_faces: [+z, +z]"))
                .find("types[0]/plate_faces = +z, must be one of +x, -x, +y, -y, +z, -z, each at most once"),
            std::string::npos);
  EXPECT_NE(refusal(changed("[0.30, 0.20, 0.20]", "[0.30, -0.20, 0.20]")).find("types[0]/size_m = [0.30, -0.20, 0.20]"),
            std::string::npos);
}

// Families that carry data outside their border need paper for it.
TEST(BrickTypes, PaperHoldsTheDataOutsideTheBorder) {
  const auto ofFamily = [](const std::string& family, const std::string& edge, const std::string& margin) {
    std::string text = changed("tag36h11", family);
    text.replace(text.find("black_border_edge_m: 0.12"), 25, "black_border_edge_m: " + edge);
    return text.replace(text.find("margin_cells: 1"), 15, "margin_cells: " + margin);
  };
  // The border is seven cells wide, 5 between its inner corners, 9 with the data outside it.
  const BrickCatalogue catalogue = parseBrickTypes(ofFamily("tagStandard41h12", "0.07", "1"), "text");
  EXPECT_NEAR(catalogue.tags.cellEdge(), 0.01, 1e-12);
  EXPECT_NEAR(catalogue.tags.cornerEdge(0.07), 0.05, 1e-12);
  EXPECT_NEAR(catalogue.tags.paperEdge(), 0.01 * (9 + 2), 1e-12);
  EXPECT_NE(refusal(ofFamily("tagStandard41h12", "0.14", "1")).find("black border and margin = 0.22 m"),
            std::string::npos);
  // They have their white inside: no margin is needed, and then they fit.
  EXPECT_EQ(parseBrickTypes(ofFamily("tagStandard41h12", "0.14", "0"), "text").tags.margin_cells, 0.0);
  EXPECT_NE(refusal(ofFamily("DICT_5X5_1000", "0.05", "0")).find("tags/margin_cells = 0, must be "), std::string::npos);
}

TEST(BrickTypes, DataOutsideTheBorderMustLieOnTheFaceToo) {
  const auto withEdge = [](const std::string& edge) {
    std::string text =
        withList("  - {id: 51, type: half, tags: [{id: 100, face: +x, black_border_edge_m: " + edge + "}]}\n");
    text.replace(text.find("tag36h11"), 8, "tagCircle21h7");
    text.replace(text.find("num_bricks: 10"), 14, "num_bricks: 0");
    text.replace(text.find("id: 100"), 7, "id: 10");
    return text.replace(text.find("black_border_edge_m: 0.12"), 25, "black_border_edge_m: 0.05");
  };
  // The face is 0.10 m high: 9 of 7 cells must fit.
  EXPECT_EQ(parseBrickTypes(withEdge("0.077"), "text").bricks.size(), 1U);
  EXPECT_NE(refusal(withEdge("0.079")).find("must lie on its face: a corner of its data outside the border"),
            std::string::npos);
}

TEST(BrickTypes, NamesTheFamilyOfTagsPrintedByOpenCV) {
  const std::string message = refusal(changed("tag36h11", "DICT_APRILTAG_36h11"));
  EXPECT_NE(message.find("OpenCV prints the tags of tag36h11 turned by 180 degrees"), std::string::npos) << message;
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
