// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/brick_texture.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "simulated_world/mujoco_model.h"
#include "simulated_world/tag_cells.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;

// Reflectances of what is not coloured: printed paper and rolled steel.
constexpr double kWhite = 0.92;
constexpr double kBlack = 0.06;
constexpr double kSteel = 0.58;

/// Width and height of a face that is upright.
Eigen::Vector2d faceSize(const Eigen::Vector3d& size_m, std::size_t face) {
  switch (face / 2) {
    case 0:
      return {size_m.y(), size_m.z()};
    case 1:
      return {size_m.x(), size_m.z()};
    default:
      return {size_m.x(), size_m.y()};
  }
}

/// Smooth random field of about unit deviation with `rows` x `columns` independent values.
cv::Mat smoothField(SeededRandom& random, int rows, int columns, int size_px) {
  cv::Mat knots(rows, columns, CV_32FC1);
  std::generate(knots.begin<float>(), knots.end<float>(), [&random] { return static_cast<float>(random.normal()); });
  cv::Mat field;
  cv::resize(knots, field, {size_px, size_px}, 0.0, 0.0, cv::INTER_CUBIC);
  return field;
}

constexpr int kSamples = 4;  // of a texel along each edge

/// Where a sample lies along one axis of a face. All borders run along rows or columns: the two axes together tell what
/// is there, and each is looked at once per row or column only.
struct Place {
  int cell;  ///< of the tag, -1 and its number of cells being the margin; beyond: kNoPaper
  bool is_on_plate;
  bool is_at_edge;  ///< of the face

  bool operator==(const Place& other) const {
    return cell == other.cell && is_on_plate == other.is_on_plate && is_at_edge == other.is_at_edge;
  }
};
constexpr int kNoPaper = -2;

/// Of all samples along an edge that is `size_m` long.
std::vector<Place> placesAlong(int face_px, double size_m, double cell_m, int num_cells, double plate_edge_m) {
  constexpr double kEdge_m = 0.003;
  std::vector<Place> places;
  for (int i = 0; i < face_px * kSamples; ++i) {
    const double texel = (i / kSamples) + 0.5 / kSamples + static_cast<double>(i % kSamples) / kSamples;
    const double p_m = (texel / face_px - 0.5) * size_m;  // in the direction of the texels
    const int cell = static_cast<int>(std::floor(p_m / cell_m + 0.5 * num_cells));
    places.push_back({cell < -1 || cell > num_cells ? kNoPaper : cell, std::abs(p_m) < 0.5 * plate_edge_m,
                      0.5 * size_m - std::abs(p_m) < kEdge_m});
  }
  return places;
}

cv::Mat drawFace(const BrickAppearance& brick, std::size_t face, int face_px, SeededRandom random) {
  const Eigen::Vector2d size_m = faceSize(brick.size_m, face);
  const cv::Mat cells = tagCells(brick.family, brick.tag_ids[face]);
  const double cell_m = brick.tag_edge_m / cells.cols;
  const std::vector<Place> columns = placesAlong(face_px, size_m.x(), cell_m, cells.cols, brick.plate_edge_m);
  const std::vector<Place> rows = placesAlong(face_px, size_m.y(), cell_m, cells.rows, brick.plate_edge_m);
  const cv::Mat clouds = smoothField(random, 6, 9, face_px);
  const cv::Mat grain = smoothField(random, face_px / 2, face_px / 2, face_px);
  const cv::Mat scratches = smoothField(random, face_px, 5, face_px);

  cv::Mat image(face_px, face_px, CV_8UC3);
  for (int v = 0; v < face_px; ++v) {
    const Place* const row = &rows[static_cast<std::size_t>(v * kSamples)];
    const bool is_row_uniform = row[0] == row[kSamples - 1];
    for (int u = 0; u < face_px; ++u) {
      const Place* const column = &columns[static_cast<std::size_t>(u * kSamples)];
      const Eigen::Vector3d clay =
          brick.colour_rgb * (1.0 + 0.05 * clouds.at<float>(v, u) + 0.04 * grain.at<float>(v, u));
      const double steel = kSteel * (1.0 + 0.05 * scratches.at<float>(v, u));
      const auto colourAt = [&](const Place& across, const Place& down) -> Eigen::Vector3d {
        if (brick.has_tags && across.cell != kNoPaper && down.cell != kNoPaper) {
          const bool is_margin =
              across.cell < 0 || across.cell == cells.cols || down.cell < 0 || down.cell == cells.rows;
          const bool is_white = is_margin || cells.at<unsigned char>(down.cell, across.cell) != 0;
          return Eigen::Vector3d::Constant(is_white ? kWhite : kBlack);
        }
        if (brick.has_plate[face] && across.is_on_plate && down.is_on_plate) {
          return Eigen::Vector3d::Constant(steel);
        }
        // Worn edges, so that bricks can be told apart.
        return across.is_at_edge || down.is_at_edge ? Eigen::Vector3d(0.75 * clay) : clay;
      };
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      if (is_row_uniform && column[0] == column[kSamples - 1]) {
        mean = colourAt(column[0], row[0]);
      } else {
        for (int sample = 0; sample < kSamples * kSamples; ++sample) {
          mean += colourAt(column[sample % kSamples], row[sample / kSamples]);
        }
        mean /= kSamples * kSamples;
      }
      image.at<cv::Vec3b>(v, u) = {cv::saturate_cast<unsigned char>(255.0 * mean.x()),
                                   cv::saturate_cast<unsigned char>(255.0 * mean.y()),
                                   cv::saturate_cast<unsigned char>(255.0 * mean.z())};
    }
  }
  return image;
}

/// Upright face to the layout of a cube map, whose faces are seen from inside with the y axis up.
cv::Mat toCubeMap(const cv::Mat& upright, std::size_t face) {
  constexpr std::size_t kPlusX = 0;
  constexpr std::size_t kMinusX = 1;
  constexpr std::size_t kPlusY = 2;
  cv::Mat turned;
  switch (face) {
    case kPlusX:
      cv::rotate(upright, turned, cv::ROTATE_90_COUNTERCLOCKWISE);
      return turned;
    case kMinusX:
      cv::rotate(upright, turned, cv::ROTATE_90_CLOCKWISE);
      return turned;
    case kPlusY:
      cv::rotate(upright, turned, cv::ROTATE_180);
      return turned;
    default:
      return upright;
  }
}

}  // namespace

std::vector<std::string> BrickAppearance::validate() const {
  std::vector<std::string> problems;
  const auto require = [&problems](bool is_good, const std::string& key, double value, const std::string& allowed) {
    if (!is_good) {
      problems.push_back(key + " = " + std::to_string(value) + allowed);
    }
  };
  for (int axis = 0; axis < 3; ++axis) {
    require(size_m[axis] > 0.0 && std::isfinite(size_m[axis]), "size_m[" + std::to_string(axis) + "]", size_m[axis],
            " m, must be > 0 m");
    require(colour_rgb[axis] >= 0.0 && colour_rgb[axis] <= 1.0, "colour_rgb[" + std::to_string(axis) + "]",
            colour_rgb[axis], ", must be in [0, 1]");
  }
  require(plate_edge_m > 0.0 && plate_edge_m <= size_m.minCoeff(), "plate_edge_m", plate_edge_m,
          " m, must be in (0, " + std::to_string(size_m.minCoeff()) + "] m, the shortest edge");
  try {
    for (const int id : tag_ids) {
      const int num_cells = tagCells(family, id).cols;
      const double paper_m = tag_edge_m * (num_cells + 2) / num_cells;
      if (has_tags && !(tag_edge_m > 0.0 && paper_m <= plate_edge_m + 1e-9)) {
        require(false, "tag_edge_m", tag_edge_m,
                " m, must be > 0 m and with its margin, " + std::to_string(paper_m) + " m, fit onto the plate");
        break;
      }
    }
  } catch (const std::invalid_argument& error) {
    problems.emplace_back(error.what());
  }
  return problems;
}

std::array<cv::Mat, 6> drawBrickFaces(const BrickAppearance& appearance, int face_px, std::uint64_t seed) {
  std::vector<std::string> problems = appearance.validate();
  if (face_px < 16 || face_px > 4096) {
    problems.push_back("face_px = " + std::to_string(face_px) + " px, must be in [16, 4096] px");
  }
  if (!problems.empty()) {
    std::string message = "brick texture:";
    for (const std::string& problem : problems) {
      message += "\n  " + problem;
    }
    throw std::invalid_argument(message);
  }
  std::array<cv::Mat, 6> faces;
  for (std::size_t face = 0; face < faces.size(); ++face) {
    faces[face] = drawFace(appearance, face, face_px, SeededRandom(seed, face, 0));
  }
  return faces;
}

std::string brickTextureXml(const std::string& name, int face_px) {
  std::ostringstream xml;
  xml << "<texture name=\"" << name << "\" type=\"cube\" builtin=\"flat\" width=\"" << face_px << "\" height=\""
      << face_px << "\" rgb1=\"0.6 0.3 0.2\"/>\n"
      << "<material name=\"" << name << "\" texture=\"" << name
      << "\" rgba=\"1 1 1 1\" specular=\"0.05\" shininess=\"0.1\"/>\n";
  return xml.str();
}

void uploadBrickTexture(mjModel& model, const std::string& name, const std::array<cv::Mat, 6>& faces) {
  const int texture = requireId(model, mjOBJ_TEXTURE, name);
  const int width = model.tex_width[texture];
  if (model.tex_type[texture] != mjTEXTURE_CUBE || model.tex_height[texture] != 6 * width) {
    throw std::invalid_argument("texture \"" + name + "\" is no cube of six square faces");
  }
  for (std::size_t face = 0; face < faces.size(); ++face) {
    if (faces[face].type() != CV_8UC3 || faces[face].cols != width || faces[face].rows != width) {
      throw std::invalid_argument("texture \"" + name + "\", face " + std::to_string(face) + ": image is " +
                                  std::to_string(faces[face].cols) + " x " + std::to_string(faces[face].rows) +
                                  " px, must be " + std::to_string(width) + " x " + std::to_string(width) +
                                  " px of CV_8UC3");
    }
    // One face below the other, in OpenGL's order +x, -x, +y, -y, +z, -z.
    cv::Mat memory(width, width, CV_8UC3,
                   texturePixels(model, texture) + face * static_cast<std::size_t>(3 * width * width));
    toCubeMap(faces[face], face).copyTo(memory);
  }
}

}  // namespace simulated_world
