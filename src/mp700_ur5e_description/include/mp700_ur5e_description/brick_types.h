// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_enums/brick_face.h>

namespace mp700_ur5e_description {

/// Faces of a brick, named after their outward normal in the brick's frame, in the order of their tag ids.
using interactive_mapping::BrickFace;
constexpr int kNumBrickFaces = interactive_mapping::kNumBrickFace;
constexpr std::array<BrickFace, kNumBrickFaces> kBrickFaces = {BrickFace::kPlusX, BrickFace::kMinusX,
                                                               BrickFace::kPlusY, BrickFace::kMinusY,
                                                               BrickFace::kPlusZ, BrickFace::kMinusZ};

/// Brick frame: middle of the brick, axes along its edges.
struct BrickType {
  std::string name;
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
  double mass_kg{0.0};
  double friction{0.0};      ///< sliding
  double plate_edge_m{0.0};  ///< square steel plate in the middle of each of plate_faces
  std::vector<BrickFace> plate_faces{kBrickFaces.begin(), kBrickFaces.end()};
  Eigen::Vector3d color_rgb{Eigen::Vector3d::Zero()};
};

/// Tags by the scheme: one in the middle of each face of each brick, numbered through.
struct TagLayout {
  std::string family;               ///< see families()
  double black_border_edge_m{0.0};  ///< outer edge of the black border; of all families, see the README's drawing
  double margin_cells{0.0};         ///< white ring round the tag and its data [cells]
  int first_id{0};
  std::optional<int> num_bricks;  ///< labelled by the scheme; nothing: as many as the family has ids for

  double cellEdge() const;   ///< edge of one cell of the tag's grid [m]
  double paperEdge() const;  ///< edge of the printed square, margin included [m]
  /// Edge of the square whose corners detectors report [m], the size that pose estimators ask for. It is the black
  /// border's outer edge, or its inner edge in families with data outside the border.
  double cornerEdge(double of_black_border_edge_m) const;
  /// Names: of libapriltag (tag36h11 ...), of OpenCV's ArUco dictionaries (DICT_5X5_1000 ...), and ALVAR_5X5, the tags of
  /// ar_track_alvar.
  static std::vector<std::string> families();
  static int numIds(const std::string& family);       ///< 0: unknown family
  static int borderCells(const std::string& family);  ///< cells between the corners that detectors report; 0: unknown
  static int blackCells(const std::string& family);   ///< cells along the black border's outer edge; 0: unknown
  static int outerCells(const std::string& family);   ///< the same with data outside the border, which some have
};

/// A tag on a brick.
struct BrickTag {
  int brick_id{0};
  BrickFace face{BrickFace::kPlusX};
  double black_border_edge_m{0.0};                               ///< as TagLayout's
  Eigen::Isometry3d T_brick_tag{Eigen::Isometry3d::Identity()};  ///< see tagPose()
};

/// A brick that the scheme does not cover.
struct LabelledBrick {
  int id{0};
  std::string type;
  std::map<int, BrickTag> tags;  ///< by the tag's id
};

/// The contents of bricks.yaml.
struct BrickCatalogue {
  std::vector<BrickType> types;
  TagLayout tags;                     ///< the bricks of this scheme are of the first type
  std::vector<LabelledBrick> bricks;  ///< beside the scheme

  /// Throws std::invalid_argument naming the known types.
  const BrickType& type(const std::string& name) const;

  /// Of a brick. Throws std::invalid_argument for an id that neither scheme nor list has.
  const BrickType& typeOf(int brick_id) const;

  /// Bricks of the scheme.
  int maxBricks() const;

  /// By the scheme. Throws std::invalid_argument unless brick_id is in [0, maxBricks() - 1].
  int tagId(int brick_id, BrickFace face) const;

  /// Whose tag this is, by list or scheme; nothing if no brick has it.
  std::optional<BrickTag> brickOfTag(int tag_id) const;

  /// What concerns several numbers at once; each line says key, value and rule. Empty: fine.
  std::vector<std::string> validate() const;

 private:
  void validateList(int num_ids, std::vector<std::string>* problems) const;
};

/// Outward normal in the brick's frame.
Eigen::Vector3d faceNormal(BrickFace face);

/// Pose of a face's tag in the brick's frame. Tag frame: in the middle of the face. Seen with the tag upright, x is to
/// the right and y up; z is out of the face. Up is the brick's +z on the four side faces, and +y on both +z and -z.
/// (The AprilTag library's own tag frame is turned by pi about x: y down, z into the tag.)
Eigen::Isometry3d tagPose(const BrickType& type, BrickFace face);

/// Throws std::invalid_argument listing everything wrong with the file, a line each.
BrickCatalogue loadBrickTypes(const std::string& path);
BrickCatalogue parseBrickTypes(const std::string& text, const std::string& name);

}  // namespace mp700_ur5e_description
