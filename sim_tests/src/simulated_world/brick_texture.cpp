// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/brick_texture.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <stdexcept>

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

/// What is printed at a point of the plate: grey in [0, 1], or nothing where there is no paper.
std::optional<double> printedGrey(const cv::Mat& cells, double cell_m, const Eigen::Vector2d& p_face) {
  const int num_cells = cells.cols;
  const int column = static_cast<int>(std::floor(p_face.x() / cell_m + 0.5 * num_cells));
  const int row = static_cast<int>(std::floor(-p_face.y() / cell_m + 0.5 * num_cells));
  if (column < -1 || column > num_cells || row < -1 || row > num_cells) {
    return std::nullopt;
  }
  const bool is_margin = column < 0 || column == num_cells || row < 0 || row == num_cells;
  return is_margin || cells.at<unsigned char>(row, column) != 0 ? kWhite : kBlack;
}

/// Mean colour of a texel from 4 x 4 samples; one if its corners agree, as all borders run along rows or columns.
template <typename ColourAt>
Eigen::Vector3d meanOverTexel(int u, int v, const ColourAt& colourAt) {
  constexpr int kSamples = 4;
  constexpr double kFirst = 0.5 / kSamples;
  constexpr double kLast = 1.0 - kFirst;
  const Eigen::Vector3d first = colourAt(u + kFirst, v + kFirst);
  if (first == colourAt(u + kLast, v + kFirst) && first == colourAt(u + kFirst, v + kLast) &&
      first == colourAt(u + kLast, v + kLast)) {
    return first;
  }
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int sample = 0; sample < kSamples * kSamples; ++sample) {
    sum += colourAt(u + kFirst + static_cast<double>(sample % kSamples) / kSamples,
                    v + kFirst + static_cast<double>(sample / kSamples) / kSamples);
  }
  return sum / (kSamples * kSamples);
}

cv::Mat drawFace(const BrickAppearance& brick, std::size_t face, int face_px, SeededRandom random) {
  const Eigen::Vector2d size_m = faceSize(brick.size_m, face);
  const cv::Mat cells = tagCells(brick.family, brick.tag_ids[face]);
  const double cell_m = brick.tag_edge_m / cells.cols;
  const cv::Mat clouds = smoothField(random, 6, 9, face_px);
  const cv::Mat grain = smoothField(random, face_px / 2, face_px / 2, face_px);
  const cv::Mat scratches = smoothField(random, face_px, 5, face_px);

  constexpr double kEdge_m = 0.003;
  cv::Mat image(face_px, face_px, CV_8UC3);
  for (int v = 0; v < face_px; ++v) {
    for (int u = 0; u < face_px; ++u) {
      const Eigen::Vector3d clay =
          brick.colour_rgb * (1.0 + 0.05 * clouds.at<float>(v, u) + 0.04 * grain.at<float>(v, u));
      const Eigen::Vector3d steel = Eigen::Vector3d::Constant(kSteel * (1.0 + 0.05 * scratches.at<float>(v, u)));
      const auto colourAt = [&](double u_px, double v_px) -> Eigen::Vector3d {
        const Eigen::Vector2d p_face((u_px / face_px - 0.5) * size_m.x(), (0.5 - v_px / face_px) * size_m.y());
        if (const auto grey = printedGrey(cells, cell_m, p_face)) {
          return Eigen::Vector3d::Constant(*grey);
        }
        if (p_face.cwiseAbs().maxCoeff() < 0.5 * brick.plate_edge_m) {
          return steel;
        }
        // Worn edges, so that bricks can be told apart.
        return (0.5 * size_m - p_face.cwiseAbs()).minCoeff() < kEdge_m ? Eigen::Vector3d(0.75 * clay) : clay;
      };
      const Eigen::Vector3d mean = meanOverTexel(u, v, colourAt);
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
      if (!(tag_edge_m > 0.0 && paper_m <= plate_edge_m + 1e-9)) {
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
