// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <mujoco/mujoco.h>
#include <opencv2/core.hpp>

namespace simulated_world {

/// Texels along a face. 0.12 m tags on faces of 0.30 m and 0.20 m have their borders between texels, also in all smaller
/// copies the renderer makes for a distance; with 256, say, they look up to 0.4 % too large or too small.
constexpr int kBrickFace_px = 320;

/// How a brick looks: in the middle of every face a square steel plate and on it a tag on white paper, if it has them.
/// Faces are in the order +x, -x, +y, -y, +z, -z of their outward normals. Upright is the brick's +z on the four side faces, and +y on
/// both +z and -z: the tag's frame has z out of the face, y up and x to the right of one who looks at it.
struct BrickAppearance {
  Eigen::Vector3d size_m{0.30, 0.20, 0.20};
  double plate_edge_m{0.17};
  std::array<bool, 6> has_plate{{true, true, true, true, true, true}};
  bool has_tags{true};
  double tag_edge_m{0.12};  ///< outer edge of the black border; a white margin of one cell surrounds it
  Eigen::Vector3d colour_rgb{0.62, 0.27, 0.20};  ///< each in [0, 1]
  std::string family{"tag36h11"};                ///< see tagCells()
  std::array<int, 6> tag_ids{0, 1, 2, 3, 4, 5};

  std::vector<std::string> validate() const;
};

/// The faces as one sees them when they are upright, each `face_px` square whatever the face's proportions, as MuJoCo
/// stretches it: CV_8UC3 in the order red, green, blue. Grain and scratches are fixed by the seed. Throws
/// std::invalid_argument for an impossible appearance, or face_px outside [16, 4096].
std::array<cv::Mat, 6> drawBrickFaces(const BrickAppearance& appearance, int face_px, std::uint64_t seed);

/// Elements of an MJCF asset section: a texture and a material, both called `name`, for a geom of type box. The texture
/// is blank until uploadBrickTexture().
std::string brickTextureXml(const std::string& name, int face_px);

/// Writes the faces into the model. A renderer takes its copy when it is made, so this comes before. Throws
/// std::invalid_argument if there is no such texture, or the faces are not of its size.
void uploadBrickTexture(mjModel& model, const std::string& name, const std::array<cv::Mat, 6>& faces);

}  // namespace simulated_world
