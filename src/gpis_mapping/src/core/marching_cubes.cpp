// SPDX-License-Identifier: BSD-3-Clause
#include "marching_cubes.h"

#include <cmath>
#include <utility>

#include <vtkMarchingCubesTriangleCases.h>

namespace gpis_mapping {
namespace {

// The numbering of VTK's table.
constexpr int kCorner[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
// Each from its corner with the lesser coordinates: all cubes about an edge interpolate alike.
constexpr int kEdge[12][2] = {{0, 1}, {1, 2}, {3, 2}, {0, 3}, {4, 5}, {5, 6},
                              {7, 6}, {4, 7}, {0, 4}, {1, 5}, {3, 7}, {2, 6}};
constexpr int kEdgeAxis[12] = {0, 1, 0, 1, 0, 1, 0, 1, 2, 2, 2, 2};
constexpr float kLeast = 1e-7f;  // an exact zero makes degenerate triangles
constexpr std::uint32_t kNone = UINT32_MAX;

class MarchingCubes {
 public:
  MarchingCubes(std::vector<float> values, int voxels)
      : values_(std::move(values)), voxels_(voxels), step_{1, voxels + 1, (voxels + 1) * (voxels + 1)} {
    for (float& value : values_) {
      if (std::abs(value) < kLeast) value = kLeast;
    }
  }

  void visit(int x, int y, int z) {
    const int first = x + y * step_[1] + z * step_[2];
    int corner[8];
    int code = 0;
    for (int c = 0; c < 8; ++c) {
      corner[c] = first + kCorner[c][0] + kCorner[c][1] * step_[1] + kCorner[c][2] * step_[2];
      const float value = valueAt(corner[c]);
      if (std::isnan(value)) return;
      code |= (value > 0.0f ? 1 : 0) << c;
    }
    if (code == 0 || code == 255) return;
    const int cube[3] = {x, y, z};
    for (const EDGE_LIST* edge = vtkMarchingCubesTriangleCases::GetCases()[code].edges; *edge >= 0; edge += 3) {
      std::array<std::uint32_t, 3> triangle;
      for (std::size_t i = 0; i < 3; ++i) {
        const int* const ends = kEdge[edge[i]];
        const int axis = kEdgeAxis[edge[i]];
        std::array<float, 3> from;
        for (std::size_t a = 0; a < 3; ++a) from[a] = static_cast<float>(cube[a] + kCorner[ends[0]][a]);
        triangle[i] = vertexOn(corner[ends[0]], axis, from);
      }
      contour_.triangles.push_back(triangle);
    }
  }

  Contour take() { return std::move(contour_); }

 private:
  float valueAt(int corner) const { return values_[static_cast<std::size_t>(corner)]; }

  /// The vertex on the edge from `corner` along `axis`; `from`: the corner's place.
  std::uint32_t vertexOn(int corner, int axis, std::array<float, 3> place) {
    if (on_edge_.empty()) on_edge_.assign(3 * values_.size(), kNone);
    std::uint32_t& vertex = on_edge_[static_cast<std::size_t>(3 * corner + axis)];
    if (vertex != kNone) return vertex;
    vertex = static_cast<std::uint32_t>(contour_.vertices.size());
    const int end = corner + step_[axis];
    const float share = valueAt(corner) / (valueAt(corner) - valueAt(end));
    const Eigen::Vector3f gradient = (1.0f - share) * gradientAt(corner) + share * gradientAt(end);
    const float length = gradient.norm();
    place[static_cast<std::size_t>(axis)] += share;
    contour_.vertices.push_back(place);
    contour_.normals.push_back(length > 0.0f ? Eigen::Vector3f(gradient / length) : Eigen::Vector3f::UnitZ());
    return vertex;
  }

  /// Central difference; one-sided where a neighbour is missing.
  Eigen::Vector3f gradientAt(int corner) const {
    Eigen::Vector3f gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const int c = corner / step_[axis] % (voxels_ + 1);
      const bool has_low = c > 0 && !std::isnan(valueAt(corner - step_[axis]));
      const bool has_high = c < voxels_ && !std::isnan(valueAt(corner + step_[axis]));
      const float low = valueAt(has_low ? corner - step_[axis] : corner);
      const float high = valueAt(has_high ? corner + step_[axis] : corner);
      gradient[axis] = has_low && has_high ? 0.5f * (high - low) : high - low;
    }
    return gradient;
  }

  std::vector<float> values_;
  int voxels_;
  int step_[3];                         // between corners along each axis
  std::vector<std::uint32_t> on_edge_;  // [3 corner + axis]; empty as long as there is no vertex
  Contour contour_;
};

}  // namespace

Contour contourOf(std::vector<float> values, const std::vector<std::uint8_t>& wanted, int voxels) {
  MarchingCubes cubes(std::move(values), voxels);
  std::size_t index = 0;
  for (int z = 0; z < voxels; ++z) {
    for (int y = 0; y < voxels; ++y) {
      for (int x = 0; x < voxels; ++x) {
        if (wanted[index++]) cubes.visit(x, y, z);
      }
    }
  }
  return cubes.take();
}

}  // namespace gpis_mapping
